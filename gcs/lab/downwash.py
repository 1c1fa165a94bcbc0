"""Whether slots, or the paths into them, put one drone into the jet of another. By the file alone."""

from collections.abc import Iterator, Sequence

import numpy as np

from formation.config import LabConfig
from formation.guidance.preview import Preview
from formation.guidance.shape import Shape
from formation.maths.arrays import Float
from formation.vehicle.downwash import FIRST_WIDTH, JET_WIDTH, jet_force_n
from formation.vehicle.profile import VehicleProfile
from gcs.finding import Finding, Keys

DOWNWASH = "downwash"
SHARE_LEAST = 0.02
"""Of the weight: less is within what the thrust of the measured vehicles was uncertain by, 3 to 30 mN."""
PATH_SAMPLES = 50
FARTHEST_M, BISECTIONS = 1e3, 50


def judge_slots(config: LabConfig, keys: Keys, key: str, shape: Shape) -> Iterator[Finding]:
    """Judge a shape's slots, which the leader carries along as they are."""
    yield from _judge(config, keys, key, np.vstack([np.zeros(3), shape.offsets])[None], "would fly")


def judge_paths(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge the straight paths from above where drones start into their slots, if the file says where that is."""
    if not any(any(follower.spawn_lab_m) for follower in config.followers):
        return
    height_m = ahead.start[2]
    above = np.array([[*follower.spawn_lab_m[:2], height_m] for follower in config.followers])
    share = np.linspace(0.0, 1.0, PATH_SAMPLES, endpoint=False)[:, None, None]
    path_m = np.concatenate(
        [np.tile(ahead.start[:3], (PATH_SAMPLES, 1, 1)), above + share * (ahead.at_start - above)], 1
    )
    settled = {finding.subject for finding in _judge(config, keys, "followers", path_m[-1:], "")}
    for finding in _judge(config, keys, "followers", path_m, "would pass, on its way into its slot,"):
        if finding.subject not in settled:  # who stays there has been judged by its slot
            yield finding


def _judge(config: LabConfig, keys: Keys, key: str, pos_m: Float, verb: str) -> Iterator[Finding]:
    """A finding for each vehicle that loses SHARE_LEAST or more of its weight anywhere along pos_m (k, n, 3)."""
    profiles, names = [config.profile_of(v) for v in config.vehicles], [v.body for v in config.vehicles]
    forces_n = np.array([_forces_n(profiles, at) for at in pos_m])
    for low, own in enumerate(profiles):
        k = int(np.argmax(forces_n[:, low].sum(axis=1)))
        share, high = float(forces_n[k, low].sum()) / own.weight_n, int(np.argmax(forces_n[k, low]))
        if share < SHARE_LEAST:
            continue
        gap_m = pos_m[k, high] - pos_m[k, low]
        others, spare = int((forces_n[k, low] > 0.0).sum()) - 1, own.thrust_max_n / own.weight_n - 1.0
        half_m = _halving_m(own, profiles[high], float(np.hypot(*gap_m[:2])), float(gap_m[2]))
        more = f" and {others} more" if others else ""
        why = (
            f"{names[low]} {verb} {gap_m[2]:.2f} m under {names[high]}{more}, whose downwash takes {share:.0%} of its "
            f"weight; half of that {half_m:.2f} m under it"
        )
        subject = f"{key}[{(low or high) - 1}].offset_m"
        if share >= spare:
            yield keys.reject(subject, DOWNWASH, f"{why}; beyond hovering it has thrust for {spare:.0%}")
        else:
            yield keys.warn(subject, DOWNWASH, why)


def _forces_n(profiles: Sequence[VehicleProfile], pos_m: Float) -> Float:
    """The force (n, n) on each vehicle by the jet of each other, all at pos_m (n, 3)."""
    forces_n, gap = np.zeros((len(pos_m), len(pos_m))), pos_m[None] - pos_m[:, None]
    aside, below = np.hypot(gap[..., 0], gap[..., 1]), gap[..., 2]
    edge = 3.0 * (JET_WIDTH * below + (1.0 + FIRST_WIDTH) * max(profile.reach_m for profile in profiles))
    for low, high in np.argwhere((below > 0.0) & (aside < edge)).tolist():
        forces_n[low, high] = _force_n(profiles[low], profiles[high], aside[low, high], below[low, high])
    return forces_n


def _force_n(own: VehicleProfile, upper: VehicleProfile, aside_m: float, below_m: float) -> float:
    return jet_force_n(aside_m, below_m, upper.weight_n, upper.reach_m, own.reach_m, own.rotor_radius_m)


def _halving_m(own: VehicleProfile, upper: VehicleProfile, aside_m: float, below_m: float) -> float:
    """How far below, as far aside, the force is half of what it is here."""
    near_m, far_m, half_n = below_m, FARTHEST_M, 0.5 * _force_n(own, upper, aside_m, below_m)
    for _ in range(BISECTIONS):
        middle_m = 0.5 * (near_m + far_m)
        if _force_n(own, upper, aside_m, middle_m) > half_n:
            near_m = middle_m
        else:
            far_m = middle_m
    return near_m
