"""How heavy the project is: `python -m bench.size` prints the table of figures that may only go down."""

import argparse
import ast
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("formation", "wire", "mocap", "gcs", "drone_agent", "sim", "analysis", "gcs_log", "mavlink_formation")
SIMULATED = ("drone_agent.simulation.", "drone_agent.flight.", "drone_agent.autopilots.", "drone_agent.sitl.", "sim.")
LOADED = """
import json, sys
try:
    import drone_agent.bridge.daemon
except ModuleNotFoundError:  # it is one file
    import drone_agent.bridge
print(json.dumps({name: m.__file__ for name, m in sys.modules.items() if getattr(m, "__file__", None)}))
"""


@dataclass(frozen=True, slots=True)
class Size:
    """Lines are those of Python files, blank ones too.

    constants: module-level names that are a number, or a tuple of numbers, each of which counts. imported_by_one: files
    that one file alone of the product imports, of the same folder. texts_compared: comparisons with a literal that has
    a space. bridge_*: of the project's modules that the bridge's process loads; bridge_simulated: those of a simulator.
    numba_private: classes of its inside that are imported. estimate_fields: of VehicleEstimate; drone_fields: of Drone;
    link_attributes: of DroneLink.
    """

    product_lines: int
    product_files: int
    files_under_60_lines: int
    bench_lines: int
    tools_lines: int
    tests_lines: int
    constants: int
    constants_per_thousand_lines: float
    imported_by_one: int
    texts_compared: int
    bridge_modules: int
    bridge_lines: int
    bridge_simulated: tuple[str, ...]
    dependencies: int
    numba_private: int
    estimate_fields: int
    drone_fields: int
    link_attributes: int


@dataclass(frozen=True, slots=True)
class Ways:
    """The files that one frame passes, and one stop, and what a second of a lockstep flight calls: `bench.way`."""

    frame: tuple[str, ...]
    frame_folder_changes: int
    stop: tuple[str, ...]
    stop_lines: int
    python_calls: int


def ways(root: Path = ROOT) -> Ways:
    """Of the tree under `root`, which is flown."""
    command = (sys.executable, "-P", str(Path(__file__).with_name("way.py")))
    surroundings = os.environ | {"PYTHONPATH": str(root)}
    told = json.loads(subprocess.run(command, cwd=root, env=surroundings, stdout=subprocess.PIPE, check=True).stdout)
    lines = _lines(root / file for file in told["stop"])
    return Ways(tuple(told["frame"]), told["frame_folder_changes"], tuple(told["stop"]), lines, told["python_calls"])


def measure(root: Path = ROOT) -> Size:
    """The size of the tree under `root`."""
    files = sorted(path for name in PRODUCT for path in (root / name).rglob("*.py"))
    sources = {path: path.read_text(encoding="utf-8") for path in files}
    trees = {path: ast.parse(source) for path, source in sources.items()}
    lines = _lines(files)
    assigned = [s for tree in trees.values() for s in tree.body if isinstance(s, ast.Assign | ast.AnnAssign)]
    constants = sum(_constants(statement.value) for statement in assigned)
    loaded = _loaded_by_bridge(root)
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return Size(
        product_lines=lines,
        product_files=len(files),
        files_under_60_lines=sum(len(source.splitlines()) < 60 for source in sources.values()),
        bench_lines=_lines((root / "bench").rglob("*.py")),
        tools_lines=_lines((root / "tools").rglob("*.py")),
        tests_lines=_lines((root / "tests").rglob("*.py")),
        constants=constants,
        constants_per_thousand_lines=round(1000.0 * constants / max(lines, 1), 1),
        imported_by_one=len(imported_by_one(root, trees)),
        texts_compared=sum(len(list(_texts_compared(tree))) for tree in trees.values()),
        bridge_modules=len(loaded),
        bridge_lines=_lines(loaded.values()),
        bridge_simulated=tuple(sorted(name for name in loaded if f"{name}.".startswith(SIMULATED))),
        dependencies=len(project["dependencies"]),
        numba_private=sum(map(_numba_private, trees.values())),
        estimate_fields=_fields(trees, "VehicleEstimate"),
        drone_fields=_fields(trees, "Drone"),
        link_attributes=_fields(trees, "DroneLink"),
    )


def _lines(files: Iterable[Path]) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def _constants(value: ast.AST | None) -> int:
    """How many numbers a value is: one, a sum of numbers is one, a tuple's members count."""
    if isinstance(value, ast.Tuple | ast.List | ast.Set):
        return sum(map(_constants, value.elts))
    return int(_is_number(value))


def _is_number(value: ast.AST | None) -> bool:
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def _numba_private(tree: ast.Module) -> int:
    """Classes of numba's inside that are imported to be extended or overridden."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    inside = [node for node in imports if str(node.module).startswith("numba.core")]
    return sum(alias.name[0].isupper() for node in inside for alias in node.names)


def _fields(trees: dict[Path, ast.Module], name: str) -> int:
    """What an object of the class of that name keeps: declared fields, and attributes that its `__init__` sets."""
    kept: set[str] = set()
    for node in (node for tree in trees.values() for node in tree.body):
        if not (isinstance(node, ast.ClassDef) and node.name == name):
            continue
        for inner in ast.walk(node):
            if isinstance(inner, ast.AnnAssign) and inner in node.body:
                kept.add(ast.unparse(inner.target))
            elif isinstance(inner, ast.Attribute) and isinstance(inner.ctx, ast.Store) and _is_self(inner.value):
                kept.add(inner.attr)
    return len(kept)


def _is_self(value: ast.expr) -> bool:
    return isinstance(value, ast.Name) and value.id == "self"


def imported_by_one(root: Path, trees: dict[Path, ast.Module]) -> list[Path]:
    """The files that exactly one file imports, which lies in the same folder."""
    module_of = {".".join(path.relative_to(root).with_suffix("").parts): path for path in trees}
    importers: dict[Path, set[Path]] = {path: set() for path in trees}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                names = [str(node.module), *(f"{node.module}.{name}" for name in names)]
            for name in set(names) & set(module_of):
                importers[module_of[name]].add(path)
    return [path for path, by in importers.items() if len(by) == 1 and next(iter(by)).parent == path.parent]


def _texts_compared(tree: ast.Module) -> Iterator[ast.AST]:
    """Comparisons, and tests of a beginning or end, with a text of several words."""
    for node in ast.walk(tree):
        sides: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("startswith", "endswith"):
            sides = node.args
        if any(isinstance(s, ast.Constant) and isinstance(s.value, str) and " " in s.value for s in sides):
            yield node


def _loaded_by_bridge(root: Path) -> dict[str, Path]:
    """The project's modules that the bridge's process loads, with their files."""
    ran = subprocess.run((sys.executable, "-c", LOADED), cwd=root, capture_output=True, text=True, check=True)
    files = {name: Path(file) for name, file in json.loads(ran.stdout).items()}
    return {name: file for name, file in files.items() if name.partition(".")[0] in PRODUCT and root in file.parents}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", dest="as_json", help="print JSON instead of a table")
    parser.add_argument("--root", type=Path, default=ROOT, help="another tree than this one")
    options = parser.parse_args()
    root = options.root.resolve()
    figures = asdict(measure(root)) | asdict(ways(root))
    if options.as_json:
        print(json.dumps(figures, indent=2))
        return
    for name, value in figures.items():
        text = f"{len(value)}" if isinstance(value, tuple) else f"{value:,}"
        print(f"{name.replace('_', ' '):30} {text}")


if __name__ == "__main__":
    main()
