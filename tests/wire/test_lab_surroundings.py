import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from formation.config import ControlLawConfig, LabConfig
from formation.guidance.shape import known, shape_for
from formation.guidance.shape_request import ShapeRequest
from formation.guidance.trajectory import anchored, sample
from tests.wire.own_package import installed_in
from wire.config_file import ConfigError, dump, load
from wire.lab_surroundings import LAWS, SHAPES, TRAJECTORIES, law_in_file, law_package, printing_to_stderr

HOLD = '{ kind = "hold" }'
FOLLOWERS = '[[followers]]\nbody = "a"\nsysid = 2\noffset_m = [-1.0, 0.0, 0.0]\n'


def lab(folder: Path, trajectory: str, law: str = "") -> LabConfig:
    path = folder / "lab.toml"
    path.write_text(f'{law}\n[leader]\nbody = "leader"\nsysid = 1\ntrajectory = {trajectory}\n{FOLLOWERS}')
    return load(path, LabConfig)


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[None]:
    with installed_in(tmp_path):
        yield


def test_a_way_in_a_file_beside_the_lab_file_becomes_part_of_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("t,x,y,z,yaw\n0,0,0,0.5,0\n\n2, 1,0,0.5,0\n4,1,1,0.5,1.57\n")
    config = lab(tmp_path, '{ kind = "file", file = "way.csv" }')
    assert config.leader.trajectory.points[1] == (2.0, 1.0, 0.0, 0.5, 0.0)
    (tmp_path / "way.csv").unlink()
    (tmp_path / "again.toml").write_text(dump(config))
    assert load(tmp_path / "again.toml", LabConfig) == config


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "No such file"),
        ("0,0,0,0.5,0\n1,0,0,x,0\n", "way.csv:2: column 4 (z, taken as m) is not a number"),
        ("0,0,0,0.5,0\n1,0,0,0.5\n", "way.csv:2: 4 columns under a header of 5"),
        ("0,0,0,0.5,0\n1,0,0,inf,0\n", "way.csv:2: column 4 (z, taken as m) = inf: a value is not finite"),
        ("", "no line of numbers"),
        ("0,0,0,0.5,0\n1,0,0,0.5,0\n1,0,0,0.6,0\n", "way.csv:3: the stamp of the row before"),
    ],
)
def test_a_file_that_is_no_way_is_named_with_its_line(tmp_path: Path, text: str | None, told: str) -> None:
    if text is not None:
        (tmp_path / "way.csv").write_text(text)
    with pytest.raises(ConfigError) as error:
        lab(tmp_path, '{ kind = "file", file = "way.csv" }')
    assert told in str(error.value)


@pytest.mark.parametrize("file", ["/dev/zero", "/etc/passwd", "endless.csv", "many.csv", "quoted.csv"])
def test_a_file_of_any_kind_is_refused_in_one_line_that_shows_nothing_of_it(tmp_path: Path, file: str) -> None:
    (tmp_path / "endless.csv").write_bytes(b"0" * (9 << 20))
    (tmp_path / "many.csv").write_text("0,0,0,0,0\n" * 20_001)
    (tmp_path / "quoted.csv").write_text('"' + "secret," * 40_000)
    with pytest.raises(ConfigError) as error:
        lab(tmp_path, f'{{ kind = "file", file = "{file}" }}')
    (problem,) = error.value.problems
    assert "0:0" not in problem
    assert "secret" not in problem
    assert len(problem) < 300


def test_a_lab_s_own_trajectory_is_flown_as_its_package_makes_it(tmp_path: Path, installed: None) -> None:
    config = lab(tmp_path, '{ kind = "own", name = "helix", options = { laps = 1, radius_m = 0.5, climb_m = 0.2 } }')
    path = anchored(config.leader.trajectory, np.zeros(3), 0.0)
    motion = np.empty((3, 4))
    sample(path.kind, path.numbers, path.knots, 4.0, motion)
    # Half-way round a circle of half a metre, at 1.875 of its mean speed.
    np.testing.assert_allclose(motion[0], [-0.5, 0.0, 0.4, 1.5 * np.pi], atol=1e-6)
    np.testing.assert_allclose(
        motion[1], [0.0, -1.875 * np.pi / 8.0, 1.875 * 0.2 / 8.0, 1.875 * np.pi / 4.0], atol=1e-4
    )


def test_a_lab_s_own_shape_is_one_of_its_shapes(tmp_path: Path, installed: None) -> None:
    config = lab(tmp_path, '{ kind = "hold" }', 'formation = { own_shapes = ["diamond"] }')
    assert "diamond" in known(config)
    assert shape_for(config, ShapeRequest("diamond", 2.0)).offset_lead_m == ((-1.0, 1.0, 0.0),)


def test_of_packages_only_what_the_lab_names_is_loaded(tmp_path: Path, installed: None) -> None:
    assert "diamond" not in known(lab(tmp_path, HOLD))
    assert [name for name in sys.modules if name.startswith("own_formation")] == []


@pytest.mark.parametrize("error", ["SystemExit(3)", "KeyError('x')"])
@pytest.mark.parametrize("named", [("", 'control_law = { name = "bad" }'), ("trajectories", ""), ("shapes", "")])
def test_whatever_a_package_raises_is_an_error_of_the_lab_file(
    tmp_path: Path, error: str, named: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad_package.py").write_text(f"def make(**options):\n    raise {error}\n")
    told = tmp_path / "bad_package-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: bad-package\nVersion: 1.0\n")
    groups = (LAWS, TRAJECTORIES, SHAPES)
    (told / "entry_points.txt").write_text("\n".join(f"[{group}]\nbad = bad_package:make" for group in groups))
    trajectory = '{ kind = "own", name = "bad" }' if named[0] == "trajectories" else '{ kind = "hold" }'
    law = 'formation = { own_shapes = ["bad"] }' if named[0] == "shapes" else named[1]
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "bad_package", raising=False)
    with pytest.raises(ConfigError, match=re.escape(error.partition("(")[0])):
        lab(tmp_path, trajectory, law)


@pytest.mark.parametrize(
    ("trajectory", "law", "told"),
    [
        ('{ kind = "own" }', "", "leader.trajectory.name: is missing: "),
        ('{ kind = "own", name = "helix", options = { size = 1.0 } }', "", "unexpected keyword argument 'size'"),
        ('{ kind = "own", name = "spiral" }', "", "'spiral' in mavlink_formation.trajectories; known: helix"),
        (HOLD, '{ name = "pi" }', "'pi' in mavlink_formation.control_laws; known: cascade"),
        (HOLD, '{ name = "cascade", options = { kp = 1.0 } }', "unexpected keyword argument 'kp'"),
        (HOLD, '{ name = "cascade", options = { kd_1_s = -1.0 } }', "kp_1_s, kd_1_s and speed_m_s must be"),
    ],
)
def test_what_no_package_makes_is_named(tmp_path: Path, installed: None, trajectory: str, law: str, told: str) -> None:
    with pytest.raises(ConfigError) as error:
        lab(tmp_path, trajectory, law and f"control_law = {law}")
    assert told in str(error.value)


def test_a_lab_s_own_law_is_named_and_made_with_its_options(tmp_path: Path, installed: None) -> None:
    config = lab(tmp_path, '{ kind = "hold" }', 'control_law = { name = "cascade", options = { ki_1_s2 = 1.5 } }')
    assert config.control_law == ControlLawConfig(name="cascade", options={"ki_1_s2": 1.5})
    assert law_package("cascade") == "own-formation 1.0"


def test_what_a_lab_s_own_code_prints_is_no_result(capsys: pytest.CaptureFixture[str]) -> None:
    assert printing_to_stderr(lambda: print("from a law")) is None
    assert capsys.readouterr() == ("", "from a law\n")


LAW = "def law(at, gain=2.0):\n    return gain * at\n"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (LAW, ""),
        (f"import math\n{LAW}def _helper():\n    pass\n", ""),
        (f"def other(at):\n    return at\n{LAW}", ":law"),
        ("class Law:\n    def __call__(self, at):\n        return 2.0 * at\n\ndef helper(x):\n    return x\n", ""),
        ("def make():\n    return lambda at: 2.0 * at\n", ""),
        (  # dataclasses look their module up, which an import has entered by then
            "from __future__ import annotations\nfrom dataclasses import dataclass\n\n"
            "@dataclass\nclass Law:\n    gain: float = 2.0\n"
            "    def __call__(self, at):\n        return self.gain * at\n",
            "",
        ),
    ],
)
def test_a_law_in_a_file_is_a_function_its_maker_or_a_class(tmp_path: Path, text: str, wanted: str) -> None:
    (tmp_path / "my_law.py").write_text(text)
    law = law_in_file(f"{tmp_path / 'my_law.py'}{wanted}", {})()
    np.testing.assert_array_equal(law(np.ones(3)), 2.0 * np.ones(3))


def test_a_plain_function_gets_its_options_and_no_others(tmp_path: Path) -> None:
    (tmp_path / "my_law.py").write_text(LAW)
    assert law_in_file(str(tmp_path / "my_law.py"), {"gain": 3.0})()(np.ones(3))[0] == 3.0
    with pytest.raises(ValueError, match="unexpected keyword argument 'gian'"):
        law_in_file(str(tmp_path / "my_law.py"), {"gian": 3.0})


def test_a_file_without_a_law_and_one_that_cannot_be_loaded_are_named_and_leave_nothing(tmp_path: Path) -> None:
    (tmp_path / "empty.py").write_text("")
    with pytest.raises(ValueError, match="neither a function nor a class with __call__"):
        law_in_file(str(tmp_path / "empty.py"), {})
    (tmp_path / "half.py").write_text("import math\nraise RuntimeError('no')\n")
    with pytest.raises(ValueError, match=r"half\.py: RuntimeError: no"):
        law_in_file(str(tmp_path / "half.py"), {})
    assert "law_in_half" not in sys.modules
    with pytest.raises(ConfigError, match="is named as a package registers it, not by its file"):
        lab(tmp_path, HOLD, 'control_law = { name = "my_law.py" }')
