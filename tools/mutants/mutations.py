"""Small wrong changes of Python source: where they can be made, and the tree with one of them made. Pure."""

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

TWINS = {"min": "max", "max": "min", "sin": "cos", "cos": "sin"}
OPPOSITE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
OTHER: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.Mod: ast.Add,
    ast.FloorDiv: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
FACTOR = 1.5  # of a number, which stays of its sign and kind

Path = tuple[tuple[str, int], ...]
"""The way from a module to one of its nodes: field and place in it (-1 where the field is no list)."""
Span = tuple[int, int]
Node = ast.expr | ast.stmt
Make = Callable[[Any], ast.AST | None]
"""The node that takes another's place; None: it stands for nothing, `pass`. It is given a copy of the very node that
`_of` made it for, of whatever kind."""


@dataclass(frozen=True, slots=True)
class Change:
    """One place and one way to be wrong: `old` becomes `new` in the file's source line `line`, at `lineno`.

    lines: first and last of its statement; called: whether that runs in a function, not when the module is loaded.
    """

    file: str
    lineno: int
    lines: tuple[int, int]
    called: bool
    kind: str
    old: str
    new: str
    line: str
    at: Path
    number: int

    def __str__(self) -> str:
        return f"{self.file}:{self.lineno}  {self.old} -> {self.new}   | {self.line}"


def changes(file: str, source: str) -> list[Change]:
    """All changes of one file, in the order of its lines."""
    lines = source.splitlines()
    found = []
    for at, node, span, called in _walk(ast.parse(source), (), (1, 1), False):
        for number, (kind, make) in enumerate(_of(node)):
            made = make(copy.deepcopy(node))
            old, new = ast.unparse(node), "pass" if made is None else ast.unparse(made)
            if old != new:
                line = lines[node.lineno - 1].strip()
                found.append(Change(file, node.lineno, span, called, kind, old, new, line, at, number))
    return found


def changed(source: str, change: Change) -> ast.Module:
    """The file's tree with the change made."""
    tree = ast.parse(source)
    parent: ast.AST = tree
    for field, place in change.at[:-1]:
        value = getattr(parent, field)
        parent = value[place] if place >= 0 else value
    field, place = change.at[-1]
    node = getattr(parent, field)[place] if place >= 0 else getattr(parent, field)
    made = _of(node)[change.number][1](copy.deepcopy(node)) or ast.Pass()
    ast.copy_location(made, node)
    if place >= 0:
        getattr(parent, field)[place] = made
    else:
        setattr(parent, field, made)
    return ast.fix_missing_locations(tree)


def _walk(node: ast.AST, at: Path, span: Span, called: bool) -> Iterator[tuple[Path, Node, Span, bool]]:
    """Every node that may be wrong (no decorator, no annotation), its statement's lines, whether in a function."""
    for field, value in ast.iter_fields(node):
        if field in ("decorator_list", "annotation", "returns") or (
            field == "keywords" and isinstance(node, ast.ClassDef)
        ):
            continue
        inside = called or (field == "body" and isinstance(node, (ast.FunctionDef, ast.Lambda)))
        for place, child in enumerate(value) if isinstance(value, list) else ((-1, value),):
            if not isinstance(child, ast.AST) or isinstance(
                child, (ast.Import, ast.ImportFrom, ast.JoinedStr, ast.Raise)
            ):
                continue
            here, lines = (*at, (field, place)), _span(child) if isinstance(child, ast.stmt) else span
            if isinstance(child, Node):
                yield here, child, lines, inside
            yield from _walk(child, here, lines, inside)


def _span(statement: ast.stmt) -> Span:
    """First and last line of a statement, of its head alone where it has a body."""
    body = getattr(statement, "body", None)
    last = body[0].lineno - 1 if body else statement.end_lineno or statement.lineno
    return statement.lineno, max(last, statement.lineno)


def _of(node: ast.AST) -> list[tuple[str, Make]]:
    """The ways in which this node can be wrong."""
    match node:
        case ast.Constant(value=bool()):
            return [("constant", lambda n: ast.Constant(not n.value))]
        case ast.Constant(value=int()):
            return [("constant", lambda n: ast.Constant(n.value + 1))]
        case ast.Constant(value=float()):
            return [("constant", lambda n: ast.Constant(n.value * FACTOR if n.value else 1.0))]
        case ast.BinOp(op=op) if type(op) in OTHER and not _text(node):
            ways: list[tuple[str, Make]] = [("operator", _operator), ("left alone", lambda n: n.left)]
            return [*ways, ("right alone", lambda n: n.right)] if isinstance(op, (ast.Add, ast.Mult)) else ways
        case ast.UnaryOp(op=ast.USub()) | ast.UnaryOp(op=ast.Not()):
            return [("sign", lambda n: n.operand)]
        case ast.Compare(ops=[op]) if type(op) in OPPOSITE:
            return [("comparison", _comparison)]
        case ast.BoolOp():
            return [("operator", _junction)]
        case ast.Call():
            return _of_call(node)
        case ast.AugAssign(op=op) if type(op) in OTHER:
            return [("operator", _operator), ("dropped", lambda n: None)]
        case ast.Expr(value=ast.Call()):
            return [("dropped", lambda n: None)]
        case ast.IfExp():
            return [("left alone", lambda n: n.body), ("right alone", lambda n: n.orelse)]
    return []


def _of_call(node: ast.Call) -> list[tuple[str, Make]]:
    ways: list[tuple[str, Make]] = []
    if isinstance(node.func, ast.Name) and node.func.id in TWINS:
        ways.append(("operator", _twin))
    if len(node.args) >= 2 and not (isinstance(node.func, ast.Name) and node.func.id in ("min", "max", "isinstance")):
        ways += [("swapped", partial(_swap, k=k)) for k in range(len(node.args) - 1)]
    return ways


def _text(node: ast.BinOp) -> bool:
    """Whether an operator joins texts or types instead of numbers."""
    sides = (node.left, node.right)
    return any(isinstance(s, ast.Constant) and (s.value is None or isinstance(s.value, str)) for s in sides)


def _operator(node: ast.BinOp | ast.AugAssign) -> ast.AST:
    node.op = OTHER[type(node.op)]()
    return node


def _comparison(node: ast.Compare) -> ast.AST:
    node.ops = [OPPOSITE[type(node.ops[0])]()]
    return node


def _junction(node: ast.BoolOp) -> ast.AST:
    node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
    return node


def _twin(node: ast.Call) -> ast.AST:
    assert isinstance(node.func, ast.Name)
    node.func.id = TWINS[node.func.id]
    return node


def _swap(node: ast.Call, k: int) -> ast.AST:
    node.args[k], node.args[k + 1] = node.args[k + 1], node.args[k]
    return node
