"""A hand-made flight with known answers: a leader on a circle, two followers, chosen errors."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formation import topics
from formation.clock_pair import SIMULATED, ClockPair
from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import (
    AttitudeTarget,
    Command,
    Datagram,
    Event,
    LabFrame,
    LoopTiming,
    OperatorRequest,
    Phase,
    PhaseChange,
    Reference,
    Severity,
    SwarmState,
    Verb,
)
from formation.topics import Topic
from wire.link_messages import Address, Battery
from wire.logs.mcap_write import LogWriter
from wire.mavlink.codec import Codec

T0_NS = 5_000_000_000_000
RATE_HZ = 50.0
OFFSETS = np.array([[-0.4, -0.4, 0.0], [-0.4, 0.4, 0.0]])
LAB = LabConfig(
    name="bench",
    leader=LeaderConfig(body="lead", sysid=1),
    followers=(
        FollowerConfig(body="left", sysid=2, offset_m=(-0.4, -0.4, 0.0)),
        FollowerConfig(body="right", sysid=3, offset_m=(-0.4, 0.4, 0.0)),
    ),
)
METADATA = {"scenario": "synthetic", "seed": "7", "link": "zenoh", "lab": LAB.model_dump_json()}
PHASES = (
    (0.0, Phase.GROUND, ""),
    (1.0, Phase.ARMED, "operator"),
    (2.0, Phase.TAKEOFF, "operator"),
    (4.0, Phase.HOLD, "take-off done"),
    (6.0, Phase.FORMATION, "operator"),
    (16.0, Phase.LAND, "operator"),
    (19.0, Phase.GROUND, "all down"),
)
END_S = 20.0
START = ClockPair(T0_NS, 1_790_000_000_000_000_000)
"""Of a log in real time: 2026-09-21 14:13:20 UTC."""
ErrorLead = Callable[[float], Float]


@dataclass(frozen=True)
class Record:
    """What `wire.logs.mcap_read.Entry` holds."""

    topic: Topic
    t_ns: int
    message: object


@dataclass(frozen=True)
class Recipe:
    """What the flight is made of; error_lead(t_s) -> (2, 3) metres, in the leader's frame.

    leader_error(t_s) -> (3,): how far the leader is from its own reference, m, lab axes.
    """

    error_lead: ErrorLead = lambda t_s: np.zeros((2, 3))
    leader_error: Callable[[float], Float] = lambda t_s: np.zeros(3)
    leader_yaw_rate_rad_s: float = 0.0
    phases: tuple[tuple[float, Phase, str], ...] = PHASES
    requests: tuple[tuple[float, Verb], ...] = ((5.999, Verb.START), (15.999, Verb.LAND))
    blend_s: float = 2.0
    bodies: tuple[int, ...] = (2, 0, 1)  # the mocap's own order, not the configuration's
    metadata: Mapping[str, str] | None = None


def t_ns(t_s: float) -> int:
    return T0_NS + round(t_s * 1e9)


def written(
    path: Path,
    recipe: Recipe,
    metadata: Mapping[str, str] = METADATA,
    more: Iterable[Record] = (),
    start: ClockPair = SIMULATED,
) -> Path:
    """The flight and more records as a log; start: its clock, of simulated time if not given."""
    with LogWriter(path, dict(metadata), start=start, threaded=False, overwrite=True) as log:
        for record in sorted([*records(recipe), *more], key=lambda record: record.t_ns):
            log.write(record.topic, record.message, record.t_ns)
    return path


def shaken(t_s: float) -> Float:
    """The left follower swings by 2 mm, the right one stands 1 mm off."""
    return np.array([[0.002 * np.sin(9.0 * t_s), 0.0, 0.0], [0.0, 0.001, 0.0]])


def battery(at_ns: int, volts: float) -> Record:
    """The left drone reports its two cells."""
    data = Codec(Address(2, 1)).encode(Battery((4.0, volts), 1.0, 10.0, 0.75))
    return Record(topics.LINK_UP, at_ns, Datagram(2, data))


def phase_at(recipe: Recipe, t_s: float) -> Phase:
    return [phase for start, phase, _ in recipe.phases if start <= t_s][-1]


def records(recipe: Recipe, wrap: Callable[[int, object], Datagram] | None = None) -> Iterator[Record]:
    """Every record of the flight in time order; wrap makes MAVLink of a link message, for logs with traffic."""
    for start, phase, cause in recipe.phases:
        yield Record(topics.PHASE, t_ns(start), PhaseChange(phase, cause))
    for asked_s, verb in recipe.requests:
        yield Record(topics.REQUEST, t_ns(asked_s), OperatorRequest(1, verb))
    yield Record(topics.EVENT, t_ns(2.0), Event(Severity.NOTICE, "phase", "taking off"))
    yield Record(topics.EVENT, t_ns(14.0), Event(Severity.WARNING, "mocap", "body right unseen for 60 ms"))
    rng = np.random.default_rng(3)
    for seq in range(int(END_S * RATE_HZ)):
        yield from _cycle(recipe, seq, rng)


def _cycle(recipe: Recipe, seq: int, rng: np.random.Generator) -> Iterator[Record]:
    t_s = seq / RATE_HZ
    now_ns = t_ns(t_s) + 4_000_000
    pos, vel, acc, q = _world(recipe, t_s)
    names = tuple(vehicle.body for vehicle in LAB.vehicles)
    frame = LabFrame(seq, t_ns(t_s), names, pos, q, np.ones(3, dtype=np.bool_), now_ns - 200_000)
    yield Record(topics.MOCAP, now_ns, frame)
    zero, flat = np.zeros((3, 3)), np.zeros(3)
    yaw = frames.yaw(q)
    dist = 0.3 * np.sin(0.7 * t_s + np.arange(9).reshape(3, 3))
    yield Record(topics.STATE, now_ns, SwarmState(t_ns(t_s), pos, vel, dist, acc, q, yaw, flat, flat, flat, flat))
    yield Record(topics.REFERENCE, now_ns, _reference(recipe, t_s, pos, yaw))
    e = np.vstack([np.zeros((1, 3)), recipe.error_lead(t_s)])
    yield Record(topics.COMMAND, now_ns, Command(t_ns(t_s), e, zero, 4.0 * e, zero, zero, dist, acc, yaw, flat))
    thrust = np.full(3, 0.5) + 0.01 * rng.standard_normal(3)
    yield Record(topics.TARGET, now_ns, AttitudeTarget(t_ns(t_s), q, zero, thrust, flat, flat > 1.0))
    latency_s = 0.0008 + 0.0002 * float(rng.standard_gamma(2.0))
    yield Record(topics.TIMING, now_ns + 900_000, LoopTiming(seq, latency_s, seq % 250 == 249))


def _world(recipe: Recipe, t_s: float) -> tuple[Float, Float, Float, Float]:
    """Positions, velocities, accelerations and attitudes of the three, lab axes."""
    height = 0.3 * np.clip((t_s - 2.0) / 2.0, 0.0, 1.0) * np.clip((19.0 - t_s) / 3.0, 0.0, 1.0)
    angle = 2.0 * np.pi / 10.0 * max(t_s - 8.0, 0.0)
    leader = np.array([0.3 * np.cos(angle), 0.3 * np.sin(angle), height])
    yaw = recipe.leader_yaw_rate_rad_s * max(t_s - 6.0, 0.0)
    error = recipe.error_lead(t_s) if phase_at(recipe, t_s) is Phase.FORMATION else np.zeros((2, 3))
    followers = leader + frames.rotate_about_z(np.array(yaw), _slots(recipe, t_s) + error)
    pos = np.vstack([leader, followers])
    rate = 2.0 * np.pi / 10.0
    vel = np.tile([-rate * leader[1], rate * leader[0], 0.0], (3, 1))
    acc = np.tile([-(rate**2) * leader[0], -(rate**2) * leader[1], 0.0], (3, 1))
    q = frames.from_yaw(np.full(3, yaw))
    return pos, vel, acc, q


def _slots(recipe: Recipe, t_s: float) -> Float:
    """Slots blend in over blend_s from 0.1 m behind."""
    left = np.clip(1.0 - (t_s - 6.0) / recipe.blend_s, 0.0, 1.0) if recipe.blend_s > 0.0 else 0.0
    return OFFSETS - left * np.array([0.1, 0.0, 0.0])


def _reference(recipe: Recipe, t_s: float, pos: Float, yaw: Float) -> Reference:
    formed = phase_at(recipe, t_s) is Phase.FORMATION
    zero, flat = np.zeros((3, 3)), np.zeros(3)
    origin = np.vstack([np.zeros(3), pos[:1], pos[:1]]) if formed else zero
    heading = np.array([0.0, yaw[0], yaw[0]]) if formed else flat
    slot = np.vstack([pos[:1] - recipe.leader_error(t_s), _slots(recipe, t_s)]) if formed else pos
    moving = 6.0 <= t_s < 6.0 + recipe.blend_s
    slot_vel = np.vstack([np.zeros((1, 3)), np.full((2, 3), [0.05, 0.0, 0.0])]) if moving else zero
    in_formation = np.array([False, formed, formed])
    return Reference(t_ns(t_s), origin, zero, zero, heading, flat, flat, slot, slot_vel, zero, flat, flat, in_formation)
