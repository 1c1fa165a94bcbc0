"""Small wrong changes of Python source: where they can be made, and the tree with one of them made. Pure."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True)
class Change:
    """One place and one way to be wrong: `old` becomes `new` in the file's source line `line`, at `lineno`.

    lines: first and last of its statement; called: whether that runs in a function, not when the module is loaded.
    """

    file: str
    lineno: int
    lines: tuple[int, int]
    called: bool
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
        for number, made in enumerate(_of(node)):
            old, new = ast.unparse(node), ast.unparse(ast.fix_missing_locations(made))
            if old != new:
                line = lines[node.lineno - 1].strip()
                found.append(Change(file, node.lineno, span, called, old, new, line, at, number))
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
    made = ast.copy_location(_of(node)[change.number], node)
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


def _of(node: ast.AST) -> list[ast.AST]:
    """What may wrongly stand in this node's place; parts of the node itself are used again."""
    match node:
        case ast.Constant(value=bool(value)):
            return [ast.Constant(not value)]
        case ast.Constant(value=int(value)):
            return [ast.Constant(value + 1)]
        case ast.Constant(value=float(value)):
            return [ast.Constant(value * FACTOR if value else 1.0)]
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OTHER and not _is_text(left, right):
            ways: list[ast.AST] = [ast.BinOp(left, OTHER[type(op)](), right), left]
            return [*ways, right] if isinstance(op, (ast.Add, ast.Mult)) else ways
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            return [node.operand]
        case ast.Compare(left=left, ops=[op], comparators=right) if type(op) in OPPOSITE:
            return [ast.Compare(left, [OPPOSITE[type(op)]()], right)]
        case ast.BoolOp(op=op, values=values):
            return [ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)]
        case ast.Call(func=function, args=given, keywords=named):
            name = function.id if isinstance(function, ast.Name) else ""
            twin = [ast.Call(ast.Name(TWINS[name], ast.Load()), given, named)] if name in TWINS else []
            swaps = 0 if name in ("min", "max", "isinstance") else len(given) - 1
            orders = ([*given[:k], given[k + 1], given[k], *given[k + 2 :]] for k in range(swaps))
            return [*twin, *(ast.Call(function, order, named) for order in orders)]
        case ast.AugAssign(target=target, op=op, value=value) if type(op) in OTHER:
            return [ast.AugAssign(target, OTHER[type(op)](), value), ast.Pass()]
        case ast.Expr(value=ast.Call()):
            return [ast.Pass()]
        case ast.IfExp(body=body, orelse=other):
            return [body, other]
    return []


def _is_text(*sides: ast.expr) -> bool:
    """Whether an operator joins texts or types instead of numbers."""
    return any(isinstance(s, ast.Constant) and (s.value is None or isinstance(s.value, str)) for s in sides)
