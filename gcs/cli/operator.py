"""The operator's commands: each sends a request to the running ground over the lab's bus and prints the reply.

Nothing here loads the control, arrays or an event loop: an emergency stop waits for none of them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from formation.codes import Phase
from formation.guidance.shape_request import ShapeRequest
from formation.requests import (
    ANSWER_S,
    CONFIGURED,
    GCS_NAME,
    SYSID_MOST,
    OperatorReply,
    OperatorRequest,
    Verb,
    answer_s,
)
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.program import (
    Insecure,
    Json,
    Name,
    bodies_of,
    fail,
    keys_of,
    lab_near,
    print_error,
    starting,
    with_options,
)
from wire.process.system import NO_GROUND, NOT_RIGHT, REJECTED, own_name
from wire.text import number_text
from wire.transport.lab_address import address_near

if TYPE_CHECKING:
    from rich.console import Console

    from wire.ground_state import GroundState
    from wire.transport.zenoh_session import Patience

_COLUMNS = {
    "id": "", "body": "", "autopilot": "", "mode": "", "armed": "", "x": "m", "y": "m", "z": "m", "battery": "%",
    "behind": "ms", "heard": "s", "seen": "s",
}  # fmt: skip
_STEPS = (Verb.ARM, Verb.TAKE_CONTROL, Verb.TAKEOFF, Verb.START, Verb.RESUME, Verb.HOLD, Verb.LAND)

Lab = Annotated[Path | None, typer.Option("--lab", help="lab.toml, for its name and bus; without it the defaults.")]
Timeout = Annotated[
    float | None,
    typer.Option("--timeout", min=0.01, help="Seconds to wait, for a ground to come and for its answer."),
]

Identity = Annotated[
    str, typer.Option("--identity", help="In a lab with keys, as whom; `tool` or the only one there if not given.")
]


def offered_shapes(context: typer.Context, incomplete: str) -> list[str]:
    """The named patterns, and the shapes of the lab file."""
    from formation.guidance.patterns import PATTERNS  # loads arrays, which no command waits for

    lab = lab_near(context.params.get("lab"))
    return starting(dict.fromkeys((CONFIGURED, *PATTERNS, *keys_of(lab, "formation", "shapes"))), incomplete)


def offered_trajectories(context: typer.Context, incomplete: str) -> list[str]:
    """The leader's trajectories in the lab file."""
    lab = lab_near(context.params.get("lab"))
    return starting((CONFIGURED, *keys_of(lab, "leader", "trajectories")), incomplete)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Which ground is asked, as whom, and how long its answer is awaited; None: as long as is usual."""

    lab: Lab = None
    name: Name = GCS_NAME
    as_json: Json = False
    timeout: Timeout = None
    identity: Identity = ""
    insecure: Insecure = False


def offered_bodies(context: typer.Context, incomplete: str) -> list[str]:
    """The lab's bodies."""
    return starting(bodies_of(lab_near(context.params.get("lab"))), incomplete)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bodies(Ground):
    """Drones, and the ground that is asked about them."""

    bodies: Annotated[
        list[str], typer.Argument(metavar="BODY...", help="As the lab file names them.", autocompletion=offered_bodies)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Replace(Ground):
    """Whose place a spare takes, and the ground that is asked."""

    body: Annotated[
        str, typer.Argument(metavar="BODY", help="As the lab file names it.", autocompletion=offered_bodies)
    ]
    sysid: Annotated[int, typer.Option(min=1, max=SYSID_MOST, help="MAVLink system id of the spare.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Land(Ground):
    """Which drone is to land, and the ground that is asked."""

    body: Annotated[str, typer.Argument(metavar="[BODY]", help="One alone.", autocompletion=offered_bodies)] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Arm(Ground):
    """Who is to fly, and the ground that is asked."""

    fly_with: Annotated[
        str, typer.Option("--with", metavar="BODY,...", help="With these alone; without it all that are not left out.")
    ] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Start(Ground):
    """When the trajectory is to begin, and the ground that is asked."""

    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Form now, begin the trajectory then: 14:30:00 of today, +20 (seconds), or a date of ISO 8601.",
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shape(Ground):
    """A shape, and the ground that is asked for it."""

    shape_name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="Its name; a wrong one is answered by those known.", autocompletion=offered_shapes
        ),
    ]
    scale: Annotated[float, typer.Option(help="How much larger than usual.")] = 1.0
    heading: Annotated[float, typer.Option(metavar="DEG", help="Turned to the left about the leader by this.")] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trajectory(Ground):
    """A trajectory, and the ground that is asked for it."""

    trajectory_name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="Its name in lab.toml; a wrong one is answered by those known.",
            autocompletion=offered_trajectories,
        ),
    ]


def register(app: typer.Typer) -> None:
    """Add the commands, in the order of a flight."""
    app.command(Verb.STATUS.value)(status)
    app.command(Verb.EXCLUDE.value)(exclude)
    app.command(Verb.INCLUDE.value)(include)
    app.command(Verb.REPLACE.value)(replace)
    app.command(Verb.ARM.value)(arm)
    _register(app, Verb.TAKE_CONTROL, "Take control of drones that fly without a ground, and hold them where they are.")
    _register(app, Verb.TAKEOFF, "Take off to the configured height, then hold.")
    app.command(Verb.START.value)(start)
    _register(app, Verb.RESUME, "Take up the formation, and fly on along the trajectory that a hold interrupted.")
    app.command(Verb.SHAPE.value)(shape)
    app.command(Verb.TRAJECTORY.value)(trajectory)
    _register(app, Verb.HOME, "Lead every drone to above where it took off, without coming near each other; then land.")
    _register(app, Verb.HOLD, "Brake and stay where each drone is.")
    app.command(Verb.LAND.value)(land)
    _register(app, Verb.STOP, "EMERGENCY: cut every drone's motors now, wherever it is. `gcs reset` to fly again.")
    _register(app, Verb.ACKNOWLEDGE, "Acknowledge every alarm; those whose conditions go on stay shown until they end.")
    _register(app, Verb.RESET, "After a stop, back to GROUND; refused while any drone is armed or unheard.")


@with_options(Ground)
def status(ground: Ground) -> None:
    """Show the phase, every drone, and what keeps them from arming."""
    reply = ask_ground(Verb.STATUS, "", ground)
    if ground.as_json:
        print(reply.text)
    else:
        from rich.console import Console

        from wire.ground_state import decode

        try:
            print_status(decode(reply.text), Console())
        except ValueError as error:
            fail(str(error), NOT_RIGHT)


@with_options(_Bodies)
def exclude(asked: _Bodies) -> None:
    """Leave drones out, on the ground: the others fly without them, and their slots stay empty."""
    _command(Verb.EXCLUDE, ",".join(asked.bodies), asked)


@with_options(_Bodies)
def include(asked: _Bodies) -> None:
    """Take drones in again that were left out, and are ready to arm; in HOLD they rise alone and join."""
    _command(Verb.INCLUDE, ",".join(asked.bodies), asked)


@with_options(_Replace)
def replace(asked: _Replace) -> None:
    """On the ground, have a spare take a drone's place until the ground ends; the lab file stays as it is.

    Its guard is started first: drone-agent --lab LAB.TOML --body BODY --sysid N.
    """
    _command(Verb.REPLACE, f"{asked.sysid} {asked.body}", asked)


@with_options(_Land)
def land(asked: _Land) -> None:
    """Land where each drone is, and disarm there; refused only where all are down and disarmed.

    With BODY: that drone alone, beside the others' way, while they fly on.
    """
    _command(Verb.LAND, asked.body, asked)


@with_options(_Arm)
def arm(asked: _Arm) -> None:
    """Bring every drone to off-board mode and arm it; refused with every reason."""
    _command(Verb.ARM, asked.fly_with, asked)


@with_options(_Start)
def start(asked: _Start) -> None:
    """Take up the formation; a commanded leader then flies its trajectory."""
    _command(Verb.START, "" if asked.at is None else str(round(begin_unix_s(asked.at) * 1e9)), asked)


def begin_unix_s(text: str) -> float:
    """The date that a time in words means, s since 1970; typer.BadParameter for one that is none."""
    try:
        if text.startswith("+"):
            return clock.unix_us() * 1e-6 + float(text)
        now = datetime.now().astimezone()
        if "-" not in text:  # a time of today
            return datetime.combine(now, time.fromisoformat(text), tzinfo=now.tzinfo).timestamp()
        return datetime.fromisoformat(text).astimezone().timestamp()
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r}: {error}: 14:30:00, +20 or 2026-11-27T14:30:00", param_hint="--at"
        ) from None


@with_options(_Shape)
def shape(asked: _Shape) -> None:
    """Change the formation's shape, size or heading, in flight too; refused where drones would come too near."""
    _command(Verb.SHAPE, ShapeRequest(asked.shape_name, asked.scale, math.radians(asked.heading)).text, asked)


@with_options(_Trajectory)
def trajectory(asked: _Trajectory) -> None:
    """Choose which trajectory the leader flies at the next start; refused where it does not fit, or is flying one."""
    _command(Verb.TRAJECTORY, asked.trajectory_name, asked)


def _register(app: typer.Typer, verb: Verb, words: str) -> None:
    """The command of one verb that takes no argument."""

    @with_options(Ground)
    def ask(ground: Ground) -> None:
        _command(verb, "", ground)

    app.command(verb.command_name, help=words)(ask)


def _command(verb: Verb, argument: str, ground: Ground) -> None:
    reply = ask_ground(verb, argument, ground)
    if ground.as_json:
        print(json.dumps({"accepted": reply.accepted, "text": reply.text, "codes": reply.codes}))
    elif reply.accepted:
        print(reply.text)
    else:
        print_error("refused: " + reply.text.replace("; ", "\n         "))
    if not reply.accepted:
        raise typer.Exit(REJECTED)


def ask_ground(verb: Verb, argument: str, ground: Ground) -> OperatorReply:
    """The ground's answer to a request; ends the program where none comes, or the lab is not right."""
    from wire.transport.zenoh_session import ask

    request = OperatorRequest(clock.unix_us(), verb, argument, own_name())
    try:
        where = address_near(ground.lab)
        access = where.access(ground.identity, ground.insecure)
        return ask(where.endpoints, where.lab, ground.name, request, _patience(verb, ground.timeout), access)
    except TimeoutError as error:
        fail(f"no ground answers: {error}", NO_GROUND)
    except (BusError, ConfigError) as error:
        fail(str(error), NOT_RIGHT)


def _patience(verb: Verb, timeout_s: float | None) -> "Patience":
    from wire.transport.zenoh_session import Patience

    if timeout_s is not None:
        return Patience.throughout(timeout_s)
    if verb is Verb.STOP:  # is tried for as long as there is anybody on the bus
        return Patience(ANSWER_S, ground_s=ANSWER_S)
    return Patience(answer_s(verb))


def print_status(state: "GroundState", console: "Console") -> None:
    """The status for people."""
    from rich.table import Table
    from rich.text import Text

    from gcs.alarms import folded, style

    flown = "" if state.trajectory == CONFIGURED else f", trajectory {state.trajectory}"
    head = Text.assemble((state.phase.name, "bold"), f" ({state.cause}), shape {state.shape}{flown}")
    console.print(head.append(f", {state.left_out}", "bold yellow") if state.left_out else head)
    if state.not_landed:
        console.print(Text(f"not known to have landed: {', '.join(state.not_landed)}", "bold red"))
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column, unit in _COLUMNS.items():
        words = column == "body"  # it alone gives way where the terminal is narrow
        table.add_column(f"{column}\n{unit}", no_wrap=not words, overflow="fold", justify="right" if unit else "left")
    for drone in state.drones:
        mode = "left out" if drone.excluded else drone.mode
        position = ["-"] * 3 if drone.pos_lab_m is None else [f"{x:.2f}" for x in drone.pos_lab_m]
        cells = (
            str(drone.sysid), drone.body, drone.autopilot or "-", mode, "armed" if drone.armed else "-",
            *position, number_text(drone.battery, 100.0, 0), number_text(drone.link_behind_s, 1e3, 0),
            number_text(drone.heartbeat_age_s, 1.0, 1, "never"), number_text(drone.age_s, 1.0, 1, "never"),
        )  # fmt: skip
        table.add_row(*map(Text, cells))  # what drones and people said is never markup
    console.print(table)
    if state.log_trouble:
        console.print(Text(state.log_trouble, "red"))
    if state.lost_lines:
        console.print(f"{state.lost_lines} lines of the ground's output are lost: its log has them", style="yellow")
    for drone in state.drones:
        if drone.disarms_in_s is not None:
            text = f"{drone.body} disarms itself in {drone.disarms_in_s:.1f} s unless it takes off"
            console.print(text, style="yellow", highlight=False)
    for body, reason in state.rejected.items():
        console.print(Text(f"{body} is rejected by the mocap: {reason}", "red"))
    for reason in state.prearm_failures:
        console.print(Text(f"not ready: {reason}", "yellow"))
    standing, others = folded(state.alarms)
    for alarm in standing:
        console.print(Text(alarm.line, style(alarm)), no_wrap=True, overflow="ellipsis")
    if others:
        console.print(Text(f"alarms: {others}; gcs acknowledge takes them out", "dim"))
    for line in next_steps(state.phase, state.allowed):
        console.print(line, style="yellow", highlight=False, markup=False)


def next_steps(phase: Phase, allowed: Mapping[str, Sequence[str]]) -> list[str]:
    """The commands that are possible now; after a stop, why no reset is. allowed: the reasons against, by verb."""
    stopped = phase is Phase.STOPPED
    may = [f"gcs {verb.command_name}" for verb in ((Verb.RESET,) if stopped else _STEPS) if not allowed[verb]]
    if may:
        return [f"next: {', '.join(may)}"]
    return [f"no reset: {reason}" for reason in allowed[Verb.RESET]] if stopped else []
