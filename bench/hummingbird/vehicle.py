"""rotorpy's Hummingbird: as the ground believes it, and as rotorpy integrates it.

rotorpy (Folk, Paulos, Kumar, RotorPy: a Python-based multirotor simulator with aerodynamics, 2023) has its own body,
motors, rotor drag, translational lift and wind, and its own attitude controller (`cmd_ctatt`: collective thrust and
attitude). Of this project's physics nothing is left but the floor.
"""

import numpy as np
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import WHOLE_MOTORS, Physics
from formation.maths.arrays import Float, Vec3
from formation.maths.frames import canonical, from_yaw, yaw
from formation.vehicle.profile import BatteryProfile, VehicleProfile, VehicleState

STEP_NS = 4_000_000
"""rotorpy's attitude controller runs once a step: as often as PX4's, 250 times a second."""

HUMMINGBIRD = VehicleProfile(
    name="rotorpy_hummingbird",
    mass_kg=0.5,
    inertia_kg_m2=(3.65e-3, 3.68e-3, 7.03e-3),
    wheelbase_m=0.34,
    rotor_radius_m=0.1,
    thrust_max_n=50.13,
    thrust_curve=0.0,
    yaw_torque_m=0.0244,
    motor_lag_s=0.005,
    drag_n_s_m=(0.223, 0.223, 0.435),
    ground_effect=0.0,
    attitude_p_1_s=11.66,
    yaw_p_1_s=11.66,
    rate_p_1_s=46.64,
    rate_yaw_p_1_s=46.64,
    rate_max_rad_s=10.0,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.002,
    response_dead_time_s=0.029,
    response_lag_s=0.067,
    thrust_dead_time_s=0.01,
    thrust_lag_s=0.005,
    battery=BatteryProfile(cells=3, capacity_mah=2100.0, hover_current_a=8.0),
)
"""The vehicle profile that the ground has.

From rotorpy's hummingbird_params: mass, inertia, arms of 0.17 m, rotors, thrust 4 k_eta (1500 rad/s)^2, drag torque
k_m / k_eta, motor lag, kp_att / kd_att as attitude gain and kd_att as rate gain; drag: that of four rotors (k_d, k_z)
at the speed that hovers. Measured: response_*, by `gcs-log identify` in a flight of it (`--log`).
Assumed: command_delay_s as of paper_40g, thrust_dead_time_s (a link and that), the battery.
"""

_ROTORPY_FROM_OURS = [2, 0, 3, 1]
"""Of the motors: ours are front right, rear left, front left, rear right; its go round from front left."""
_OURS_FROM_ROTORPY = [1, 3, 0, 2]
_IJKW_FROM_WIJK, _WIJK_FROM_IJKW = [1, 2, 3, 0], [3, 0, 1, 2]
_STOPPED_N = 1e-9


def wind_m_s(push_m_s2: Vec3) -> Vec3:
    """The wind whose drag on four hovering rotors pushes a vehicle at rest so hard."""
    return push_m_s2 * (HUMMINGBIRD.mass_kg / HUMMINGBIRD.drag_n_s_m[0])


def push_m_s2(wind_m_s: float) -> float:
    """The other way round."""
    return wind_m_s * HUMMINGBIRD.drag_n_s_m[0] / HUMMINGBIRD.mass_kg


class RotorpyVehicle:
    """rotorpy's model, which keeps nothing from one step to the next: one will do for any number of drones."""

    def __init__(self) -> None:
        self._flies = Multirotor(quad_params, control_abstraction="cmd_ctatt")
        self._falls = Multirotor(quad_params, control_abstraction="cmd_motor_speeds")

    def advance(
        self,
        state: VehicleState,
        profile: VehicleProfile,
        setpoint: LoopSetpoint,
        armed: bool,
        dist_lab_m_s2: Float,
        dt_s: float,
        steps: int,
        thrust_scale: float = 1.0,
        motor_gain: Float = WHOLE_MOTORS,
    ) -> VehicleState:
        """As drone_agent.simulation.attitude_loop.advance. `cmd_ctatt` takes no body rates: they are not looked at.

        dist_lab_m_s2 blows as `wind_m_s`. ValueError for motors that are not whole: it has none such.
        """
        if np.any(motor_gain != WHOLE_MOTORS):
            raise ValueError("rotorpy's vehicle has no dead motors")
        x = state.x
        if not armed and x[2] <= 0.0 and not np.any(x[13:17]):
            return state
        k_eta = quad_params["k_eta"]
        now = {
            "x": x[0:3],
            "v": x[3:6],
            "q": x[6:10][_IJKW_FROM_WIJK],
            "w": x[10:13],
            "wind": wind_m_s(dist_lab_m_s2),
            "rotor_speeds": np.sqrt(x[13:17] / k_eta)[_ROTORPY_FROM_OURS],
        }
        asked = {
            "cmd_thrust": thrust_scale * profile.thrust_n_of(setpoint.thrust_norm),
            "cmd_q": setpoint.q_lab_from_flu[_IJKW_FROM_WIJK],
            "cmd_motor_speeds": np.zeros(4),
        }
        model = self._flies if armed else self._falls
        for _ in range(steps):
            now = on_the_floor(model.step(now, asked, dt_s))
        thrust_n = k_eta * now["rotor_speeds"][_OURS_FROM_ROTORPY] ** 2
        thrust_n[thrust_n < _STOPPED_N] = 0.0
        q_lab_from_flu = canonical(now["q"][_WIJK_FROM_IJKW])
        return VehicleState(np.concatenate([now["x"], now["v"], q_lab_from_flu, now["w"], thrust_n]))


def on_the_floor(now: dict[str, Float]) -> dict[str, Float]:
    """The same; what sank below z = 0 stands on it, level, with its heading.

    rotorpy's own floor keeps whoever is within 1 mm of it, until a step lifts them higher than that.
    """
    if now["x"][2] >= 0.0:
        return now
    x, y, _ = now["x"]
    level = from_yaw(np.array(yaw(now["q"][_WIJK_FROM_IJKW])))[_IJKW_FROM_WIJK]
    return now | {"x": np.array([x, y, 0.0]), "v": np.zeros(3), "w": np.zeros(3), "q": level}


def rotorpy_physics() -> Physics:
    """For drones that are believed to be a HUMMINGBIRD."""
    return Physics(STEP_NS, RotorpyVehicle().advance)
