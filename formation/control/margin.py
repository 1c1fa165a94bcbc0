"""How much more delay a loop can carry than it was designed for, measured on the very code that flies.

The vehicle is the controller's own model, a point that follows its commands after a dead time and a first-order lag,
with two differences: the dead time is longer, and there is no drag. Drag damps the loop, and a wind takes that
damping away. The margin is found by bisection on a kicked hover.
"""

from dataclasses import dataclass

import numpy as np

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig, MocapConfig
from formation.control.presets import Preset
from formation.control.stack import ControlStack
from formation.estimation.response import answer, no_history, remember
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import AttitudeTarget, LabFrame
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

KICK_M_S = 0.3
HOVER_S, SAMPLE_S = 6.0, 2.0
HELD_M = 0.1
"""A hover whose last seconds stay within this of its place is held."""
MARGIN_MOST_S = 0.2
RESOLUTION_S = 0.002
NEEDED_SHARE = 0.1
"""Of the loop's own delay: the least margin to fly with."""
START_NS = 1_000_000_000
OBSERVED, POINT_M = "margin-leader", np.array([0.0, 0.0, 1.0])
FAR = Fence(low_m=(-1e3, -1e3, -1e3), high_m=(1e3, 1e3, 1e3))


@dataclass(frozen=True, slots=True)
class DelayMargin:
    """loop_s: camera to attitude, as believed; margin_s: delay it carries on top, negative where it does not fly."""

    vehicle: str
    preset: str
    loop_s: float
    margin_s: float

    @property
    def needed_s(self) -> float:
        """The least margin to fly with."""
        return NEEDED_SHARE * self.loop_s

    @property
    def carried(self) -> bool:
        """Whether the vehicle's lag can carry the preset."""
        return self.margin_s >= self.needed_s

    def __str__(self) -> str:
        loop, need = 1e3 * self.loop_s, 1e3 * self.needed_s
        has = f"{1e3 * self.margin_s:.0f} ms" if self.margin_s >= 0.0 else "none"
        return (
            f"preset {self.preset} on {self.vehicle}: camera to attitude {loop:.0f} ms, "
            f"delay margin {has}, needed {need:.0f} ms"
        )


def is_carried(profile: VehicleProfile, gains: Preset, mocap: MocapConfig) -> bool:
    """Whether the vehicle's lag can carry the preset: a fifth of the time that its margin takes to find."""
    return held(profile, gains, mocap, NEEDED_SHARE * _loop_s(profile, mocap))


def _loop_s(profile: VehicleProfile, mocap: MocapConfig) -> float:
    return mocap.delay_s + profile.response_dead_time_s + profile.response_lag_s


def delay_margin(profile: VehicleProfile, gains: Preset, mocap: MocapConfig) -> DelayMargin:
    """The delay margin of a follower of this profile under these gains and cameras; takes about a second."""
    loop_s = _loop_s(profile, mocap)
    low, high = 0.0, MARGIN_MOST_S
    if not held(profile, gains, mocap, low):
        return DelayMargin(profile.name, gains.name, loop_s, -RESOLUTION_S)
    while high - low > RESOLUTION_S:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if held(profile, gains, mocap, middle) else (low, middle)
    return DelayMargin(profile.name, gains.name, loop_s, low)


def held(profile: VehicleProfile, gains: Preset, mocap: MocapConfig, extra_delay_s: float) -> bool:
    """Whether a kicked hover comes back although commands take extra_delay_s longer than believed."""
    path = kicked_hover(profile, gains, mocap, extra_delay_s, HOVER_S)
    late = path[-round(SAMPLE_S * mocap.rate_hz) :]
    return bool(np.isfinite(path).all() and np.abs(late - POINT_M).max() < HELD_M)


def kicked_hover(
    profile: VehicleProfile,
    gains: Preset,
    mocap: MocapConfig,
    extra_delay_s: float,
    duration_s: float,
    *,
    upwards: bool = False,
) -> Float:
    """Positions (frames, 3) of a vehicle that holds POINT_M and starts there with a speed, sideways or upwards."""
    profile = profile.model_copy(update={"drag_n_s_m": (0.0, 0.0, 0.0)})
    lab = LabConfig(
        profiles=(profile,),
        leader=LeaderConfig(body=OBSERVED, profile=profile.name),
        followers=(FollowerConfig(body="margin-follower", sysid=1, profile=profile.name, offset_m=(1.0, 0.0, 0.0)),),
        limits=LimitsConfig(fence=FAR, speed_m_s=100.0),
        mocap=mocap,
    )
    stack = ControlStack(lab, (profile, profile), gains)
    plan = Plan((Setpoint(Mode.LAB, (0.0, 0.0, 1.0), 0.0),), configured(lab))
    hover = np.array([profile.hover_thrust_norm])
    steps = round(duration_s * mocap.rate_hz)
    kick = np.array([0.0, 0.0, 1.0]) if upwards else np.array([1.0, 0.5, 0.0])
    pos, vel, force = POINT_M.copy(), KICK_M_S * kick, np.array([0.0, 0.0, GRAVITY_M_S2])
    sent = remember(no_history(1), START_NS - 10**9, np.array([[0.0, 0.0, GRAVITY_M_S2, GRAVITY_M_S2]]))
    speed, travel, weight = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, GRAVITY_M_S2])
    responses = (
        (slice(0, 2), profile.response_dead_time_s + extra_delay_s, profile.response_lag_s),
        (slice(2, 3), profile.thrust_dead_time_s + extra_delay_s, profile.thrust_lag_s),
    )
    path = np.full((steps, 3), np.inf)
    t_ns = START_NS
    period_ns, delay_ns = round(1e9 / mocap.rate_hz), round(mocap.delay_s * 1e9)
    for k in range(steps):
        path[k] = pos
        if np.abs(pos - POINT_M).max() > 100.0:
            break
        frame = _frame(k, t_ns, pos, force)
        target = stack.step(t_ns + delay_ns, frame, plan, hover).target
        sent = remember(sent, t_ns + delay_ns, _specific_force(target, profile))
        step_s = period_ns * 1e-9
        for axes, dead_s, lag_s in responses:
            answer(
                sent[0].t_ns, sent[0].force[:, axes], t_ns, t_ns + period_ns, dead_s, lag_s,
                force[axes], speed[axes], travel[axes],
            )  # fmt: skip
        pos += step_s * vel + travel - 0.5 * step_s * step_s * weight
        vel += speed - step_s * weight
        t_ns += period_ns
    return path


def _frame(seq: int, t_ns: int, pos_lab_m: Float, force: Float) -> LabFrame:
    """The frame of perfect cameras: the body's z axis lies along its specific force."""
    z = force / np.linalg.norm(force)
    tilt = np.array([-z[1], z[0], 0.0])
    sine = float(np.linalg.norm(tilt))
    turn = tilt / sine * np.arctan2(sine, z[2]) if sine > 0.0 else tilt
    q = np.stack([frames.IDENTITY, frames.from_rotation_vector(turn)])
    bodies = (OBSERVED, "margin-follower")
    return LabFrame(seq, t_ns, bodies, np.stack([np.array([5.0, 5.0, 0.0]), pos_lab_m]), q, np.ones(2, dtype=np.bool_))


def _specific_force(target: AttitudeTarget, profile: VehicleProfile) -> Float:
    """The specific force (1, 4) that a target asks for, body rates counted as the attitude lead they are."""
    size = profile.thrust_n_of(float(target.thrust_norm[0])) / profile.mass_kg
    q = target.q_lab_from_flu[0]
    if profile.rate_feed_forward:
        lead = target.rate_flu_rad_s[0] * np.array([1.0, 1.0, 0.0]) / profile.attitude_p_1_s
        q = frames.multiply(q, frames.from_rotation_vector(lead))
    z = frames.rotate(q, np.array([0.0, 0.0, 1.0]))
    return np.array([[size * z[0], size * z[1], size * z[2], size]])
