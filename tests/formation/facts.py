"""A swarm with which nothing is wrong, to be made wrong in one thing."""

import numpy as np

from formation.config import LimitsConfig
from formation.safety.rules import Facts

LIMITS = LimitsConfig()
NAMES = ("lead", "left", "right")


def healthy(**changes) -> Facts:
    facts = Facts(
        names=NAMES,
        commanded=np.array([True, True, True]),
        excluded=np.zeros(3, bool),
        landing=np.zeros(3, bool),
        pos_lab_m=np.array([[0.0, 0.0, 0.3], [-0.4, 0.4, 0.3], [-0.4, -0.4, 0.3]]),
        speed_m_s=np.zeros(3),
        tilt_rad=np.zeros(3),
        age_s=np.full(3, 0.008),
        error_m=np.zeros(3),
        model_mismatch=np.zeros(3),
        attitude_innovation_rad=np.zeros(3),
        own_pos_lab_m=np.full((3, 3), np.nan),
        own_tilt_rad=np.full(3, np.nan),
        heartbeat_age_s=np.full(3, 0.5),
        silent_s=np.full(3, 0.02),
        link_behind_s=np.full(3, 0.004),
        setpoint_age_s=np.full(3, 0.02),
        armed=np.ones(3, bool),
        offboard=np.ones(3, bool),
        battery=np.full(3, np.nan),
        duplicate=np.zeros(3, bool),
        late_share=0.0,
    )
    return facts._replace(**changes)


def of(index: int, value, otherwise) -> np.ndarray:
    array = np.array([otherwise] * 3)
    array[index] = value
    return array
