"""What a quadcopter is, in numbers: the model of `[[profiles]]` in a lab file. Nothing here flies.

The shipped vehicles are formation.vehicle.profile's.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from formation.maths.arrays import Float, Vec3
from formation.model import LARGEST, Flag, Model, Name, NoFlag, Positive, Vec3Tuple
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
