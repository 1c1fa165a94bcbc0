"""A closed loop for tests: the control stack, true vehicles, cameras and links with delay; no sockets, no clock."""

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np

from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import advance
from formation.config import FollowerConfig, LabConfig, LeaderConfig, TrajectoryConfig
from formation.control.stack import ControlStack, Stages
from formation.guidance.plan import Plan
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import LabFrame
from formation.vehicle.profile import VehicleProfile, VehicleState, at_rest, profile

START_NS = 10**12
OFFSETS = ((-0.4, 0.4, 0.0), (-0.4, -0.4, 0.0))


def triangle(name: str = "paper_40g", path: TrajectoryConfig | None = None, preset: str = "default") -> LabConfig:
    return LabConfig(
        control_preset=preset,
        leader=LeaderConfig(body="L", sysid=1, profile=name, trajectory=path or TrajectoryConfig()),
        followers=tuple(
            FollowerConfig(body=f"F{k}", sysid=2 + k, profile=name, offset_m=offset) for k, offset in enumerate(OFFSETS)
        ),
    )


def hovering_at(body: VehicleProfile, pos_lab_m: tuple[float, float, float]) -> VehicleState:
    return at_rest(np.array(pos_lab_m), frames.IDENTITY, 0.25 * body.weight_n)


@dataclass(frozen=True)
class Sample:
    t_s: float
    truth: tuple[VehicleState, ...]
    stages: Stages


@dataclass(frozen=True)
class Room:
    """What surrounds the controller."""

    rate_hz: float = 100.0
    camera_delay_s: float = 0.008
    link_delay_s: float = 0.008
    noise_m: float = 1e-4
    noise_rad: float = 1e-3
    gap: tuple[float, float] = (0.0, 0.0)
    push: Callable[[int, float], Float] = lambda vehicle, t_s: np.zeros(3)


def fly(
    config: LabConfig,
    plan_at: Callable[[float], Plan],
    starts: tuple[VehicleState, ...],
    duration_s: float,
    room: Room = Room(),
    truth: tuple[VehicleProfile, ...] | None = None,
    seed: int = 1,
    without: frozenset[str] = frozenset(),
) -> list[Sample]:
    """Every vehicle commanded; one sample a frame."""
    believed = tuple(profile(v.profile) for v in config.vehicles)
    bodies = truth or believed
    stack = ControlStack(config, believed, without=without)
    hover = np.array([b.hover_thrust_norm for b in believed])
    rng, order = np.random.default_rng(seed), count()
    states = list(starts)
    reached = [0.0] * len(states)
    setpoints = [LoopSetpoint(s.q_lab_from_flu, np.zeros(3), b.thrust_norm_of(float(s.motor_thrust_n.sum())))
                 for s, b in zip(states, bodies, strict=True)]  # fmt: skip
    samples: list[Sample] = []
    names = tuple(v.body for v in config.vehicles)
    queue: list[tuple[float, int, Callable[[float], None]]] = []

    def at(t_s: float, event: Callable[[float], None]) -> None:
        heapq.heappush(queue, (t_s, next(order), event))

    def bring(k: int, t_s: float) -> None:
        while t_s - reached[k] > 1e-9:
            h = min(t_s - reached[k], 0.004)
            n = max(1, round(h / 0.001))
            states[k] = advance(states[k], bodies[k], setpoints[k], True, room.push(k, reached[k]), h / n, n)
            reached[k] += h

    def expose(t_s: float) -> None:
        for k in range(len(states)):
            bring(k, t_s)
        seen = tuple(states)
        pos = np.array([s.pos_lab_m for s in seen]) + room.noise_m * rng.standard_normal((len(seen), 3))
        shake = frames.from_rotation_vector(room.noise_rad * rng.standard_normal((len(seen), 3)))
        q = frames.multiply(np.array([s.q_lab_from_flu for s in seen]), shake)
        flags = np.ones(len(seen), dtype=np.bool_)
        frame = LabFrame(len(samples), START_NS + round(t_s * 1e9), names, pos, q, flags)
        if not room.gap[0] <= t_s < room.gap[1]:
            at(t_s + room.camera_delay_s, lambda now: control(now, t_s, frame, seen))
        at(t_s + 1.0 / room.rate_hz + 0.0005 * rng.uniform(-1.0, 1.0), expose)

    def control(now_s: float, t_s: float, frame: LabFrame, seen: tuple[VehicleState, ...]) -> None:
        stages = stack.step(START_NS + round(now_s * 1e9), frame, plan_at(t_s), hover)
        samples.append(Sample(t_s, seen, stages))
        for k, body in enumerate(bodies):
            target = stages.target
            sent = LoopSetpoint(target.q_lab_from_flu[k], target.rate_flu_rad_s[k], float(target.thrust_norm[k]))
            at(now_s + room.link_delay_s + body.command_delay_s, lambda then, k=k, sent=sent: obey(then, k, sent))

    def obey(t_s: float, k: int, sent: LoopSetpoint) -> None:
        bring(k, t_s)
        setpoints[k] = sent

    at(0.01, expose)
    while queue[0][0] < duration_s:
        t_s, _, event = heapq.heappop(queue)
        event(t_s)
    return samples


def slot_errors(samples: list[Sample], follower: int) -> Float:
    """True errors (k, 3) of a follower in its leader's frame."""
    errors = []
    for sample in samples:
        lead, mine = sample.truth[0], sample.truth[1 + follower]
        turn = -frames.yaw(lead.q_lab_from_flu)
        seen = frames.rotate_about_z(turn, mine.pos_lab_m - lead.pos_lab_m)
        errors.append(seen - sample.stages.reference.slot_lead_m[1 + follower])
    return np.array(errors)


def rms(errors: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(errors * errors, axis=1))))
