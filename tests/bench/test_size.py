"""The figures of a tree that is made by hand."""

from pathlib import Path

import pytest

from bench.size import PRODUCT, Size, measure

FILES = {
    "pyproject.toml": '[project]\ndependencies = ["numpy", "scipy"]\n',
    "formation/__init__.py": "",
    "formation/law.py": "from formation import gains\n\nLIMIT = 2 * 0.5\nPAIR = (1, (-2, 3.0))\nNAME = 'a'\n",
    "formation/gains.py": "import formation.law\n\n\ndef gain() -> float:\n    INSIDE = 3\n    return INSIDE\n",
    "wire/text.py": "import formation.law\n\n\ndef over(text: str) -> bool:\n    return text.startswith('over: ')\n",
    "drone_agent/__init__.py": "",
    "drone_agent/bridge.py": "import formation.law\nfrom drone_agent.simulation import body\n",
    "drone_agent/simulation/body.py": "MASS_KG: float = 0.04\n",
    "formation/drone.py": "from numba.core.codegen import CodeLibrary, names\n\n\nclass Drone:\n    sysid: int = 1\n\n"
    "    def __init__(self) -> None:\n        self.armed = self.held = False\n",
    "drone_agent/other.py": "def same(text: str) -> bool:\n    return text == 'no' or 'is for ' in text\n",
    "tools/fuzz.py": "1\n2\n",
    "bench/soak.py": "1\n",
    "tests/test_law.py": "1\n\n3\n",
}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_every_figure_is_counted(tree: Path) -> None:
    """Constants: 1.0, three numbers of the tuple, the mass. `gains` alone has one importer, of its folder."""
    lines = sum(text.count("\n") for name, text in FILES.items() if name.partition("/")[0] in PRODUCT)
    assert measure(tree) == Size(
        product_lines=lines,
        product_files=9,
        files_under_60_lines=9,
        bench_lines=1,
        tools_lines=2,
        tests_lines=3,
        constants=5,
        constants_per_thousand_lines=round(5000.0 / lines, 1),
        imported_by_one=1,
        texts_compared=2,
        bridge_modules=6,
        bridge_lines=14,
        bridge_simulated=("drone_agent.simulation.body",),
        dependencies=2,
        numba_private=1,
        estimate_fields=0,
        drone_fields=3,
        link_attributes=0,
    )
