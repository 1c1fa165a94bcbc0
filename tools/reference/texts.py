"""Every text by which the programs warn: read from their source, so that the manual can be held against them.

A text with a variable part has `…` in its place. A text that the source only passes on is found at its origin.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from formation.reasons import Reason

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("formation", "wire", "mocap", "gcs", "drone_agent")
"""Whose warnings an operator sees."""
LOUD = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING")
GAP = "…"


@dataclass(frozen=True, slots=True, order=True)
class LoggedText:
    """One text: how loudly it is said, the words, the file that has them."""

    severity: str
    text: str
    file: str


@dataclass(frozen=True, slots=True, order=True)
class PassedOn:
    """A warning whose words come from elsewhere: the file and the expression."""

    file: str
    expression: str


@cache
def sources() -> tuple[tuple[str, ast.Module], ...]:
    """Every module of the packages: its path from the root, and its syntax tree."""
    paths = (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))
    return tuple((str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))) for path in paths)


@cache
def warnings() -> tuple[list[LoggedText], list[PassedOn]]:
    """What is said with a severity of WARNING or worse, and what is passed on."""
    found: set[LoggedText] = set()
    passed: set[PassedOn] = set()
    for file, tree in sources():
        functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        for scope in (tree, *functions.values()):
            for loud, items in _loud_items(scope):
                texts = [t for item in items for t in _worded(item, scope, functions)]
                found.update(LoggedText(loud, text, file) for text in texts)
                if not texts and scope is not tree:
                    passed.add(PassedOn(file, ", ".join(ast.unparse(item) for item in items)))
    return sorted(found), sorted(passed)


def _loud_items(scope: ast.AST) -> Iterator[tuple[str, list[ast.expr]]]:
    """Of every call and pair with a loud severity: the severity, and what stands after it."""
    for node in ast.walk(scope):
        items = node.args if isinstance(node, ast.Call) else node.elts if isinstance(node, ast.Tuple) else []
        for k, item in enumerate(items):
            loud = severity_in(item)
            if loud is not None and items[k + 1 :] and severity_in(items[k + 1]) is None:
                yield loud, list(items[k + 1 :])
                break


def _worded(item: ast.expr, scope: ast.AST, functions: dict[str, ast.FunctionDef]) -> list[str]:
    """The texts of an argument: as written, as assigned to its name in the function, as the function called returns."""
    found = texts_in(item)
    if isinstance(item, ast.Name):
        for node in ast.walk(scope):
            if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == item.id for t in node.targets):
                found += texts_in(node.value)
    elif isinstance(item, ast.Call) and _name_of(item.func) in functions:
        called = functions[_name_of(item.func)]
        found += [t for n in ast.walk(called) if isinstance(n, ast.Return) and n.value for t in texts_in(n.value)]
    return [text for text in found if " " in text]


def severity_in(node: ast.expr) -> str | None:
    """The severity that an argument names, where it is WARNING or worse; of a choice the worse one."""
    if isinstance(node, ast.IfExp):
        return severity_in(node.body) or severity_in(node.orelse)
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Severity":
        return node.attr if node.attr in LOUD else None
    return None


def texts_in(node: ast.expr) -> list[str]:
    """The texts that an expression may be, `…` where it is variable; none for what is no literal."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr():
            return [_joined(node)]
        case ast.IfExp():
            return texts_in(node.body) + texts_in(node.orelse)
        case ast.BoolOp():
            return [text for value in node.values for text in texts_in(value)]
        case ast.BinOp(op=ast.Add()):
            left, right = texts_in(node.left) or [GAP], texts_in(node.right) or [GAP]
            return [normal(a + b) for a in left for b in right]
    return []


def _joined(node: ast.JoinedStr) -> str:
    parts = [str(part.value) if isinstance(part, ast.Constant) else GAP for part in node.values]
    return normal("".join(parts))


def normal(text: str) -> str:
    """One spelling of a text: variable parts as one `…`, single blanks, commands without their marks."""
    text = " ".join(text.replace("{}", GAP).replace("`", "").split())
    while GAP + GAP in text:
        text = text.replace(GAP + GAP, GAP)
    return text


def _name_of(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


REASON_FILE = "gcs/permissions.py"
"""The module that makes parts of the reasons' texts."""


def reasons() -> list[LoggedText]:
    """Why the ground rejects `arm`, `take-control` and the other commands."""
    texts = (normal(re.sub(r"\{[^}]*\}", GAP, reason.template)).removeprefix(f"{GAP}: ") for reason in Reason)
    found = {LoggedText("refusal", text, "formation/reasons.py") for text in texts if " " in text.strip(f"{GAP} :")}
    tree = ast.parse((ROOT / REASON_FILE).read_text(encoding="utf-8"))
    inside = {part for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    documented = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant | ast.JoinedStr) and node not in inside and id(node) not in documented:
            texts = (text for text in texts_in(node) if text.strip(f"{GAP} ,:").count(" "))
            found.update(LoggedText("refusal", text, REASON_FILE) for text in texts)
    return sorted(found)


def rejected_inputs() -> list[LoggedText]:
    """Why an input from outside is dropped: the reasons that `RejectionLog.note` and a camera's feed are given."""
    found: set[LoggedText] = set()
    for file, tree in sources():
        functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        for scope in functions.values():
            for node in ast.walk(scope):
                if isinstance(node, ast.Call) and _name_of(node.func) in ("note", "refuse"):
                    items = node.args[1:2] if _name_of(node.func) == "note" else node.args[:1]
                    found.update(
                        LoggedText("dropped", t, file) for i in items for t in _worded(i, scope, functions) if " " in t
                    )
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and node.name == "RejectReason":
                values = [n.value for n in node.body if isinstance(n, ast.Assign)]
                found.update(LoggedText("dropped", t, file) for v in values for t in texts_in(v))
    return sorted(found)


def doctor_checks() -> list[str]:
    """The names of what `gcs doctor` checks, parameters of autopilots aside."""
    names: set[str] = set()
    for file, tree in sources():
        if "/doctor/" not in file:
            continue
        constants = {
            t.id: n.value
            for n in ast.walk(tree)
            if isinstance(n, ast.Assign)
            for t in n.targets
            if isinstance(t, ast.Name)
        }
        pairs = [
            (t, v)
            for n in ast.walk(tree)
            if isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Tuple) and isinstance(n.value, ast.Tuple)
            for t, v in zip(n.targets[0].elts, n.value.elts, strict=True)
        ]
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and _name_of(node.func) in ("Finding", "graded", "unmeasured"):
                check = node.args[1]
                if isinstance(check, ast.Name):
                    values = [v for t, v in pairs if isinstance(t, ast.Name) and t.id == check.id]
                    values += [constants[check.id]] if check.id in constants else []
                    names.update(text for value in values for text in texts_in(value))
                names.update(texts_in(check))
    return sorted(names)
