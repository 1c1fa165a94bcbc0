"""The whole stack where physics says what must come: the lab turned, the lab mirrored, and Eqs. (2) and (5)-(7).

Leaders turn and accelerate; x, y, z and yaw move by numbers of their own, frames come unevenly and some are missed.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig
from formation.control.gains import Law
from formation.control.presets import DEFAULT, GEOMETRIC, PAPER_CFC, PAPER_ISTSMC, PAPER_SMC, PID, Preset
from formation.control.stack import Stages
from formation.guidance.plan import IDLE, Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths import frames
from formation.vehicle.profile import ARDUCOPTER_QUAD, PAPER_40G, PX4_QUAD, VehicleProfile
from tests.formation.oracles.frames import rotation_matrix, to_lab, to_lead
from tests.formation.oracles.powers import super_twisting_backward
from tests.formation.rig import Look, flown

T0 = 50 * 10**9
SLOTS = ((-0.9, 0.7, 0.2), (-0.6, -0.8, -0.1))
YAWS = (0.3, -0.2)
PLACES = np.array([[0.35, 0.1, 1.2], [-0.7, 0.65, 1.45], [-0.2, -0.75, 1.0]])
ROOM = LimitsConfig(fence=Fence(low_m=(-6.0, -5.0, -0.2), high_m=(5.0, 7.0, 4.0)), tilt_rad=0.55, min_separation_m=0.25)
TIGHT = LimitsConfig(
    fence=Fence(low_m=(-0.75, -0.6, 0.9), high_m=(0.5, 0.75, 1.3)), tilt_rad=0.3, min_separation_m=0.9, speed_m_s=0.2
)
IN_SLOT = Setpoint(Mode.FORMATION, speed_m_s=0.6)
POINTS = (
    Setpoint(Mode.LAB, (0.8, None, 1.6), 0.4, 0.3),
    Setpoint(Mode.LAB, (None, -0.3, None), None, 0.8),
    Setpoint(Mode.LAB, (9.0, -9.0, 9.0), 2.5, 0.9),
)


def looks(size: float = 1.0) -> list[Look]:
    """Three bodies that swing along all axes, tilt and turn; stamps uneven, some frames without one body; pushes."""
    rng = np.random.default_rng(7)
    amplitude = size * rng.uniform(0.5, 1.0, (3, 3)) * [0.11, 0.07, 0.05]
    rate, phase = rng.uniform(2.0, 6.0, (3, 3)), rng.uniform(0.0, 6.0, (3, 3))
    yaw0, spin = rng.uniform(-3.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)
    out, t = [], T0
    for k in range(30):
        s = (t - T0) * 1e-9
        pos = PLACES + amplitude * (np.sin(rate * s + phase) - np.sin(phase)) + 2e-4 * rng.standard_normal((3, 3))
        tilt = 0.15 * size * np.sin(rate[:, :2] * s + 1.0)
        turn = np.column_stack([np.zeros((3, 2)), yaw0 + spin * s + 0.2 * np.sin(3.0 * s)])
        lean = np.column_stack([tilt, np.zeros(3)]) + 1e-3 * rng.standard_normal((3, 3))
        q = frames.multiply(frames.from_rotation_vector(turn), frames.from_rotation_vector(lean))
        seen, felt = np.ones(3, dtype=np.bool_), np.array([0.0, 0.0, 9.8]) + 0.3 * rng.standard_normal((3, 3))
        felt[1:] += np.array([[2.5, -1.5, 0.2], [0.0, 4.0, 0.5]]) * [[8 < k < 20], [k > 25]]
        felt[rng.uniform(size=3) < 0.1] = np.nan
        seen[rng.integers(3)] = k <= 5 or rng.uniform() > 0.3
        out.append(Look(t + int(rng.integers(6_000_000, 12_000_000)), t, pos, q, seen, felt))
        t += int(rng.integers(7_000_000, 14_000_000))
    return out


@dataclass(frozen=True)
class World:
    """A lab as it is; turned by a quarter to the left; or mirrored, so that y becomes -y and left becomes right."""

    turn_rad: float = 0.0
    mirrored: bool = False

    @property
    def side(self) -> float:
        return -1.0 if self.mirrored else 1.0

    def vectors(self, lab: np.ndarray) -> np.ndarray:
        c, s = round(np.cos(self.turn_rad)), round(np.sin(self.turn_rad))
        return lab @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) * [1.0, self.side, 1.0]

    def heading(self, yaw: np.ndarray) -> np.ndarray:
        return np.exp(1j * (self.side * np.asarray(yaw) + self.turn_rad))

    def attitudes(self, q: np.ndarray) -> np.ndarray:
        flipped = q * [1.0, self.side, 1.0, self.side]
        return frames.multiply(np.tile(frames.from_yaw(np.array(self.turn_rad)), (len(q), 1)), flipped)

    def look(self, k: Look) -> Look:
        return replace(k, pos=self.vectors(k.pos), q=self.attitudes(k.q), felt=k.felt * [1.0, self.side, 1.0])

    def goal(self, goal: Setpoint) -> Setpoint:
        kept = self.vectors(np.array([float(x is None) for x in goal.target_lab_m])) != 0.0
        wanted = self.vectors(np.array([x or 0.0 for x in goal.target_lab_m]))
        target = tuple(None if keeps else float(x) for x, keeps in zip(wanted, kept, strict=True))
        yaw = None if goal.yaw_rad is None else self.side * goal.yaw_rad + self.turn_rad
        return replace(goal, target_lab_m=target, yaw_rad=yaw) if goal.mode is Mode.LAB else goal

    def lab(self, sysid: int | None, limits: LimitsConfig) -> LabConfig:
        walls = self.vectors(np.array([limits.fence.low_m, limits.fence.high_m]))
        fence = Fence(low_m=tuple(walls.min(axis=0)), high_m=tuple(walls.max(axis=0)))
        followers = tuple(
            FollowerConfig(body=f"F{k}", sysid=k, offset_m=(x, self.side * y, z), yaw_offset_rad=self.side * yaw)
            for k, ((x, y, z), yaw) in enumerate(zip(SLOTS, YAWS, strict=True), 2)
        )
        leader = LeaderConfig(body="L", sysid=sysid)
        return LabConfig(leader=leader, followers=followers, limits=limits.model_copy(update={"fence": fence}))

    def messages(self, of: Stages, in_slot: list[bool]) -> dict[str, np.ndarray]:
        """Every number of every message of a tick, as it is here."""
        state, reference, command, target = of.state, of.reference, of.command, of.target
        flipped, slots = [1.0, self.side, 1.0], np.array(in_slot)[:, None]

        def lead(v: np.ndarray) -> np.ndarray:  # who is led to a point has the lab's own axes for a frame
            return np.where(slots, v * flipped, self.vectors(v))

        def heading(yaw: np.ndarray, turns: np.ndarray) -> np.ndarray:
            return np.where(turns, self.heading(yaw), np.exp(1j * self.side * yaw))

        return {
            **{f"state {name}": self.vectors(getattr(state, name)) for name in ("pos_lab_m", "vel_lab_m_s",
               "dist_lab_m_s2", "acc_lab_m_s2")},
            "yaw": self.heading(state.yaw_rad),
            "yaw rate": self.side * state.yaw_rate_rad_s,
            "yaw acceleration": self.side * state.yaw_acc_rad_s2,
            "mismatch": state.model_mismatch,
            **{name: lead(getattr(reference, name)) for name in ("slot_lead_m", "slot_vel_lead_m_s",
               "slot_acc_lead_m_s2")},
            **{name: self.vectors(getattr(reference, name)) for name in ("origin_lab_m", "origin_vel_lab_m_s",
               "origin_acc_lab_m_s2")},
            "slot yaw": heading(reference.slot_yaw_rad, ~slots[:, 0]),
            "heading": heading(reference.heading_rad, slots[:, 0]),
            **{name: self.side * getattr(reference, name) for name in ("slot_yaw_rate_rad_s", "heading_rate_rad_s",
               "heading_acc_rad_s2")},
            **{name: lead(getattr(command, name)) for name in ("e_lead_m", "e_rate_lead_m_s", "s_lead_m_s",
               "t_m_lead_m_s2", "z_m_lead_m_s2")},
            "u": self.vectors(command.acc_lab_m_s2),
            "commanded yaw": self.heading(command.yaw_rad),
            "commanded yaw rate": self.side * command.yaw_rate_rad_s,
            "attitude": np.array([rotation_matrix(q) for q in self.attitudes(target.q_lab_from_flu)]),
            "body rates": target.rate_flu_rad_s * [self.side, 1.0, self.side],
            "thrust": target.thrust_norm,
            "limits met": target.saturation,
        }  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Who flies what, how."""

    bodies: tuple[VehicleProfile, ...]
    gains: Preset
    goals: tuple[Setpoint, ...]
    sysid: int | None = 1
    limits: LimitsConfig = ROOM
    size: float = 1.0

    def fly(self, world: World, seen: list[Look]) -> list[Stages]:
        config, hover = world.lab(self.sysid, self.limits), np.array([1.1, 0.9, 1.2])[-len(self.goals) :]
        plan = Plan(tuple(world.goal(goal) for goal in self.goals), configured(config))
        hover = hover * [self.bodies[i].hover_thrust_norm for i in config.commanded]
        return flown(config, self.bodies, self.gains, plan, [world.look(k) for k in seen], hover)


STOUT = PAPER_40G.model_copy(
    update={"attitude_p_1_s": 9.0, "inertia_kg_m2": (9e-5, 1.2e-4, 2e-4), "rate_max_rad_s": 2.0}
)
LEADING, BEHIND_SEEN = (POINTS[0], IN_SLOT, IN_SLOT), (IN_SLOT, IN_SLOT)
CASES = {
    "paper's vehicles behind a leader": Case((PAPER_40G, STOUT, PAPER_40G), DEFAULT, LEADING),
    "PX4s behind a leader that is only seen": Case((PX4_QUAD,) * 3, DEFAULT, BEHIND_SEEN, None),
    "ArduCopters to points": Case((ARDUCOPTER_QUAD, PX4_QUAD, STOUT), DEFAULT, POINTS),
    "beside one idle": Case((PAPER_40G,) * 3, DEFAULT, (POINTS[1], IDLE, POINTS[1])),
    "printed CFC": Case((PAPER_40G,) * 3, PAPER_CFC, LEADING),
    "PID": Case((PAPER_40G, PX4_QUAD, PAPER_40G), PID, LEADING),
    "geometric": Case((PAPER_40G, PX4_QUAD, ARDUCOPTER_QUAD), GEOMETRIC, LEADING),
    "beside a wall, near each other, fast": Case((STOUT, PX4_QUAD, PAPER_40G), DEFAULT, POINTS, 1, TIGHT, 8.0),
}


@pytest.mark.parametrize("world", [World(turn_rad=0.5 * np.pi), World(mirrored=True)], ids=["turned", "mirrored"])
@pytest.mark.parametrize("name", CASES)
def test_a_lab_turned_or_mirrored_is_flown_as_it_was_but_turned_or_mirrored(name: str, world: World) -> None:
    """No axis has another's sign, frame or gain anywhere from frame to attitude target."""
    case, seen = CASES[name], looks(CASES[name].size)
    in_slot = [goal.mode is Mode.FORMATION for goal in case.goals]
    pairs = zip(case.fly(World(), seen), case.fly(world, seen), strict=True)
    for k, (one, other) in enumerate(pairs):
        expected, found = world.messages(one, in_slot), World().messages(other, in_slot)
        for message, numbers in expected.items():
            np.testing.assert_allclose(found[message], numbers, rtol=1e-6, atol=1e-6, err_msg=f"tick {k}: {message}")


def motion_of(body: int, stages: Stages) -> np.ndarray:
    """(3, 4) As estimated: position, velocity, acceleration of x, y, z and heading."""
    z, out = stages.state, np.empty((3, 4))
    out[:, :3] = z.pos_lab_m[body], z.vel_lab_m_s[body], z.acc_lab_m_s2[body]
    out[:, 3] = z.yaw_rad[body], z.yaw_rate_rad_s[body], z.yaw_acc_rad_s2[body]
    return out


@pytest.mark.parametrize("preset", [PAPER_CFC, PAPER_ISTSMC, PAPER_SMC], ids=lambda p: p.name)
def test_a_followers_command_is_eqs_2_and_5_to_7_of_what_is_known(preset: Preset) -> None:
    """Printed, so without lag compensation: of estimates and slots of the frame's own time, along x and y."""
    case, gains, seen = Case((PAPER_40G,) * 3, preset, BEHIND_SEEN, None), preset.follower, looks()
    memory, asked_ns = np.zeros((2, 2)), seen[0].now_ns
    for look, stages in zip(seen, case.fly(World(), seen), strict=True):
        dt_s, asked_ns = (look.now_ns - asked_ns) * 1e-9, look.now_ns
        command, reference, frame = stages.command, stages.reference, motion_of(0, stages)
        for i in range(2):
            slot, back, s, t_m = np.zeros((3, 4)), np.zeros(3), np.zeros(2), np.zeros(2)
            slot[:, :3] = reference.slot_lead_m[i], reference.slot_vel_lead_m_s[i], reference.slot_acc_lead_m_s2[i]
            e = to_lead(motion_of(1 + i, stages), frame) - slot
            for axis in range(2):
                reach_m = case.limits.speed_m_s / gains.c
                s[axis] = gains.c * np.clip(e[0, axis], -reach_m, reach_m) + e[1, axis]
                t_m[axis] = gains.k * np.sign(s[axis])
                if gains.law is not Law.SMC:
                    numbers = gains.p1, gains.p2, gains.eps, gains.smooth_m_s, dt_s
                    t_m[axis], _ = super_twisting_backward(s[axis], memory[i, axis], *numbers)
            back[:2] = -gains.c * e[1, :2] - t_m
            there = slot + e
            there[2, :3] = slot[2, :3] + back
            asked = to_lab(there, frame)[2, :2] - (gains.law is Law.CFC) * stages.state.dist_lab_m_s2[1 + i, :2]
            asked *= min(1.0, 11.7 / np.linalg.norm(asked))  # of gravity at 50 degrees
            for found, expected in (
                (command.e_lead_m, e[0, :2]), (command.e_rate_lead_m_s, e[1, :2]), (command.s_lead_m_s, s),
                (command.t_m_lead_m_s2, t_m), (command.acc_lab_m_s2, asked),
            ):  # fmt: skip
                np.testing.assert_allclose(found[i, :2], expected, atol=1e-6)
        memory = command.z_m_lead_m_s2[:, :2]
