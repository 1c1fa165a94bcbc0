"""A lab judged as a whole: everything that its file alone decides, before anything is started. Pure."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from formation.config import FENCE_INSET_M, PERSONAL_SPACE, Fence, LabConfig
from formation.exposure import endpoint_host, is_local_endpoint, is_local_link, is_loopback
from formation.guidance.patterns import PATTERNS
from formation.guidance.preview import (
    Preview,
    beyond_text,
    coordinates,
    expected_start,
    outside_m,
    preview,
    reshaped,
    trajectory_from,
)
from formation.guidance.shape import Shape, configured, separations, shape_for
from formation.guidance.shape_request import ShapeRequest
from formation.guidance.trajectory import anchored
from formation.maths.arrays import Float
from formation.messages import FARTHEST_M
from formation.trajectory_config import KINDS
from gcs.finding import Finding
from gcs.lab.feasibility import judge_feasibility
from gcs.lab.keys import Keys
from gcs.lab.wiring import judge_trajectory_keys, judge_wiring
from wire.security.bus_access import REMEDY

FENCE, START, ON_TRAJECTORY, LISTED = "fence", "slots at the start", "slots on the trajectory", "listed shapes"
CLOSE_M = FENCE_INSET_M
FLOOR_M, FENCE_FAR_M, MILLIMETRES_M = 0.02, 100.0, 50.0
TURN = "leader.trajectory.yaw_rate_rad_s"
SECURITY = "security"
EXPOSED = "not on this machine, and nothing authenticates it"
SEPARATION = "separation"
ROUNDING_M = 1e-9


def judge_flight_volume(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge fence, start, slots and trajectory; ahead: the configured shape's preview."""
    yield from _fence(config.limits.fence, keys)
    if config.leader.sysid is None:
        yield from _behind_observed(config, keys)
        return
    amiss = [*_start(config, keys, ahead.start), *_slots_at_start(config, keys, ahead)]
    yield from amiss
    on_trajectory = [] if amiss else [*_trajectory(config, keys, ahead)]
    yield from on_trajectory
    if not amiss and not on_trajectory:
        yield from _close(config, keys, ahead)
        yield from _other_shapes(config, keys, ahead)


def _fence(fence: Fence, keys: Keys) -> Iterator[Finding]:
    for key, corner in (("limits.fence.low_m", fence.low_m), ("limits.fence.high_m", fence.high_m)):
        farthest_m = max(map(abs, corner))
        if farthest_m > FARTHEST_M:
            yield keys.reject(key, FENCE, "poses farther than 1 km are no poses; metres are meant, not millimetres")
        elif farthest_m > FENCE_FAR_M:
            yield keys.warn(key, FENCE, f"{farthest_m:g} m is far for a room: metres are meant")
    if fence.low_m[2] > 0.0:
        yield keys.reject("limits.fence.low_m", FENCE, "drones on the floor, z = 0, would stand outside the fence")
    elif fence.low_m[2] > -FLOOR_M:
        why = "drones stand and land on the fence itself: leave some centimetres under the floor"
        yield keys.warn("limits.fence.low_m", FENCE, why)


def _behind_observed(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Judge an observed leader's slots: reject those that leave the fence wherever the leader is."""
    size = np.subtract(config.limits.fence.high_m, config.limits.fence.low_m)
    across_m, height_m = float(np.hypot(size[0], size[1])), float(size[2])
    for key, shape in written_shapes(config):
        for k, offset in enumerate(shape.offsets):
            if float(np.hypot(offset[0], offset[1])) > across_m or abs(float(offset[2])) > height_m:
                why = f"farther from the leader than the fence is wide ({across_m:.2f} m across, {height_m:.2f} m high)"
                yield keys.reject(f"{key}[{k}].offset_m", START, why + _millimetres(offset))


def _start(config: LabConfig, keys: Keys, start: Float) -> Iterator[Finding]:
    """The height, and where the leader is expected to start."""
    fence, z_m = config.limits.fence, float(start[2])
    if z_m > fence.high_m[2] - CLOSE_M:
        why = f"the fence ends at z = {fence.high_m[2]:g}, and nobody is led nearer to it than {CLOSE_M:g} m"
        yield keys.reject("flight.altitude_m", FENCE, why, f"at most {fence.high_m[2] - CLOSE_M:g} m")
    elif z_m < fence.low_m[2]:
        yield keys.reject("flight.altitude_m", FENCE, f"the fence begins at z = {fence.low_m[2]:g}")
    start_m = np.array([start[0], start[1], np.clip(z_m, fence.low_m[2], fence.high_m[2])])
    if outside_m(start_m, fence) > 0.0:
        why = f"the leader is expected to start {beyond_text(start_m, fence)}"
        yield keys.reject("leader.spawn_lab_m", FENCE, why)


def _slots_at_start(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Slots when the formation is taken up; nothing where the leader itself would be outside."""
    fence = config.limits.fence
    if outside_m(ahead.start[:3], fence) > 0.0:
        return
    led = f"with the leader at {coordinates(ahead.start[:3])} m, heading {np.degrees(ahead.start[3]):.0f} degrees"
    for k, (follower, point) in enumerate(zip(config.followers, ahead.at_start, strict=True)):
        key = f"followers[{k}].offset_m"
        if outside_m(point, fence) > 0.0:
            why = f"the slot of {follower.body} is {beyond_text(point, fence)}, {led}"
            yield keys.reject(key, START, why + _millimetres(np.array(follower.offset_m)))
        elif point[2] <= FLOOR_M:
            yield keys.reject(
                key, START, f"the slot of {follower.body} is in the floor, at z = {point[2]:.2f} m, {led}"
            )


def _trajectory(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge the leader's path, or else the paths of the slots."""
    fence, path = config.limits.fence, config.leader.trajectory
    leader_out = outside_m(ahead.leader[:, 0, :3], fence)
    outside = [k for k, point in enumerate(path.waypoints_m) if outside_m(np.array(point), fence) > 0.0]
    if path.kind in ("waypoints", "polynomial") and outside:
        for k in outside:
            why = f"the leader would fly to a point {beyond_text(np.array(path.waypoints_m[k]), fence)}"
            yield keys.reject(f"leader.trajectory.waypoints_m[{k}]", FENCE, why)
    elif leader_out.max() > 1e-9:
        sample = int(np.argmax(leader_out))
        where = beyond_text(ahead.leader[sample, 0, :3], fence)
        why = f"{ahead.t_s[sample]:.1f} s along its path the leader is {where}"
        yield keys.reject(f"leader.trajectory.{KINDS[path.kind].extent}", FENCE, why)
    else:
        yield from _carried_out(config, keys, ahead, configured(config))


def _carried_out(config: LabConfig, keys: Keys, ahead: Preview, shape: Shape) -> Iterator[Finding]:
    """The slot that is carried farthest out of the fence, or into the floor, and by what."""
    fence, path = config.limits.fence, config.leader.trajectory
    out = np.maximum(outside_m(ahead.slots[:, :, 0], fence), FLOOR_M - ahead.slots[:, :, 0, 2])
    sample, k = (int(i) for i in np.unravel_index(int(np.argmax(out)), out.shape))
    if out[sample, k] <= 1e-9:
        return
    point, turning = ahead.slots[sample, k, 0], path.yaw_rate_rad_s != 0.0
    straight = config.leader.trajectory.model_copy(update={"yaw_rate_rad_s": 0.0})
    unturned = preview(anchored(straight, ahead.start[:3], float(ahead.start[3])), shape, ahead.start)
    turned_out = turning and outside_m(unturned.slots[:, :, 0], fence).max() <= 1e-9
    key = TURN if turned_out else f"leader.trajectory.{KINDS[path.kind].extent}"
    where = beyond_text(point, fence) if outside_m(point, fence) > 0.0 else f"in the floor, at {coordinates(point)} m"
    turned = ", turned with the leader" if turning else ""
    more = int((out.max(axis=0) > 1e-9).sum()) - 1
    others = f"; {more} more would leave it too" if more else ""
    why = f"{ahead.t_s[sample]:.1f} s along the path the slot of {config.followers[k].body} is {where}{turned}{others}"
    yield keys.reject(key, ON_TRAJECTORY, why)


def _close(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Warn of a margin to the fence below CLOSE_M."""
    fence = config.limits.fence
    margin_m = -np.array(
        [outside_m(ahead.leader[:, 0, :3], fence).max(), *outside_m(ahead.slots[:, :, 0], fence).max(0)]
    )
    i = int(np.argmin(margin_m))
    if margin_m[i] < CLOSE_M:
        why = f"{config.vehicles[i].body} comes within {max(margin_m[i], 0.0):.2f} m of it, on its configured path"
        yield keys.warn("limits.fence", FENCE, why, f"{CLOSE_M:g} m or more")


def _other_shapes(config: LabConfig, keys: Keys, configured_ahead: Preview) -> Iterator[Finding]:
    """Listed shapes must fit somewhere on the way; shapes that leave the fence later, and patterns, are reported."""
    fence = config.limits.fence
    tight = []
    for name in (*config.formation.shapes, *PATTERNS):
        listed = name in config.formation.shapes
        ahead = reshaped(configured_ahead, shape_for(config, ShapeRequest(name)))
        out = outside_m(ahead.slots[:, :, 0], fence)
        least, worst = out.max(axis=1).min(), out.max()
        if listed and min(least, outside_m(ahead.at_start, fence).max()) > 1e-9:
            k = int(np.argmax(out[0]))
            why = f"the slot of {config.followers[k].body} is {beyond_text(ahead.slots[0, k, 0], fence)}"
            yield keys.reject(f"formation.shapes.{name}[{k}].offset_m", LISTED, why)
        elif worst > 1e-9 and name not in tight:
            tight.append(name)
    if tight:
        why = f"{', '.join(tight)} would leave the fence on the path, and are rejected where they would"
        yield keys.warn("formation.spacing_m", "shapes", why)


def written_shapes(config: LabConfig) -> Iterator[tuple[str, Shape]]:
    """The shapes that the file itself lists slot by slot, each with the key of its slots."""
    yield "followers", configured(config)
    for name in config.formation.shapes:
        yield f"formation.shapes.{name}", shape_for(config, ShapeRequest(name))


def _millimetres(offset: Float) -> str:
    return "; metres are meant, not millimetres" if float(np.abs(offset).max()) > MILLIMETRES_M else ""


def judge_exposure(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Reject links of other machines without keys, and with keys what cannot carry them."""
    if config.security is None:
        for key in exposed_keys(config):
            yield keys.reject(key, SECURITY, f"{EXPOSED}: {REMEDY}")
        return
    for name in ("zenoh_listen", "zenoh_connect"):
        for k, endpoint in enumerate(getattr(config.link, name)):
            if endpoint.partition("/")[0] not in ("tcp", "tls"):
                yield keys.reject(
                    f"link.{name}[{k}]", SECURITY, "with [security] the bus is TLS alone", "tls/HOST:PORT"
                )
            elif endpoint_host(endpoint) in ("0.0.0.0", "::") and not config.security.addresses:
                why = "other machines check the ground's address, and this is any: say which it has"
                yield keys.reject(f"link.{name}[{k}]", SECURITY, why, "security.addresses = [...]")


def exposed_keys(config: LabConfig) -> Iterator[str]:
    """The key of each endpoint of bus and MAVLink that is not on this machine; camera systems are not among them."""
    link = config.link
    for name, endpoints in (("zenoh_listen", link.zenoh_listen), ("zenoh_connect", link.zenoh_connect)):
        for k, endpoint in enumerate(endpoints):
            if not is_local_endpoint(endpoint):
                yield f"link.{name}[{k}]"
    if link.kind == "udp" and not is_loopback(link.host):
        yield "link.host"
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.sysid is not None and vehicle.link is not None and not is_local_link(vehicle.link):
            yield f"{config.key_of(i)}.link"


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


def foreseen(config: LabConfig) -> Preview:
    """The formation phase as the file has it: the configured shape, the leader where it is expected to start."""
    start = expected_start(config)
    return preview(trajectory_from(config, start), configured(config), start)


def judge(config: LabConfig) -> tuple[Finding, ...]:
    """Every refusal and every warning; the subject of each is a key of the file, `found` its value.

    A single field's own faults have been refused when the file was read (formation.config).
    """
    keys, ahead = Keys(config), foreseen(config)
    return (
        *judge_flight_volume(config, keys, ahead),
        *judge_separation(config, keys),
        *judge_feasibility(config, keys, ahead),
        *judge_wiring(config, keys),
        *judge_exposure(config, keys),
        *_choices(config),
    )


def _choices(config: LabConfig) -> Iterator[Finding]:
    """The further trajectories that the operator may choose, each judged in the place of the configured one."""
    for name in config.leader.trajectories if config.leader.sysid is not None else ():
        lab = config.flying(name)
        keys, ahead = Keys(lab), foreseen(lab)
        for finding in (
            *judge_flight_volume(lab, keys, ahead),
            *judge_feasibility(lab, keys, ahead),
            *judge_trajectory_keys(lab, keys),
        ):
            table, _, key = finding.subject.partition("leader.trajectory.")
            if key and not table:
                yield replace(finding, subject=f"leader.trajectories.{name}.{key}")
