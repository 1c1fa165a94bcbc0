"""What a quadcopter is, in numbers: the model of `[[profiles]]` in a lab file, the shipped ones, and their rigid body.

One model for both sides: the agent integrates it, the controller inverts it. Eq. (1) of the paper is its
small-rate form. Nothing here knows MAVLink, batteries' chemistry or the attitude loop
(drone_agent.simulation.attitude_loop).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from formation.maths.arrays import Float, Quat, Vec3
from formation.model import LARGEST, Flag, Model, Name, NoFlag, Positive, Vec3Tuple
from formation.names import unknown
from formation.vehicle import body
from formation.vehicle.body import GRAVITY_M_S2, rotor_reach_m, thrust_norm

NonNegative = Annotated[float, NoFlag, Field(ge=0.0, le=LARGEST)]
Fraction = Annotated[float, NoFlag, Field(ge=0.0, le=1.0)]
ROUNDING = 1e-9


class BatteryProfile(Model):
    """A LiPo pack: what it holds, and how much of the full thrust an empty pack still gives."""

    cells: Annotated[int, NoFlag, Field(ge=1, le=14)] = 1
    """Cells in series."""
    capacity_mah: Positive = 350.0
    """Capacity."""
    hover_current_a: Positive = 4.0
    """Current in hover."""
    empty_thrust_fraction: Annotated[float, NoFlag, Field(gt=0.0, le=1.0)] = 0.85
    """Share of the full thrust that an empty pack gives."""


class GainScale(Model):
    """How fast a vehicle's loops are flown, in units of gains made for the paper's vehicle; what `gcs-sim tune` finds.

    horizontal, vertical: rates of the horizontal and vertical laws (integral gains with the square; vertical its
    observer too); observer: bandwidth of the horizontal observer; compensation: share of dead time and lag compensated.
    """

    horizontal: Positive = 1.0
    observer: Positive = 1.0
    vertical: Positive = 1.0
    compensation: Positive = 1.0


class VehicleProfile(Model):
    """What a quadcopter is, and how its autopilot answers.

    The response_* pair is what the controller assumes of the path from a sent target to the attitude (link,
    autopilot, motors), the thrust_dead_time_s and thrust_lag_s pair likewise to the thrust; the rest is the
    body itself and is what a simulated drone integrates.
    """

    name: Name
    """Name by which vehicles refer to the profile."""
    mass_kg: Positive
    """Take-off mass."""
    inertia_kg_m2: Vec3Tuple
    """About x, y, z. A rigid body's largest is at most the sum of the other two (equal: a flat plate); see below."""
    impossible_inertia: Flag = False
    """Whether an inertia that no rigid body has is kept all the same: a publication's table, to be flown as printed."""
    wheelbase_m: Positive
    """Distance of motors across the centre."""
    rotor_radius_m: Positive
    """Radius of a propeller."""
    thrust_max_n: Positive
    """Collective thrust at thrust_norm 1."""
    thrust_curve: Fraction = 0.0
    """k of T/T_max = (1 - k) u + k u^2; 0 is linear."""
    yaw_torque_m: Positive
    """Rotor drag torque per newton of thrust."""
    motor_lag_s: Positive
    """Time constant of the motors."""
    drag_n_s_m: Vec3Tuple = (0.0, 0.0, 0.0)
    """Linear drag along the body axes."""
    ground_effect: NonNegative = 1.0
    """Factor on Cheeseman and Bennett's thrust gain near the floor; 0 switches it off."""
    attitude_p_1_s: Positive
    """Gain of the attitude loop for roll and pitch."""
    yaw_p_1_s: Positive
    """Gain of the attitude loop for yaw."""
    rate_p_1_s: Positive
    """Gain of the rate loop for roll and pitch."""
    rate_yaw_p_1_s: Positive
    """Gain of the rate loop for yaw."""
    rate_max_rad_s: Positive
    """Largest rate of roll and pitch."""
    rate_yaw_max_rad_s: Positive
    """Largest rate of yaw."""
    rate_feed_forward: Flag
    """Whether the autopilot adds the target's body rates to its own attitude loop (PX4 takes yaw's alone)."""
    command_delay_s: NonNegative
    """Inside the vehicle: receipt of a target -> attitude loop."""
    response_dead_time_s: NonNegative
    """Dead time from a sent attitude target to the attitude."""
    response_lag_s: Positive
    """First-order lag after that dead time."""
    thrust_dead_time_s: NonNegative
    """Dead time from a sent thrust to the thrust."""
    thrust_lag_s: Positive
    """First-order lag after that dead time."""
    battery: BatteryProfile = BatteryProfile()
    """The LiPo pack."""
    gain_scale: GainScale | None = None
    """As tuned; None: by the response's own length (formation.control.presets)."""

    @model_validator(mode="after")
    def _of_a_body(self) -> "VehicleProfile":
        largest, total = max(self.inertia_kg_m2), sum(self.inertia_kg_m2)
        if min(self.inertia_kg_m2) <= 0.0:
            raise ValueError(f"inertia_kg_m2 must be positive, got {self.inertia_kg_m2}")
        if largest > (total - largest) * (1.0 + ROUNDING) and not self.impossible_inertia:
            raise ValueError(
                f"no body has inertia_kg_m2 = {self.inertia_kg_m2}: the largest is more than the sum of the other two "
                "(impossible_inertia = true flies it all the same)"
            )
        return self

    @property
    def weight_n(self) -> float:
        """Thrust that hovers."""
        return self.mass_kg * GRAVITY_M_S2

    @property
    def drag_1_s(self) -> Vec3:
        """Drag over mass along the axes of `lab`, 1/s, of a nearly level vehicle; x and y: mean of both body axes."""
        x, y, z = self.drag_n_s_m
        return np.array([0.5 * (x + y), 0.5 * (x + y), z]) / self.mass_kg

    @property
    def reach_m(self) -> float:
        """See formation.vehicle.body."""
        return rotor_reach_m(self.wheelbase_m)

    @property
    def width_m(self) -> float:
        """From rotor tip to rotor tip."""
        return self.wheelbase_m + 2.0 * self.rotor_radius_m

    @property
    def turn_1_m(self) -> float:
        """Angular acceleration about x or y, rad/s^2, per m/s^2 of thrust on one side instead of the other."""
        return self.reach_m * self.mass_kg / max(self.inertia_kg_m2[0], self.inertia_kg_m2[1])

    @property
    def hover_thrust_norm(self) -> float:
        """thrust_norm that hovers, away from the floor."""
        return self.thrust_norm_of(self.weight_n)

    def thrust_norm_of(self, thrust_n: float) -> float:
        """The thrust_norm that gives `thrust_n`, clipped to 0..1; inverts the thrust curve."""
        return thrust_norm(min(max(thrust_n / self.thrust_max_n, 0.0), 1.0), self.thrust_curve)

    def thrust_n_of(self, norm: float) -> float:
        """Collective thrust, N, of `norm` clipped to 0..1, on a full battery."""
        u = min(max(norm, 0.0), 1.0)
        return self.thrust_max_n * ((1.0 - self.thrust_curve) * u + self.thrust_curve * u * u)

    @cached_property
    def numbers(self) -> Float:
        """The parameters where the kernels look for them (`formation.vehicle.body`)."""
        numbers = np.empty(body.NUMBERS)
        numbers[body.MASS] = self.mass_kg
        numbers[body.INERTIA : body.INERTIA + 3] = self.inertia_kg_m2
        numbers[body.WHEELBASE] = self.wheelbase_m
        numbers[body.ROTOR_RADIUS] = self.rotor_radius_m
        numbers[body.THRUST_MAX] = self.thrust_max_n
        numbers[body.THRUST_CURVE] = self.thrust_curve
        numbers[body.YAW_TORQUE] = self.yaw_torque_m
        numbers[body.MOTOR_LAG] = self.motor_lag_s
        numbers[body.DRAG : body.DRAG + 3] = self.drag_n_s_m
        numbers[body.GROUND_EFFECT] = self.ground_effect
        numbers[body.ATTITUDE_P] = self.attitude_p_1_s
        numbers[body.YAW_P] = self.yaw_p_1_s
        numbers[body.RATE_P] = self.rate_p_1_s
        numbers[body.RATE_YAW_P] = self.rate_yaw_p_1_s
        numbers[body.RATE_MAX] = self.rate_max_rad_s
        numbers[body.RATE_YAW_MAX] = self.rate_yaw_max_rad_s
        numbers[body.RATE_FEED_FORWARD] = float(self.rate_feed_forward)
        return numbers

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> "VehicleProfile":  # noqa: ARG002
        """A changed profile, validated afresh (pydantic's own copy would check nothing and keep old `numbers`)."""
        return VehicleProfile.model_validate({**self.model_dump(), **(update or {})})


PAPER_40G = VehicleProfile(
    name="paper_40g",
    mass_kg=0.04,
    inertia_kg_m2=(1.532e-5, 1.532e-5, 2.9e-5),
    wheelbase_m=0.12,
    rotor_radius_m=0.025,
    thrust_max_n=0.8,
    thrust_curve=0.5,
    yaw_torque_m=0.01,
    motor_lag_s=0.025,
    drag_n_s_m=(0.006, 0.006, 0.008),
    attitude_p_1_s=11.0,
    yaw_p_1_s=5.0,
    rate_p_1_s=35.0,
    rate_yaw_p_1_s=12.0,
    rate_max_rad_s=10.0,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=True,
    command_delay_s=0.002,
    response_dead_time_s=0.049,
    response_lag_s=0.049,
    thrust_dead_time_s=0.01,
    thrust_lag_s=0.025,
)
"""The paper's vehicle with an inertia that a body of its size can have: Table 1 with the exponent one lower.

As printed (1.532e-4, 1.532e-4, 3.472e-4) it cannot exist:
- Jzz > Jxx + Jyy = 3.064e-4, but Jxx + Jyy - Jzz is twice the sum of m z^2, which nothing makes negative;
- its radius of gyration sqrt(Jxx / m) = 62 mm is longer than the arm, 60 mm, beyond which there is only propeller;
- with all of the mass at the four rotors, the most that an X of 60 mm arms can have, Jxx would be m (arm sin 45)^2 =
  0.04 * 0.0424^2 = 7.2e-5, half of it, and Jzz twice that, 1.44e-4.
So 1.532e-5 (20 mm about x and y: battery and board in the middle, motors on the arms) and 2.9e-5 for Jzz, a little
less than Jxx + Jyy, as of a flat vehicle; the printed Jzz over ten would still be more than that sum. All else is as
printed, or assumed. response_* are what `gcs-log identify` finds in a flight of it, and the same for both, since the
rate loop of the simulated autopilot asks for torque in proportion to the inertia: the two vehicles differ in how fast
the motors can turn them at all (1,090 and 109 rad/s^2 with all of the weight on one side).
"""
PAPER_40G_PRINTED = PAPER_40G.model_copy(
    update={"name": "paper_40g_printed", "inertia_kg_m2": (1.532e-4, 1.532e-4, 3.472e-4), "impossible_inertia": True}
)
"""The same with Table 1's inertia as printed, which no body has: what the gains of the first releases were made for."""
PX4_QUAD = VehicleProfile(
    name="px4_quad",
    mass_kg=1.0,
    inertia_kg_m2=(0.01325, 0.01325, 0.0159),
    wheelbase_m=0.3,
    rotor_radius_m=0.0635,
    thrust_max_n=20.0,
    thrust_curve=0.0,
    yaw_torque_m=0.0106,
    motor_lag_s=0.05,
    drag_n_s_m=(1.0, 1.0, 1.0),
    attitude_p_1_s=6.5,
    yaw_p_1_s=2.8,
    rate_p_1_s=15.0,
    rate_yaw_p_1_s=2.7,
    rate_max_rad_s=3.8,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.01,
    response_dead_time_s=0.105,
    response_lag_s=0.065,
    thrust_dead_time_s=0.01,
    thrust_lag_s=0.06,
    battery=BatteryProfile(cells=4, capacity_mah=3300.0, hover_current_a=12.0),
)
"""PX4's own simulation, SIH, of a quadcopter.

From PX4's sources (v1.16, modules/simulation/simulator_sih): mass, full thrust (SIH_MASS, four times SIH_T_MAX), drag
(SIH_KDV: 1 N s/m, more than most vehicles have), motors (SIH_T_TAU), attitude and yaw gain (MC_ROLL_P 6.5, MC_YAW_P
2.8; from v1.17 on MC_ROLL_P is 4.0: identify such a vehicle). Yaw's rate gain: MC_YAWRATE_P (0.2) times what SIH's
torque turns its inertia by (four SIH_Q_MAX over SIH_IZZ): a slow yaw. Size: of a lab's vehicle, and
inertia and yaw torque with it, so that it turns as SIH's does. Rate gain, response_* and thrust_*: as `gcs-log
identify` finds them in its flights over loopback UDP.
"""
ARDUCOPTER_QUAD = VehicleProfile(
    name="arducopter_quad",
    mass_kg=3.0,
    inertia_kg_m2=(0.023, 0.023, 0.046),
    wheelbase_m=0.35,
    rotor_radius_m=0.175,
    thrust_max_n=79.5,
    thrust_curve=0.0,
    yaw_torque_m=0.05,
    motor_lag_s=0.02,
    drag_n_s_m=(0.7, 0.7, 0.7),
    attitude_p_1_s=6.7,
    yaw_p_1_s=6.7,
    rate_p_1_s=29.0,
    rate_yaw_p_1_s=12.0,
    rate_max_rad_s=10.0,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=True,
    command_delay_s=0.01,
    response_dead_time_s=0.055,
    response_lag_s=0.108,
    thrust_dead_time_s=0.02,
    thrust_lag_s=0.02,
    battery=BatteryProfile(cells=3, capacity_mah=3300.0, hover_current_a=12.0),
)
"""ArduCopter with its default gains, on the default frame of its own simulator.

Measured on ArduCopter 4.6 and 4.7-dev (SITL): it hovers at 0.37, from which full thrust follows. `gcs-log identify` of
a line and a circle of two of them (4.7-dev): hover thrust 0.370 to 0.372, attitude gain 6.2 to 6.6 1/s, body rates
taken to 0.93 to 0.96, attitude lag 0.14 s after 0.015 s of dead time; 0.108 after 0.055 s, below, is as late.
From ArduPilot's sources: mass, size, inertia and momentum drag (SITL/SIM_Frame, its default model); 1 / ATC_INPUT_TC
(0.15 s) for attitude and yaw gain; ATC_RAT_RLL_P (0.135) on that frame for the rate gain; GUIDED adds a target's body
rates (mode_guided, input_quaternion); thrust is linearised by MOT_THST_EXPO.
Derived: response_dead_time_s and response_lag_s, which are what `gcs-log identify` finds where the simulated drone
flies with these gains. Assumed: the delays of command and thrust, 0.02 s for ArduPilot's 20 Hz filters in the place of
a motor lag, and what turns it about its own axis, as of px4_quad.
"""
CRAZYFLIE_27G = VehicleProfile(
    name="crazyflie_27g",
    mass_kg=0.027,
    inertia_kg_m2=(2.3951e-5, 2.3951e-5, 3.2347e-5),
    wheelbase_m=0.092,
    rotor_radius_m=0.0231,
    thrust_max_n=0.596,
    thrust_curve=0.57,
    yaw_torque_m=0.006,
    motor_lag_s=0.03,
    drag_n_s_m=(0.0056, 0.0056, 0.0063),
    attitude_p_1_s=6.0,
    yaw_p_1_s=6.0,
    rate_p_1_s=35.0,
    rate_yaw_p_1_s=12.0,
    rate_max_rad_s=10.0,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.005,
    response_dead_time_s=0.048,
    response_lag_s=0.124,
    thrust_dead_time_s=0.01,
    thrust_lag_s=0.03,
    battery=BatteryProfile(cells=1, capacity_mah=250.0, hover_current_a=2.1),
)
"""A Crazyflie 2.x, or what is built like one.

Mass, inertia, rotor radius and thrust to weight (2.25): gym-pybullet-drones' cf2p.urdf, after Landry (MIT 2015).
Thrust curve (2.130e-11 of the command squared beside 1.033e-6 of it, at 65535), yaw torque and rotor drag (9.18e-7 and
10.31e-7 N s/m per rad/s, at the 6060 rad/s of four hovering rotors): Foerster, "System Identification of the Crazyflie
2.0", ETH 2015. Wheelbase (92 mm), battery and its 7 minutes: Bitcraze's datasheet. Attitude and yaw gain: Bitcraze's
firmware (6.0). response_* are what `gcs-log identify` finds in a simulated flight with these gains. Assumed: rate
gains, limits, delays, motor lag.
"""
QUAD_250G = VehicleProfile(
    name="quad_250g",
    mass_kg=0.25,
    inertia_kg_m2=(2.6e-4, 2.6e-4, 4.7e-4),
    wheelbase_m=0.16,
    rotor_radius_m=0.038,
    thrust_max_n=7.4,
    thrust_curve=0.5,
    yaw_torque_m=0.01,
    motor_lag_s=0.025,
    drag_n_s_m=(0.04, 0.04, 0.05),
    attitude_p_1_s=6.5,
    yaw_p_1_s=2.8,
    rate_p_1_s=35.0,
    rate_yaw_p_1_s=12.0,
    rate_max_rad_s=3.8,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.01,
    response_dead_time_s=0.052,
    response_lag_s=0.113,
    thrust_dead_time_s=0.02,
    thrust_lag_s=0.025,
    battery=BatteryProfile(cells=3, capacity_mah=650.0, hover_current_a=5.0),
)
"""A 250 g quadcopter with 3-inch propellers that runs PX4: a class, not one make. Measure yours.

Mass: the class. Wheelbase and rotor radius: of 3-inch frames. Inertia: a radius of gyration of 0.4 arms, between
paper_40g's (0.33) and x500's (0.42), and 0.9 of the sum of two for the third. Attitude and yaw gain, rate limits:
PX4's defaults (MC_ROLL_P 6.5, MC_YAW_P 2.8, MC_ROLLRATE_MAX 220 degrees/s, MC_YAWRATE_MAX 200). response_* as of
crazyflie_27g. Assumed: thrust of three times the weight, its curve, drag, rate gains, delays, motor lag, battery.
"""
X500 = VehicleProfile(
    name="x500",
    mass_kg=2.0,
    inertia_kg_m2=(0.0217, 0.0217, 0.04),
    wheelbase_m=0.5,
    rotor_radius_m=0.127,
    thrust_max_n=34.2,
    thrust_curve=1.0,
    yaw_torque_m=0.016,
    motor_lag_s=0.025,
    drag_n_s_m=(0.3, 0.3, 0.3),
    attitude_p_1_s=6.5,
    yaw_p_1_s=2.8,
    rate_p_1_s=25.0,
    rate_yaw_p_1_s=8.0,
    rate_max_rad_s=3.8,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.01,
    response_dead_time_s=0.065,
    response_lag_s=0.102,
    thrust_dead_time_s=0.02,
    thrust_lag_s=0.025,
    battery=BatteryProfile(cells=4, capacity_mah=5000.0, hover_current_a=16.0),
)
"""Holybro's X500 with PX4's default gains, as PX4's Gazebo model has it.

Mass, inertia, thrust (four rotors of 8.549e-6 N s^2 at 1000 rad/s, quadratic in what is sent), yaw torque (0.016 m) and
motor lag (0.0125 s up, 0.025 down: the slower): PX4-gazebo-models, x500 and x500_base. Wheelbase, 10-inch propellers,
battery: Holybro's pages. Gains and rate limits: PX4's defaults, as of quad_250g. response_* as of crazyflie_27g.
Assumed: drag, rate gains, delays.
"""
PROFILES: Mapping[str, VehicleProfile] = MappingProxyType(
    {p.name: p for p in (PAPER_40G, PAPER_40G_PRINTED, PX4_QUAD, ARDUCOPTER_QUAD, CRAZYFLIE_27G, QUAD_250G, X500)}
)


def profile(name: str, own: Iterable[VehicleProfile] = ()) -> VehicleProfile:
    """The profile of that name, a lab's `own` before the shipped ones; ValueError names the known ones."""
    known = {**PROFILES, **{p.name: p for p in own}}
    if name not in known:
        raise ValueError(f"unknown vehicle profile {unknown(name, known)}")
    return known[name]


def on_base(values: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a profile; with `base`, what they leave out is of that shipped profile. ValueError for another."""
    name = values.get("base")
    if name is None:
        return dict(values)
    if not isinstance(name, str) or name not in PROFILES:
        raise ValueError(f"no shipped profile {unknown(str(name), PROFILES)}")
    base = PROFILES[name].model_dump(exclude={"gain_scale"})
    whole = base | {key: value for key, value in values.items() if key != "base"}
    if isinstance(values.get("battery"), dict):
        whole["battery"] = base["battery"] | values["battery"]
    return whole


@dataclass(frozen=True, slots=True, eq=False)
class VehicleState:
    """One simulated vehicle; its origin stands on the floor, z = 0, when landed. Motors: FR, RL, FL, RR.

    x (17): all of it, laid out as the kernels have it (formation.vehicle.rigid_body); the rest are views of it.
    """

    x: Float

    @property
    def pos_lab_m(self) -> Vec3:
        """Position in `lab`."""
        return self.x[0:3]

    @property
    def vel_lab_m_s(self) -> Vec3:
        """Velocity in `lab`."""
        return self.x[3:6]

    @property
    def q_lab_from_flu(self) -> Quat:
        """Attitude."""
        return self.x[6:10]

    @property
    def rate_flu_rad_s(self) -> Vec3:
        """Body rate."""
        return self.x[10:13]

    @property
    def motor_thrust_n(self) -> Float:
        """Thrust of each motor; shape (4,)."""
        return self.x[13:17]


def at_rest(pos_lab_m: Float, q_lab_from_flu: Float, motor_thrust_n: float = 0.0) -> VehicleState:
    """A vehicle standing still, every motor at `motor_thrust_n`."""
    return VehicleState(np.concatenate([pos_lab_m, np.zeros(3), q_lab_from_flu, np.zeros(3), [motor_thrust_n] * 4]))


def on_ground(state: VehicleState) -> bool:
    """Whether the feet carry the vehicle: at the floor and not rising."""
    return bool(state.x[2] < 0.003 and abs(state.x[5]) < 0.05)
