"""The manual's reference, made from the code: each function returns one piece of Markdown.

A page asks for a piece by a comment of its own, `<!-- generated: NAME ARGUMENT -->`; `make reference` writes it below.
"""

import ast
import dataclasses
import importlib
import inspect
import re
import textwrap
import tomllib
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer
from typer.cli import get_docs_for_click

from tools.reference import drawing, texts
from tools.reference.texts import ROOT

Row = tuple[str, ...]
UNITS = {
    "m": "m", "m_s": "m/s", "m_s2": "m/s²", "rad": "rad", "rad_s": "rad/s", "rad_s2": "rad/s²", "s": "s", "ns": "ns",
    "ms": "ms", "us": "µs", "hz": "Hz", "n": "N", "kg": "kg", "kg_m2": "kg m²", "mah": "mAh", "a": "A", "1_s": "1/s",
    "n_s_m": "N s/m", "norm": "0 to 1", "deg": "deg", "v": "V", "fraction": "0 to 1", "share": "0 to 1",
}  # fmt: skip
FRAMES = {"lab": "lab", "lead": "lead", "flu": "body (flu)", "mocap": "camera axes"}


def table(head: Row, rows: Iterable[Row]) -> str:
    """A Markdown table; cells with a bar are escaped."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def unit_of(name: str) -> str:
    """The unit that a name ends in; a dash for none."""
    parts = name.split("_")
    for start in range(1, len(parts)):
        unit = UNITS.get("_".join(parts[start:]))
        if unit is not None:
            return unit
    return "-"


# Command lines

PROGRAMS = {
    "gcs": "gcs.cli.app:app",
    "drone-agent": "drone_agent.__main__:app",
    "gcs-sim": "sim.cli.app:app",
    "gcs-log": "sim.cli.log:app",
}
"""The console scripts, and where typer's description of each is."""


def named(where: str) -> Any:
    """What `module:name` is."""
    module, _, name = where.partition(":")
    return getattr(importlib.import_module(module), name)


def program(name: str) -> Any:
    """The command line of a console script, as click has it."""
    return typer.main.get_command(named(PROGRAMS[name]))


def commands(name: str) -> str:
    """Every command and option of a program, as typer documents them."""
    command = program(name)
    return get_docs_for_click(obj=command, ctx=typer.Context(command), name=name, indent=1)


def plain(text: str) -> str:
    """Help text in one paragraph a blank line."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def exit_codes(_: str = "") -> str:
    """What every program ends with."""
    rows = []
    for name in PROGRAMS:
        words = plain(program(name).epilog or "")
        codes = words.partition("Exit codes: ")[2].rstrip(".")
        rows += [(f"`{name}`", *code.strip().split(" ", 1)) for code in codes.split(";") if code.strip()]
    return table(("program", "code", "meaning"), rows)


# Configuration


def keys(which: str) -> str:
    """Every key of a configuration model, `module:Class [without TABLE]`, a section a table of the file.

    `module:Class alone`: its own table, without a heading; its page has those that it names.
    """
    where, _, without = which.partition(" without ")
    where, _, alone = where.partition(" ")
    first, *others = _sections(named(where), "", without)
    return first.partition("\n\n")[2] if alone else "\n\n".join((first, *others))


def _sections(model: Any, path: str, without: str = "") -> Iterator[str]:
    meanings = field_meanings(model)
    rows, inner = [], []
    for name, field in model.model_fields.items():
        nested, many = _nested(field.annotation)
        kind, limits = _type_text(field.annotation, field.metadata)
        if nested is not None and name != without:
            below = _path(path, name, many)
            inner.append((nested, below))
            kind = f"[table](#{_anchor(below)})"
        meaning = meanings.get(name) or ("" if nested is None else _first(nested))
        rows.append((f"`{name}`", kind, _unit(name, kind), _written(field), limits, meaning))
    title = f"`{path}`" if path else "Top level"
    yield f"## {title}\n\n{_first(model)}\n\n" + table(("key", "type", "unit", "default", "range", "meaning"), rows)
    for nested, below in inner:
        yield from _sections(nested, below)


def _unit(name: str, kind: str) -> str:
    return unit_of(name) if "number" in kind or "integer" in kind else "-"


def _path(path: str, name: str, many: str) -> str:
    whole = f"{path}.{name}" if path else name
    return f"{whole}[]" if many == "list" else f"{whole}.NAME" if many == "dict" else whole


def _anchor(heading: str) -> str:
    """Of a heading without blanks, as code hosts and the manual make it."""
    return re.sub(r"[^\w-]", "", heading.lower())


def _nested(annotation: Any) -> tuple[Any, str]:
    """The model inside an annotation, and whether it stands alone, in a list or under names."""
    if hasattr(annotation, "model_fields"):
        return annotation, ""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _nested(args[0])
    for arg in args:
        nested, many = _nested(arg)
        if nested is not None:
            return nested, "list" if origin is tuple else "dict" if origin is dict else many
    return None, ""


def _type_text(annotation: Any, metadata: Iterable[Any]) -> tuple[str, str]:
    """Type in words, and the bounds on it."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type_text(args[0], (*args[1:], *metadata))
    limits = _limits(metadata)
    if origin is Literal:
        return "one of", ", ".join(f'`"{a}"`' if isinstance(a, str) else f"`{a}`" for a in args)
    if origin in (Union, types.UnionType):
        inner = [a for a in args if a is not type(None)]
        pairs = [_type_text(a, ()) for a in inner]
        bounds = limits or "; ".join(filter(None, (p[1] for p in pairs)))
        return " or ".join(dict.fromkeys(p[0] for p in pairs)), bounds
    if origin is tuple:
        kind, bounds = _type_text(args[0], ())
        size = "list of" if args[-1] is Ellipsis else f"{len(args)} x"
        return f"{size} {kind}", limits or bounds
    if origin is dict:
        kind, bounds = _type_text(args[1], ())
        return f"table of {kind}", bounds
    if origin is list:
        return _type_text(args[0], metadata)
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return "one of", ", ".join(f'`"{a.value}"`' for a in annotation)
    names = {bool: "true or false", int: "integer", float: "number", str: "text", Path: "path"}
    return names.get(annotation, getattr(annotation, "__name__", "any value")), limits


CHECKS = {
    "_not_tiny": "", "_no_flag": "", "_unit": "unit quaternion, w first", "_tilt": "at most 1.2",
    "_globe": "latitude, longitude in degrees, altitude in metres", "_own_link": "`udp:HOST:PORT`, `udpin:HOST:PORT`",
    "_endpoint": "such as `tcp/127.0.0.1:7447`", "_host": "host name or IPv4 address",
    "_name": "letters, digits and `. _ -`, at most 64", "_preset": "a control preset",
}  # fmt: skip
"""What a validator of the models demands, by its function's name."""


def _limits(metadata: Iterable[Any]) -> str:
    words = []
    flat: list[Any] = []
    for item in metadata:
        flat += getattr(item, "metadata", None) or [item]
    for item in flat:
        for attribute, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
            bound = getattr(item, attribute, None)
            if bound is not None and abs(bound) != 1e6:
                words.append(f"{sign} {bound:g}")
        for attribute, text in (("min_length", "at least {}"), ("max_length", "at most {}")):
            size = getattr(item, attribute, None)
            if size is not None:
                words.append(text.format(size))
        function = getattr(getattr(item, "func", None), "__name__", "")
        if CHECKS.get(function):
            words.append(CHECKS[function])
    return ", ".join(dict.fromkeys(words))


def _written(field: Any) -> str:
    from pydantic import BaseModel
    from pydantic_core import PydanticUndefined

    if field.default is PydanticUndefined and field.default_factory is None:
        return "required"
    if field.default is None or field.default_factory is not None or isinstance(field.default, BaseModel):
        return "-"
    return f"`{written(field.default)}`"


def written(value: Any) -> str:
    """A value as in a TOML file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Enum):
        return f'"{value.value}"'
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return "[" + ", ".join(written(v) for v in value) + "]" if len(value) <= 8 else "[...]"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _first(model: Any) -> str:
    """The first paragraph of a class's docstring, without what explains single keys."""
    return plain((model.__doc__ or "").split("\n\n")[0])


def field_meanings(model: Any) -> dict[str, str]:
    """What each field is: the text under it in the class, or its clause `name: ...` in the class's docstring."""
    known: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not (dataclasses.is_dataclass(base) or hasattr(base, "model_fields")) or base.__module__ == "pydantic.main":
            continue
        known |= _clauses(base.__doc__ or "", list(getattr(base, "__annotations__", {})))
        known |= _documented(base)
    return {name: meaning[:1].upper() + meaning[1:] for name, meaning in known.items()}


def _clauses(doc: str, names: list[str]) -> dict[str, str]:
    found = [
        m
        for m in re.finditer(r"(?:^|(?<=[.;:] )|(?<=\n))((?:[a-z_0-9*]+, )*[a-z_0-9*]+)(?: \(\d\))?: ", plain(doc))
        if all(_matches(name.strip(), names) for name in m[1].split(","))
    ]
    text = plain(doc)
    out: dict[str, str] = {}
    for k, m in enumerate(found):
        end = found[k + 1].start() if k + 1 < len(found) else len(text)
        meaning = text[m.end() : end].strip().rstrip(";").strip()
        for name in m[1].split(","):
            out |= dict.fromkeys(_matches(name.strip(), names), meaning.replace("\n\n", " "))
    return out


def _matches(name: str, names: list[str]) -> list[str]:
    pattern = re.compile(re.escape(name).replace(r"\*", ".*") + "$")
    return [known for known in names if pattern.match(known)]


def _documented(model: Any) -> dict[str, str]:
    """Strings that stand under a field."""
    try:
        tree = ast.parse(inspect.cleandoc("\n" + inspect.getsource(model)))
    except (OSError, TypeError, SyntaxError):
        return {}
    out, before = {}, ""
    for node in tree.body[0].body:  # type: ignore[attr-defined]
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            before = node.target.id
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and before:
            out[before] = plain(str(node.value.value)).replace("\n\n", " ")
            before = ""
        else:
            before = ""
    return out


def profiles(_: str = "") -> str:
    """The shipped vehicles."""
    from formation.vehicle.profile import PROFILES

    rows = (
        (
            f"`{p.name}`", f"{p.mass_kg * 1000:g}", f"{p.wheelbase_m * 1000:g}", f"{p.hover_thrust_norm:.2f}",
            f"{p.response_dead_time_s:g} + {p.response_lag_s:g}", f"{p.thrust_dead_time_s:g} + {p.thrust_lag_s:g}",
            f"{p.rate_max_rad_s:g}",
        )
        for p in PROFILES.values()
    )  # fmt: skip
    head = (
        "`profile`", "mass, g", "wheelbase, mm", "hover thrust, 0 to 1", "attitude dead time + lag, s",
        "thrust dead time + lag, s", "largest body rate, rad/s",
    )  # fmt: skip
    return table(head, rows)


def presets(_: str = "") -> str:
    """The control presets and the gains of their followers."""
    from formation.control.presets import PRESETS

    rows = (
        (f"`{p.name}`", type(p.follower).__name__.removesuffix("Gains").lower(), _gains(p.follower))
        for p in PRESETS.values()
    )
    return table(("`control_preset`", "law of a follower", "gains, horizontal axes"), rows)


def _gains(gains: Any) -> str:
    return ", ".join(
        f"{f.name} = {value.name if isinstance(value, Enum) else f'{value:g}'}"
        for f in dataclasses.fields(gains)
        if (value := getattr(gains, f.name)) or not isinstance(value, float)
    )


def trajectories(_: str = "") -> str:
    """The kinds of a trajectory, and the keys that each looks at."""
    from formation.trajectory_config import KINDS, TrajectoryConfig

    fields = TrajectoryConfig.model_fields
    rows = (
        (f"`{kind}`", ", ".join(f"`{key}` ({_written(fields[key])})" for key in fields if key in used.used))
        for kind, used in KINDS.items()
    )
    return table(("`kind`", "keys it uses (default)"), rows)


def shapes(_: str = "") -> str:
    """The named shapes."""
    from formation.guidance.patterns import PATTERNS

    rows = ((f"`{name}`", plain((make.__doc__ or "").split("\n\n")[0])) for name, make in PATTERNS.items())
    return table(("shape", "slots"), rows)


def scenarios(_: str = "") -> str:
    """The shipped scenarios."""
    from sim.shipped import about, shipped

    return table(("scenario", "what it flies"), ((f"`{n}`", about(p)) for n, p in shipped().items()))


def fault_families(_: str = "") -> str:
    """The families of simulated faults."""
    from sim.faults.fault import FAMILIES

    rows = ((f"`{f.value}`", m.site.value, m.severity or "-") for f, m in FAMILIES.items())
    return table(("`family`", "where it acts", "`severity`"), rows)


# Topics and messages


def topics(_: str = "") -> str:
    """Every channel of a log: type, rate, and what a full queue does."""
    from formation.topics import ALL

    rows = (
        (f"`{t.name}`", f"[{t.type.__name__}](messages.md#{_anchor(t.type.__name__)})", f"{t.rate_hz:.3g}", str(t.drop))
        for t in ALL
    )
    return table(("topic", "message", "nominal rate, Hz", "when a queue is full"), rows)


def messages(_: str = "") -> str:
    """Every message of the log with its fields, their shape, unit and frame."""
    from formation import messages as spine
    from formation.topics import ALL

    kinds = dict.fromkeys([spine.RawFrame, *(t.type for t in ALL)])
    return "\n\n".join(_message(kind) for kind in kinds)


def _message(kind: Any) -> str:
    hints = get_type_hints(kind, include_extras=True)
    meanings = field_meanings(kind)
    rows = (
        (f"`{f.name}`", _shape(hints[f.name]), unit_of(f.name), _frame(f.name), meanings.get(f.name, ""))
        for f in dataclasses.fields(kind)
    )
    return f"## {kind.__name__}\n\n{_first(kind)}\n\n" + table(("field", "type", "unit", "frame", "meaning"), rows)


def _shape(hint: Any) -> str:
    if get_origin(hint) is Annotated:
        layout = next((m for m in get_args(hint)[1:] if hasattr(m, "shape")), None)
        if layout is not None:
            sides = " x ".join("n or m" if side == -1 else str(side) for side in layout.shape)
            return f"{layout.scalar.__name__.rstrip('_')} ({sides})"
        hint = get_args(hint)[0]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return f"enum {hint.__name__}"
    if get_origin(hint) is tuple:
        return "list of text"
    return {int: "integer", float: "number", str: "text", bool: "flag", bytes: "bytes"}.get(hint, str(hint))


def _frame(name: str) -> str:
    if name.startswith("q_"):
        return name.removeprefix("q_").replace("_", " ")
    return next((frame for part, frame in FRAMES.items() if part in name.split("_")), "-")


# Safety


def guard_times(_: str = "") -> str:
    """The times by which the guard acts."""
    from drone_agent.guard.config import GuardConfig
    from drone_agent.guard.failsafe import LAND_AFTER_S, REST_NS

    defaults = GuardConfig()
    return table(
        ("time", "value, s", "where it is set"),
        (
            ("Setpoint silence before `HOLD`", f"{defaults.stale_setpoint_s:g}", "`stale_setpoint_s`"),
            ("`HOLD` before `LAND`, on an external pose", f"{LAND_AFTER_S:g}", "`stale_land_s`"),
            ("Rest after a stop before arming is possible", f"{REST_NS * 1e-9:g}", "fixed"),
        ),
    )


def events(_: str = "") -> str:
    """Every text said with a severity of WARNING or worse."""
    from formation.safety.rules_table import RULES

    rows = [(s.severity, f"`{s.text}`", f"`{s.file}`") for s in texts.warnings()[0]]
    rows += [(r.severity.name, f"`{r.fault if r.of_swarm else f'…: {r.fault}'}`", f"`{r.name}`") for r in RULES]
    order = {name: k for k, name in enumerate(texts.LOUD)}
    return table(("severity", "text", "source"), sorted(rows, key=lambda row: (order[row[0]], row[1])))


def rejections(_: str = "") -> str:
    """Why commands are refused and inputs dropped."""
    rows = [(s.severity, f"`{s.text}`", f"`{s.file}`") for s in (*texts.reasons(), *texts.rejected_inputs())]
    return table(("what happens", "reason", "source"), rows)


# MAVLink


def mavlink(_: str = "") -> str:
    """Which message ground, simulated drone and bridge send and accept."""
    from wire.mavlink.messages import TABLE

    readers = {row.layout.name for row in TABLE}
    accepted = {
        "ground": _ids("gcs.drones.telemetry", "READS", "READS_IF_ASKED"),
        "drone": _ids("drone_agent.link.inbox", "READS"),
        "bridge": _ids("drone_agent.guard.core", "FROM_GROUND", "FROM_AUTOPILOT", "SETPOINTS"),
    }
    sent = {
        "ground": _sent("gcs"),
        "drone": _sent("drone_agent/link", "drone_agent/core.py"),
        "bridge": _sent("drone_agent/guard"),
    }
    layouts = _layouts()
    names = sorted(readers.union(layouts.values()), key=_number)
    rows = []
    for name in names:
        kinds = {kind for kind, written_as in layouts.items() if written_as == name}
        number = _number(name)
        cells = [
            "/".join(filter(None, ("sends" if kinds & sent[who] else "", "accepts" if number in accepted[who] else "")))
            for who in accepted
        ]
        if any(cells):
            rows.append((f"{name} ({number})", *(cell.replace("/", ", ") or "-" for cell in cells)))
    return table(("message (id)", "ground", "simulated drone", "bridge, beside what it passes on"), rows)


def _number(name: str) -> int:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    return int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))


def _ids(module: str, *names: str) -> set[int]:
    found: set[int] = set()
    for name in names:
        found |= {int(number) for number in getattr(importlib.import_module(module), name, ())}
    return found


def _layouts() -> dict[str, str]:
    """The name in MAVLink of each message class that is written."""
    from wire.mavlink.messages import TABLE

    written = {row.kind.__name__: row.layout.name for row in reversed(TABLE) if row.write is not None}
    return written | {"StatusText": "STATUSTEXT"}


def _sent(*paths: str) -> set[str]:
    """Message classes that the modules there make."""
    kinds = set(_layouts()) | {"command_long"}
    found: set[str] = set()
    for relative in paths:
        path = ROOT / relative
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            made = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
            found |= made & kinds
    return found | ({"CommandLong"} if "command_long" in found else set())


def autopilot(name: str) -> str:
    """One autopilot: modes, telemetry asked for, parameters."""
    from drone_agent import autopilots as simulated
    from gcs.drones.autopilot_model import GROUND_MODELS
    from wire.link_messages import MessageId

    ground = next(m for m in GROUND_MODELS.values() if m.name.lower() == name.lower())
    sim = next(
        (m for m in vars(simulated).values() if getattr(m, "table", None) is ground.table),
        None,
    ) or next(
        m
        for group in vars(simulated).values()
        if isinstance(group, Mapping)
        for m in group.values()
        if getattr(m, "table", None) is ground.table
    )
    modes = ((number.name, number.label, f"{number.main}", f"{number.sub}") for number in ground.table.modes.values())
    asked = ((MessageId(number).name, f"{rate:g}") for number, rate in ground.streams)
    off = ", ".join(MessageId(number).name for number in ground.unread) or "none"
    default = (
        (MessageId(number).name if number in set(MessageId) else str(number), f"{rate:g}")
        for number, rate in sim.rates_hz.items()
    )
    rule_rows = (
        (
            f"`{r.name}`", r.wanted, f"{r.set_to:g}",
            "refuses to arm" if r.vital else "warns",
            r.why,
        )
        for r in ground.rules
    )  # fmt: skip
    parameters = (
        (f"`{s.name}`", f"{s.default:g}", f"{s.low:g} to {s.high:g}", s.meaning)
        for s in ground.table.parameters.values()
    )
    return "\n\n".join(
        (
            "### Parameters that a flight needs\n\n`gcs doctor --fix` writes the value of the third column.\n\n"
            + table(("parameter", "wanted", "`--fix` writes", "otherwise the ground", "why"), rule_rows),
            "### Telemetry that the ground asks for\n\n" + table(("message", "rate, Hz"), asked),
            f"On a direct link the ground switches off: {off}.",
            "### Modes\n\n" + table(("mode", "label", "main", "sub"), modes),
            "### Telemetry of the simulated drone, unasked\n\n" + table(("message", "rate, Hz"), default),
            "### Parameters of the simulated drone\n\n"
            + table(("parameter", "default", "range", "meaning"), parameters),
        )
    )


# Results


def results(vehicle: str) -> str:
    """The tables of the paper's experiments, from the figures that were flown."""
    from sim.research import paper_page
    from tools.figures import paper_tables

    flown = paper_tables.from_json(paper_tables.kept(vehicle).read_text(encoding="utf-8"))
    return paper_page.markdown(flown)


def import_quantities(_: str = "") -> str:
    """What a map of `gcs-log import` can name."""
    from analysis.imports.maps import QUANTITIES, Kind

    parts = {Kind.ATTITUDE: "4, or roll, pitch, yaw", Kind.WORLD: "3", Kind.BODY: "3"}
    rows = (
        (f"`{name}`", "any" if of.any else parts.get(of.kind, "1"), ", ".join(f"`{unit}`" for unit in of.units),
         f"`{of.name}`")
        for name, of in QUANTITIES.items()
    )  # fmt: skip
    return table(("quantity", "columns", "units, the first where none is named", "in tables"), rows)


def version(_: str = "") -> str:
    """The release that the manual describes."""
    from wire.version import VERSION

    return f"This manual describes version {VERSION}."


def extras(_: str = "") -> str:
    """The optional parts of the installation."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = (
        (f"`mavlink-formation[{name}]`", ", ".join(f"`{re.split('[>=<]', p)[0]}`" for p in packages))
        for name, packages in project["optional-dependencies"].items()
    )
    return table(("extra", "installs"), rows)


# Python


def api(which: str) -> str:
    """What `module:name` is called with, and its docstring; `with NAME ...`: and these methods, `with all`: and all."""
    where, _, chosen = which.partition(" with ")
    module, _, name = where.partition(":")
    found = named(where) if name else importlib.import_module(module)
    if not name:
        return inspect.getdoc(found) or ""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(found))).body
    parts = [f"### `{where.replace(':', '.')}`", _block(_called(node, name)), inspect.getdoc(found)]
    for method in getattr(node, "body", ()) if chosen else ():
        doc = ast.get_docstring(method) if isinstance(method, ast.FunctionDef) else None
        if doc and (method.name in chosen.split() or (chosen == "all" and not method.name.startswith("_"))):
            parts += [_block(_called(method, method.name)), doc]
    return "\n\n".join(filter(None, parts))


def _block(text: str) -> str:
    return f"```text\n{text}\n```"


def _called(node: ast.AST, name: str) -> str:
    """The call's own source: a function's arguments, or what makes an object of a class."""
    if isinstance(node, ast.FunctionDef):
        if any(getattr(decorator, "id", "") == "property" for decorator in node.decorator_list):
            return f".{name}: {ast.unparse(node.returns or ast.Constant(...))}"
        node.args.args = [argument for argument in node.args.args if argument.arg != "self"]
        arguments, returns = ast.unparse(node.args), "" if node.returns is None else f" -> {ast.unparse(node.returns)}"
        return f"{name}({arguments}){returns}"
    assert isinstance(node, ast.ClassDef)
    for method in node.body:
        if isinstance(method, ast.FunctionDef) and method.name == "__init__":
            method.returns = None
            return _called(method, name)
    fields = [ast.unparse(field) for field in node.body if isinstance(field, ast.AnnAssign)]
    shown = [f"    {field}," for field in fields if not field.startswith("_")]
    return "\n".join((f"{name}(", *shown, ")")) if shown else f"class {name}"


TABLES = {
    "rules": "formation.safety.rules_table:rules_markdown",
    "phases": "formation.safety.phases:table_markdown",
    "pose-validator": "mocap.validator:checks_markdown",
    "stages": "drone_agent.guard.stages:table_markdown",
    "guard-signatures": "drone_agent.guard.integrity:signatures_markdown",
    "allow-list": "drone_agent.guard.allow_list:allow_list_markdown",
}
"""By the name that a page uses, a function of the code that returns its table."""
PIECES: Mapping[str, Callable[[str], str]] = {
    piece.__name__.replace("_", "-"): piece
    for piece in (
        api, commands, exit_codes, keys, profiles, presets, trajectories, shapes, scenarios, fault_families, topics,
        messages, guard_times, events, rejections, mavlink, autopilot, results, import_quantities, version, extras,
        drawing.equations,
    )
}  # fmt: skip
"""By the name that a page uses."""
END = "<!-- end of what is generated -->"
MARK = re.compile(
    rf"^<!-- generated: (\S+)(?: ([^\n]*?))? -->$(?:(?:(?!^<!-- generated: ).)*?^{END}$)?", re.MULTILINE | re.DOTALL
)


def filled(text: str) -> str:
    """A page with every piece that it asks for in its place, anew."""
    return MARK.sub(lambda mark: f"{mark[0].splitlines()[0]}\n\n{_piece(mark[1], mark[2] or '')}\n\n{END}", text)


def _piece(name: str, argument: str) -> str:
    text = str(named(TABLES[name])()) if name in TABLES else PIECES[name](argument)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())
