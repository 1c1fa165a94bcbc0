"""Whether the drones of every shape are far enough apart: for the limits, for their own width, for each other's air."""

from collections.abc import Iterator

import numpy as np

from formation.config import PERSONAL_SPACE, LabConfig
from formation.guidance.patterns import PATTERNS
from formation.guidance.shape import Shape, separations
from gcs.finding import Finding
from gcs.lab.flight_volume import written_shapes
from gcs.lab.keys import Keys

SEPARATION = "separation"
ROUNDING_M = 1e-9


def judge_separation(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Judge the distances of all slots, and of the spawn positions if the file has them."""
    for key, shape in written_shapes(config):
        yield from _slots(config, keys, key, shape)
    least_m, spacing_m = config.limits.min_separation_m, config.formation.spacing_m
    if spacing_m < least_m - ROUNDING_M:
        named = ", ".join(name for name in PATTERNS if name not in config.formation.shapes)
        why = f"the named shapes ({named}) would put neighbours nearer than limits.min_separation_m = {least_m:g} m"
        yield keys.reject("formation.spacing_m", SEPARATION, why, f"{least_m:g} m or more")
    yield from _width(config, keys)
    if config.mocap.source == "mavlink":
        yield from _spawns(config, keys)


def _slots(config: LabConfig, keys: Keys, key: str, shape: Shape) -> Iterator[Finding]:
    """Each slot against the leader and the slots before it."""
    least_m, names = config.limits.min_separation_m, [v.body for v in config.vehicles]
    distances_m = separations(shape.offsets)
    positions_m = np.vstack([np.zeros(3), shape.offsets])
    for k in range(1, len(positions_m)):
        nearest = int(np.argmin(distances_m[k, :k]))
        near_m, subject = float(distances_m[k, nearest]), f"{key}[{k - 1}].offset_m"
        text = f"{names[k]} would be {near_m:.2f} m from {names[nearest]}"
        if near_m < least_m - ROUNDING_M:
            yield keys.reject(subject, SEPARATION, f"{text}, limits.min_separation_m is {least_m:g} m")
        elif near_m < PERSONAL_SPACE * least_m - ROUNDING_M:
            why = f"{text}: nearer than {PERSONAL_SPACE:g} limits.min_separation_m they brake for each other"
            yield keys.warn(subject, SEPARATION, why, f"{PERSONAL_SPACE * least_m:g} m or more")
        for other in range(k):
            gap = positions_m[k] - positions_m[other]
            wide_m = 0.5 * (_width_m(config, k) + _width_m(config, other))
            if float(np.hypot(gap[0], gap[1])) < wide_m <= abs(float(gap[2])):
                low, high = (k, other) if gap[2] < 0.0 else (other, k)
                why = f"{names[low]} would fly {abs(gap[2]):.2f} m under {names[high]}, in its downwash"
                yield keys.warn(subject, SEPARATION, why)


def _width(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    least_m, i = config.limits.min_separation_m, max(config.commanded, key=lambda i: _width_m(config, i))
    if least_m < _width_m(config, i):
        why = f"{config.vehicles[i].profile} is {_width_m(config, i):.2f} m wide: drones as near as that touch"
        yield keys.warn("limits.min_separation_m", SEPARATION, why)


def _width_m(config: LabConfig, i: int) -> float:
    """From rotor tip to rotor tip across the vehicle."""
    profile = config.profile_of(config.vehicles[i])
    return profile.wheelbase_m + 2.0 * profile.rotor_radius_m


def _spawns(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Where simulators start their drones: arming is refused outside the fence, and too near to another."""
    least_m, fence = config.limits.min_separation_m, config.limits.fence
    for order, i in enumerate(config.commanded):
        vehicle, spawn = config.vehicles[i], np.array(config.vehicles[i].spawn_lab_m)
        key = "leader.spawn_lab_m" if i == 0 else f"followers[{i - 1}].spawn_lab_m"
        if i > 0 and (np.any(spawn[:2] < fence.low_m[:2]) or np.any(spawn[:2] > fence.high_m[:2])):
            yield keys.reject(key, "spawn", f"{vehicle.body} starts outside limits.fence: it would not arm")
        for j in config.commanded[:order]:
            near_m = float(np.linalg.norm(spawn - config.vehicles[j].spawn_lab_m))
            if near_m < least_m:
                why = f"{vehicle.body} starts {near_m:.2f} m from {config.vehicles[j].body}: they would not arm"
                yield keys.reject(key, "spawn", why, f"{least_m:g} m or more apart")
