"""Makes small wrong changes in the formation package, one at a time, and sees whether its unit tests notice.

    python -m tools.mutants.mutate --seed 1 --count 300 --workers 2     # drawn by the seed; `make mutants`
    python -m tools.mutants.mutate --named                              # the fixed list of named.toml

Kernels run as plain Python (NUMBA_DISABLE_JIT), every change in a forked process that imports it in the source's
place; no file is touched. Only tests that run the changed line are run, the quickest first, until one fails. Which
those are is found once and kept in .mutants/ until a source or test changes. A survivor is a change that no test
notices; equivalent.toml lists those that change nothing, each with a reason, by the text of the source line.
Exit code 1: fewer than nine in ten of the changes were noticed (with --named: not all).
"""

import argparse
import hashlib
import importlib
import json
import os
import random
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Sequence
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
os.environ["NUMBA_DISABLE_JIT"] = "1"
sys.dont_write_bytecode = True

from tools.mutants.mutations import Change, changed, changes  # noqa: E402
from tools.mutants.trial import FORK, ROOT, TESTS, Cover, Mutant, run_pytest, trial, trials  # noqa: E402

PACKAGE = ROOT / "formation"
KEPT = ROOT / ".mutants" / "map.json"
LEAST = 0.9
LEFT_OUT = ("maths/kernel.py", "maths/kernel_cache.py", "maths/kernel_parts.py", "warm_up.py", "topics.py")
"""How kernels are compiled, which does not happen here; and names."""
SLOWEST_S = 6.0  # of a test that is asked, traced; flights in a closed loop take minutes without a compiler
BUDGET_S, BUDGET_LOADED_S = 45.0, 15.0  # of tests for one change, traced; where it is as a module is loaded
PATIENCE = 2.0  # times the CPU that the tests took, traced, on top of LIMIT_S: an endless loop is noticed, too
LIMIT_S = 30.0


def main() -> int:
    options = _options()
    os.chdir(ROOT)
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = tempfile.mkdtemp(prefix="hypothesis-")
    tests = _coverage()
    drawn = _named(tests) if options.named else _drawn(tests, options)
    null = Mutant("nothing changed", "formation/nothing.py", compile("", "", "exec"), _quick(tests)[:100], 600.0)
    _preload()
    broken = trial(null)
    if broken.killer:
        raise SystemExit(f"the tests fail although nothing is changed: {broken.killer}")
    excuses, by_word = _excuses(), Counter[str]()
    for number, result in enumerate(trials(drawn, options.workers), 1):
        mutant, reason = result.mutant, excuses.get((result.mutant.line, result.mutant.change), "")
        word = "killed" if result.killer else "excused" if reason else "SURVIVED"
        by_word[word] += 1
        by = result.killer.rpartition("/")[2] or reason or f"{len(mutant.tests)} tests"
        print(f"{number:4d}/{len(drawn)} {word:8} {result.seconds:5.1f} s  {mutant.name}  [{by}]", flush=True)
    print(", ".join(f"{count} of {len(drawn)} {word}" for word, count in by_word.items()))
    return 0 if by_word["killed"] >= (1.0 if options.named else LEAST) * len(drawn) else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=300, help="how many changes are drawn")
    parser.add_argument("--only", default="", help="a part of the files' names")
    parser.add_argument("--named", action="store_true", help="the fixed list instead of drawn ones")
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args()


def _sources() -> list[Path]:
    return [f for f in sorted(PACKAGE.rglob("*.py")) if not str(f).endswith(LEFT_OUT)]


def _drawn(tests: dict[str, Any], options: argparse.Namespace) -> list[Mutant]:
    """The changes that the seed draws among all there are."""
    sites: list[Change] = []
    for path in _sources():
        file = str(path.relative_to(ROOT))
        if options.only in file:
            sites += changes(file, path.read_text(encoding="utf-8"))
    picked = random.Random(options.seed).sample(sites, min(options.count, len(sites)))
    return [_mutant(change, tests) for change in picked]


def _mutant(change: Change, tests: dict[str, Any]) -> Mutant:
    source = (ROOT / change.file).read_text(encoding="utf-8")
    code = compile(changed(source, change), str(ROOT / change.file), "exec")
    asked = _quick(tests, change.file, change.lines, change.called)
    return Mutant(
        str(change), change.file, code, asked, _limit(tests, asked), change.line, f"{change.old} -> {change.new}"
    )


def _named(tests: dict[str, Any]) -> list[Mutant]:
    """The changes of named.toml: a text of a file that becomes another."""
    mutants = []
    for entry in tomllib.loads((HERE / "named.toml").read_text(encoding="utf-8"))["mutant"]:
        among = [ROOT / entry["file"]] if "file" in entry else _sources()
        found = [f for f in among if entry["old"] in f.read_text(encoding="utf-8")]
        texts = [f.read_text(encoding="utf-8") for f in found]
        if len(found) != 1 or texts[0].count(entry["old"]) != 1:
            raise SystemExit(f"named.toml: {entry['name']}: {entry['old']!r} is not there exactly once")
        file, source = str(found[0].relative_to(ROOT)), texts[0]
        first = source[: source.index(entry["old"])].count("\n") + 1
        code = compile(source.replace(entry["old"], entry["new"]), str(found[0]), "exec")
        span = (first, first + entry["old"].count("\n"))
        asked = (entry["tests"],) if "tests" in entry else _quick(tests, file, span)
        mutants.append(Mutant(entry["name"], file, code, asked, LIMIT_S if "tests" in entry else _limit(tests, asked)))
    return mutants


def _excuses() -> dict[tuple[str, str], str]:
    """Reasons of equivalent.toml, by source line and change."""
    entries = tomllib.loads((HERE / "equivalent.toml").read_text(encoding="utf-8")).get("equivalent", [])
    texts = [line.strip() for f in _sources() for line in f.read_text(encoding="utf-8").splitlines()]
    known = set(texts)
    for entry in entries:
        if entry["line"] not in known:
            print(f"equivalent.toml: there is no line {entry['line']!r} any more", file=sys.stderr)
    return {(e["line"], e["change"]): e["reason"] for e in entries}


def _coverage() -> dict[str, Any]:
    """Which test runs which lines, {test: {"seconds", "lines"}}; anew where a test or the package has changed.

    A test that takes too long is in it without lines.
    """
    tests_read = sorted(file for folder in TESTS for file in (ROOT / folder).rglob("*.py"))
    read = [*tests_read, *sorted(PACKAGE.rglob("*.py"))]
    digest = hashlib.sha256(b"\0".join(file.read_bytes() for file in read)).hexdigest()
    if KEPT.exists() and (known := json.loads(KEPT.read_text(encoding="utf-8"))).get("of") == digest:
        return dict(known["tests"])
    print("finding which lines each test runs, with kernels as plain Python", flush=True)
    tests: dict[str, Any] = {}
    for file in tests_read:
        if not file.name.startswith("test_") or file.name == "test_kernel.py":  # it is about compiling
            continue
        ours, theirs = FORK.Pipe(duplex=False)
        child = FORK.Process(target=_measure, args=(str(file.relative_to(ROOT)), theirs))
        child.start()
        theirs.close()
        measured, failed = ours.recv()
        child.join()
        if failed:
            raise SystemExit(f"these tests fail with kernels as plain Python: {failed}")
        tests |= measured
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    KEPT.write_text(json.dumps({"of": digest, "tests": tests}), encoding="utf-8")
    return tests


@cache
def _text(test: str) -> str:
    return (ROOT / test.partition("::")[0]).read_text(encoding="utf-8")


def _measure(file: str, out: Connection) -> None:
    cover = Cover(ROOT, PACKAGE, SLOWEST_S)
    run_pytest([file], [cover])
    out.send((cover.tests, cover.failed))


def _quick(
    tests: dict[str, Any], file: str = "", span: tuple[int, int] = (0, 0), called: bool = True
) -> tuple[str, ...]:
    """The tests, quickest first, that run any of these lines.

    Of what runs when a module is loaded: all that run any line of it, or import from it.
    """
    lines, module = set(range(span[0], span[1] + 1)), file.removesuffix(".py").replace("/", ".")
    asked = []
    for name, test in tests.items():
        run = test["lines"].get(file, ())
        loads = not called and (run or f"from {module} import" in _text(name))
        if not file or loads or (called and lines.intersection(run)):
            asked.append((test["seconds"], name))
    if file and not called and not asked:
        return _quick(tests)
    spent, affordable = 0.0, []
    for seconds, name in sorted(asked):
        spent += seconds
        if spent <= (BUDGET_S if called else BUDGET_LOADED_S):
            affordable.append(name)
    return tuple(affordable)


def _limit(tests: dict[str, Any], asked: Sequence[str]) -> float:
    asked_s: float = sum(tests[name]["seconds"] for name in asked)
    return LIMIT_S + PATIENCE * asked_s


def _preload() -> None:
    """What every test needs and no change touches, loaded once for all the forked processes."""
    for name in ("numpy", "numba", "scipy.optimize", "scipy.spatial.transform", "pydantic", "hypothesis.strategies"):
        importlib.import_module(name)


if __name__ == "__main__":
    raise SystemExit(main())
