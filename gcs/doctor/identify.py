"""Which drone is which: the mocap's bodies matched to the autopilots' system ids, by hand or by motors that idle.

By hand, the mocap says which body was lifted, and the attitude that an autopilot measures itself which autopilot was
tipped with it. By motors, the ground arms one drone alone, and the operator names the body whose motors turn.
"""

from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass
from math import dist

from formation.codes import Phase
from formation.config import LabConfig
from formation.requests import OperatorReply, Verb
from gcs.doctor.checks import MOVED_M, Snapshot, moved_bodies, tipped_sysids
from gcs.finding import Finding, Grade, graded, unmeasured, vehicle_key
from wire.ground_state import GroundState, decode

IDLE_S, DISARM_S = 4.0, 5.0
IDENTITY = "identity"

Report = Callable[[str], None]
GetSnapshot = Callable[[], Awaitable[Snapshot]]
Ask = Callable[[Verb, str], OperatorReply]
Answer = Callable[[float | None], str | None]
"""The operator's next line, without its end; None where none came within so many seconds, or none is to come."""


class StoppedError(RuntimeError):
    """It cannot go on, in words."""


@dataclass(frozen=True, slots=True)
class Identified:
    """What answered when vehicle `asked` was to: bodies by index, and system ids; one of each where it is decided."""

    asked: int
    bodies: tuple[int, ...] = ()
    sysids: tuple[int, ...] = ()


def judge(config: LabConfig, identified: Sequence[Identified]) -> tuple[Finding, ...]:
    """For each drone, the body and system id of the lab file and those found; a swap with the key to change."""
    return tuple(_judge(config, one) for one in identified)


def _judge(config: LabConfig, one: Identified) -> Finding:
    asked, found = config.vehicles[one.asked], _pair(config, one.bodies, one.sysids)
    wanted = _pair(config, (one.asked,), (asked.sysid,))
    if len(one.bodies) != 1 or len(one.sysids) != 1:
        return unmeasured(asked.body, IDENTITY, wanted, f"one drone was to answer, and it was: {found}", Grade.FAIL)
    (body,), (sysid,) = one.bodies, one.sysids
    vehicle, key = config.vehicles[body], vehicle_key(body, "sysid")
    why = f"system ids are swapped, this is one drone: write {key} = {sysid}, or change names or ids in the drones"
    if vehicle.sysid == sysid:
        why = "this is one drone, as in the lab file: another one was asked for, or its label is wrong"
    return graded(asked.body, IDENTITY, found, wanted, found == wanted, why)


def _pair(config: LabConfig, bodies: Iterable[int], sysids: Iterable[int | None]) -> str:
    names = " and ".join(config.vehicles[i].body for i in bodies)
    return f"{names or 'no body'}, system {' and '.join(map(str, sysids)) or '-'}"


async def by_hand(config: LabConfig, snapshot: GetSnapshot, most: int, report: Report) -> list[Identified]:
    """Have every commanded drone lifted in turn; most: snapshots of each at most, and until it is put down."""
    found = []
    for i in config.commanded:
        vehicle = config.vehicles[i]
        report(f"Lift {vehicle.body} (system {vehicle.sysid}), tip it by some thirty degrees, and put it down")
        one = await _lifted(config, i, snapshot, most, report)
        is_decided = len(one.bodies) == len(one.sysids) == 1
        report(("It is " if is_decided else "Not decided: ") + _pair(config, one.bodies, one.sysids))
        found.append(one)
    return found


async def _lifted(config: LabConfig, asked: int, snapshot: GetSnapshot, most: int, report: Report) -> Identified:
    before, bodies, sysids = await snapshot(), set[int](), set[int]()
    for _ in range(most):
        now = await snapshot()
        moved, tipped = moved_bodies(before, now), tipped_sysids(before, now)
        if len(moved) == len(tipped) == 1:
            bodies, sysids = set(moved), set(tipped)
            break
        if moved and not bodies:
            report(f"{_pair(config, moved, tipped)}: tip it until one of each has moved")
        bodies, sysids = bodies | set(moved), sysids | set(tipped)
    for _ in range(most):
        if not tipped_sysids(before, await snapshot()):
            break
    return Identified(asked, tuple(sorted(bodies)), tuple(sorted(sysids)))


def by_motors(config: LabConfig, ask: Ask, answer: Answer, report: Report) -> list[Identified]:
    """Have the ground arm each drone that takes part alone, in turn, as the operator agrees to. StoppedError.

    It is disarmed as soon as the operator has answered, anything has moved, or IDLE_S are over.
    """
    state = _state(ask)
    if state.phase is not Phase.GROUND:
        raise StoppedError(f"the ground is in {state.phase.name}: it has to be in GROUND")
    part = [drone.body for drone in state.drones if not drone.excluded]
    try:
        return [_turned(config, i, ask, answer, report) for i in config.commanded if config.vehicles[i].body in part]
    finally:
        ask(Verb.INCLUDE, ",".join(part))


def _turned(config: LabConfig, asked: int, ask: Ask, answer: Answer, report: Report) -> Identified:
    vehicle, names = config.vehicles[asked], [each.body for each in config.vehicles]
    report(f"Arm {vehicle.body} (system {vehicle.sysid}) alone, motors idling? Keep clear. Enter: yes, n and Enter: no")
    if answer(None) != "":
        return Identified(asked)
    try:
        reply = ask(Verb.ARM, vehicle.body)
        if not reply.accepted:
            raise StoppedError(f"{vehicle.body} was not armed: {reply.text}")
        line = _name_while_idling(ask, answer, report)
    finally:
        _disarm(ask)
    if not line:
        report("Disarmed. Whose motors turned?")
        line = answer(None)
    while line and line not in names:
        report(f"{line} is none of {', '.join(names)}: whose motors turned?")
        line = answer(None)
    return Identified(asked, (names.index(line),) if line else (), (vehicle.sysid or 0,))


def _name_while_idling(ask: Ask, answer: Answer, report: Report) -> str | None:
    """The operator's answer while the motors idle; None where none has come in time. StoppedError: a drone moved."""
    first = _state(ask)
    before = _positions(first)
    where = ", ".join(f"{body} at x {x:.1f}, y {y:.1f}" for body, (x, y, _) in before.items())
    report(f"Whose motors turn? Its name, and Enter, which ends it; {where}")
    now, line = first, None
    while line is None and now.t_s - first.t_s < IDLE_S:
        line, now = answer(0.1), _state(ask)
        there = _positions(now)
        moved = [body for body in before.keys() & there.keys() if dist(before[body], there[body]) > MOVED_M]
        if moved:
            raise StoppedError(f"{', '.join(moved)} moved: the motors were stopped")
    return line


def _disarm(ask: Ask) -> None:
    """Disarm what ARMED has armed, and wait for it; in any other phase somebody else flies. StoppedError."""
    state = first = _state(ask)
    if state.phase is Phase.ARMED:
        ask(Verb.LAND, "")
    while state.phase in (Phase.ARMED, Phase.GROUND) and (armed := [d.body for d in state.drones if d.armed]):
        if state.t_s - first.t_s > DISARM_S:
            raise StoppedError(f"{', '.join(armed)} is still armed: gcs stop")
        state = _state(ask)


def _state(ask: Ask) -> GroundState:
    return decode(ask(Verb.STATUS, "").text)


def _positions(state: GroundState) -> dict[str, tuple[float, float, float]]:
    return {drone.body: drone.pos_lab_m for drone in state.drones if drone.pos_lab_m is not None}
