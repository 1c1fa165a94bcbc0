"""The way of one frame from camera bytes to SET_ATTITUDE_TARGET, as a drawing: each stop is a function that exists.

A stop whose module or name is gone fails `make reference`, so the drawing cannot show code of another day.
"""

import importlib
from html import escape

STAGES: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    (
        "mocap process",
        (
            ("camera bytes → RawFrame", "mocap.sources.vicon", "and the other sources/"),
            ("check size, order", "mocap.core:MocapCore", ""),
            ("camera axes → lab, flu", "mocap.alignment", "RawFrame → LabFrame"),
            ("check capture time", "mocap.validator:PoseValidator", ""),
            ("pose validator", "mocap.validator", "rejects impossible poses"),
            ("publish on the bus", "wire.transport.mocap_bus:MocapBus", "LabFrame"),
        ),
    ),
    (
        "ground: estimate and law",
        (
            ("frame starts the tick", "gcs.core:GcsCore", "LabFrame in"),
            ("what the drones reported", "gcs.safety:FactGatherer", "from gcs/drones/"),
            ("all stages in a row", "formation.control.stack:ControlStack", ""),
            ("observers, Eqs. (3)-(4)", "formation.estimation.update", "→ SwarmState"),
            ("leader as followed", "formation.guidance.followed_leader", ""),
            ("slots and paths", "formation.guidance.reference_generator", "→ Reference"),
            ("law, Eqs. (2), (5)-(7)", "formation.control.law", "→ Command"),
        ),
    ),
    (
        "ground: limits and link",
        (
            ("separation, speed, keep-out", "formation.control.limits.barriers:limit_demands", ""),
            ("fence, tilt, thrust → attitude", "formation.control.limits.attitude:attitude", "→ AttitudeTarget"),
            ("setpoint hold-off", "formation.control.limits.target:SetpointHoldOff", "after a rejected pose"),
            ("the autopilot's own level", "formation.control.limits.target:correct_level", ""),
            ("failsafe rules", "formation.safety.rules:assess", "may land or stop"),
            ("phase, each drone's goal", "gcs.flight:Flight", "next command, if any"),
            ("lab → NED, bytes", "wire.mavlink.codec:Codec", "SET_ATTITUDE_TARGET"),
        ),
    ),
    (
        "guard, beside the drone",
        (
            ("bytes from the bus", "wire.mavlink.codec:Codec", ""),
            ("setpoint filter: age, owner", "drone_agent.guard.setpoints:SetpointFilter", ""),
            ("stage table", "drone_agent.guard.stages:advance", "follow, hold, land"),
            ("bounds on what is followed", "drone_agent.guard.setpoints", ""),
            ("to the autopilot", "drone_agent.guard.core", "or the simulated one"),
        ),
    ),
)
"""The processes, and in each the stops: what happens, where (`module` or `module:name`), what comes out."""

WIDE, HIGH, GAP, TOP = 292, 62, 26, 40


def path_of(stop: str) -> str:
    """The file of a stop; LookupError where it, or the name in it, is gone."""
    module, _, name = stop.partition(":")
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise LookupError(f"the drawing of a frame's way names {stop}, which is gone") from error
    if name and not hasattr(found, name):
        raise LookupError(f"the drawing of a frame's way names {stop}, which is gone")
    return module.replace(".", "/") + ".py"


STYLE = (
    "svg { color: #666; font-family: sans-serif; } rect { fill: #f6f6f6; stroke: currentColor; } "
    "text { fill: #222; font-size: 14px; } .process { font-weight: bold; font-size: 17px; } "
    ".file { font-family: monospace; font-size: 11px; } .out { fill: #555; font-size: 12px; }"
)


def frame_path() -> str:
    """The drawing as SVG."""
    width = len(STAGES) * (WIDE + GAP) + GAP
    height = TOP + max(len(stops) for _, stops in STAGES) * (HIGH + GAP) + GAP
    parts = [
        f'<svg viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">',
        f"<style>{STYLE}</style>",
        "<title>The way of one frame from camera bytes to SET_ATTITUDE_TARGET</title>",
        '<defs><marker id="arrow" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        'orient="auto-start-reverse"><path d="M0,0 L10,5 L0,10 z" fill="currentColor"/></marker></defs>',
    ]
    for column, (process, stops) in enumerate(STAGES):
        x = GAP + column * (WIDE + GAP)
        parts.append(f'<text x="{x}" y="24" class="process">{escape(process)}</text>')
        for row, (what, stop, out) in enumerate(stops):
            y = TOP + row * (HIGH + GAP)
            parts += [
                f'<rect x="{x}" y="{y}" width="{WIDE}" height="{HIGH}" rx="6"/>',
                f'<text x="{x + 10}" y="{y + 20}" class="what">{escape(what)}</text>',
                f'<text x="{x + 10}" y="{y + 37}" class="file">{escape(path_of(stop))}</text>',
                f'<text x="{x + 10}" y="{y + 53}" class="out">{escape(out)}</text>',
            ]
            if row:
                parts.append(_line([(x + WIDE / 2, y - GAP), (x + WIDE / 2, y)]))
        if column + 1 < len(STAGES):
            bottom = TOP + len(stops) * (HIGH + GAP) - GAP
            middle, across = x + WIDE / 2, x + WIDE + GAP / 2
            points = [
                (middle, bottom),
                (middle, bottom + GAP / 2),
                (across, bottom + GAP / 2),
                (across, TOP + HIGH / 2),
            ]
            parts.append(_line([*points, (x + WIDE + GAP, TOP + HIGH / 2)]))
    return "\n".join((*parts, "</svg>")) + "\n"


def _line(points: list[tuple[float, float]]) -> str:
    path = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="currentColor" marker-end="url(#arrow)"/>'


EQUATIONS = (
    ("(1)", "Vehicle, on SO(3)", "formation.vehicle.rigid_body:body_step"),
    ("(1) inverted", "Attitude and thrust for a demand", "formation.control.limits.attitude:attitude"),
    ("(2)", "Relative frame", "formation.paper.eq2_relative_frame:lead_from_lab"),
    ("(3), (4)", "FTESO", "formation.paper.eq34_observer:fteso_step"),
    ("(5)", "Sliding variable", "formation.paper.eq56_super_twisting:sliding_variable"),
    ("(6)", "Super-twisting", "formation.paper.eq56_super_twisting:super_twisting"),
    ("(7)", "Composite law", "formation.paper.eq7_composite_law:composite_acceleration"),
)
"""The paper's equations, and the function that each is."""


def equations(_: str = "") -> str:
    """The table that maps equations to code."""
    rows = [
        f"| {number} | {what} | `{stop.partition(':')[2]}` | `{path_of(stop)}` |" for number, what, stop in EQUATIONS
    ]
    return "\n".join(("| equation | what | function | file |", "|---|---|---|---|", *rows))
