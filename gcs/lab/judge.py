"""A lab judged as a whole: everything that its file alone decides, before anything is started. Pure.

Flight volume, exposure, separation; then whether poses, links, ports and names can work together.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from math import cos, pi

import numpy as np

from formation.config import FENCE_INSET_M, PERSONAL_SPACE, Fence, LabConfig, TrajectoryConfig, VehicleBody
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
from formation.maths.frames import multiply
from formation.messages import FARTHEST_M
from formation.mocap_config import BODY_BY_BODY, CAMERA_SYSTEMS
from formation.model import QuatTuple
from formation.safety.rules_table import STALE_SETPOINT_S
from formation.trajectory_config import KINDS
from formation.vehicle.profile import PROFILES, VehicleProfile
from gcs.finding import MILLIMETRES_M, Finding, Grade, Keys, vehicle_key
from gcs.lab.downwash import judge_paths, judge_slots
from gcs.lab.feasibility import judge_feasibility
from wire.security.bus_access import REMEDY

FENCE, START, ON_TRAJECTORY, LISTED = "fence", "slots at the start", "slots on the trajectory", "listed shapes"
CLOSE_M = FENCE_INSET_M
FLOOR_M, FENCE_FAR_M = 0.02, 100.0
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
    bodies = zip(config.followers, ahead.at_start, config.half_widths_m[1:], strict=True)
    for k, (follower, point, half_m) in enumerate(bodies):
        key = f"followers[{k}].offset_m"
        if outside_m(point, fence, half_m) > 0.0:
            why = f"the slot of {follower.body} is {beyond_text(point, fence, half_m)}, {led}"
            yield keys.reject(key, START, why + _millimetres(np.array(follower.offset_m)))


def _trajectory(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge the leader's path, or else the paths of the slots."""
    fence, path = config.limits.fence, config.leader.trajectory
    half_m = config.half_widths_m[0]
    leader_out = outside_m(ahead.leader[:, 0, :3], fence, half_m)
    outside = [k for k, point in enumerate(path.waypoints_m) if outside_m(np.array(point), fence, half_m) > 0.0]
    if path.kind in ("waypoints", "polynomial") and outside:
        for k in outside:
            why = f"the leader would fly to a point {beyond_text(np.array(path.waypoints_m[k]), fence, half_m)}"
            yield keys.reject(f"leader.trajectory.waypoints_m[{k}]", FENCE, why)
    elif leader_out.max() > 1e-9:
        sample = int(np.argmax(leader_out))
        where = beyond_text(ahead.leader[sample, 0, :3], fence, half_m)
        why = f"{ahead.t_s[sample]:.1f} s along its path the leader is {where}"
        yield keys.reject(f"leader.trajectory.{KINDS[path.kind].extent}", FENCE, why)
    else:
        yield from _carried_out(config, keys, ahead, configured(config))


def _carried_out(config: LabConfig, keys: Keys, ahead: Preview, shape: Shape) -> Iterator[Finding]:
    """The slot that is carried farthest out of the fence, or into the floor, and by what."""
    fence, path = config.limits.fence, config.leader.trajectory
    half_m = config.half_widths_m[1:]
    out = outside_m(ahead.slots[:, :, 0], fence, half_m)
    sample, k = (int(i) for i in np.unravel_index(int(np.argmax(out)), out.shape))
    if out[sample, k] <= 1e-9:
        return
    point, turning = ahead.slots[sample, k, 0], path.yaw_rate_rad_s != 0.0
    straight = config.leader.trajectory.model_copy(update={"yaw_rate_rad_s": 0.0})
    unturned = preview(anchored(straight, ahead.start[:3], float(ahead.start[3])), shape, ahead.start)
    turned_out = turning and outside_m(unturned.slots[:, :, 0], fence, half_m).max() <= 1e-9
    key = TURN if turned_out else f"leader.trajectory.{KINDS[path.kind].extent}"
    where = beyond_text(point, fence, half_m[k])
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
        half_m = config.half_widths_m[1:]
        out = outside_m(ahead.slots[:, :, 0], fence, half_m)
        least, worst = out.max(axis=1).min(), out.max()
        if listed and min(least, outside_m(ahead.at_start, fence, half_m).max()) > 1e-9:
            k = int(np.argmax(out[0]))
            why = f"the slot of {config.followers[k].body} is {beyond_text(ahead.slots[0, k, 0], fence, half_m[k])}"
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
    if any(any(follower.spawn_lab_m) for follower in config.followers):  # in a file that a program wrote all are zero
        yield from _spawns(config, keys)


def _slots(config: LabConfig, keys: Keys, key: str, shape: Shape) -> Iterator[Finding]:
    """Each slot against the leader and the slots before it."""
    least_m, names = config.limits.min_separation_m, [v.body for v in config.vehicles]
    distances_m = separations(shape.offsets)
    for k in range(1, len(distances_m)):
        nearest = int(np.argmin(distances_m[k, :k]))
        near_m, subject = float(distances_m[k, nearest]), f"{key}[{k - 1}].offset_m"
        text = f"{names[k]} would be {near_m:.2f} m from {names[nearest]}"
        if near_m < least_m - ROUNDING_M:
            yield keys.reject(subject, SEPARATION, f"{text}, limits.min_separation_m is {least_m:g} m")
        elif near_m < PERSONAL_SPACE * least_m - ROUNDING_M:
            why = f"{text}: nearer than {PERSONAL_SPACE:g} limits.min_separation_m they brake for each other"
            yield keys.warn(subject, SEPARATION, why, f"{PERSONAL_SPACE * least_m:g} m or more")
    yield from judge_slots(config, keys, key, shape)


def _width(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    least_m, half_m = config.limits.min_separation_m, config.half_widths_m
    i = max(config.commanded, key=half_m.__getitem__)
    if least_m < (width_m := 2.0 * half_m[i]):
        why = f"{config.vehicles[i].profile} is {width_m:.2f} m wide: drones as near as that touch"
        yield keys.reject("limits.min_separation_m", SEPARATION, why, f"{width_m:.2f} m or more")


def _spawns(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Where drones are expected to start: arming is refused outside the fence, and too near to another."""
    least_m, fence = config.limits.min_separation_m, config.limits.fence
    for order, i in enumerate(config.commanded):
        vehicle, spawn = config.vehicles[i], np.array(config.vehicles[i].spawn_lab_m)
        key = vehicle_key(i, "spawn_lab_m")
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
        *judge_paths(config, keys, ahead),
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


LINK, PORT, POSES, UNUSED, NAMES = "link", "port", "poses", "not used", "names"
RATE_LEAST_HZ, RATE_FEW_HZ, RATE_MANY_HZ, RATE_MOST_HZ = 2.0 / STALE_SETPOINT_S, 50.0, 500.0, 2000.0
DELAY_LONG_S = 0.05
ORIGIN_MOST_M = 100.0
ALWAYS_MILLIMETRES = ("qualisys", "vicon")
"""Their protocols say so; Chingmu's software may be set otherwise."""
UNGUARDED = (
    "no guard notices wrong poses, lost thrust or old setpoints. When they end, its autopilot alone acts: PX4 as "
    "COM_OBL_RC_ACT says after COM_OF_LOSS_T, ArduPilot levels after GUID_TIMEOUT and lands by FS_GCS_ENABLE"
)
UNADDRESSED = "a pose has no addressee in MAVLink, so all drones at one end hear the poses of all. Give each its own"
ROTOR_LEAST, ROTOR_MOST, GYRATION_LEAST = 0.1, 1.2, 0.1
"""Shares of an arm: a propeller's radius (shipped vehicles: 0.41 to 1.0), how far out the mass is (0.33 to 0.65)."""


def judge_wiring(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Judge mocap, links, ports, profiles, and keys that say nothing."""
    yield from _mocap(config, keys)
    yield from _links(config, keys)
    yield from _bus(config, keys)
    yield from _profiles(config, keys)
    yield from _limits(config)
    yield from judge_trajectory_keys(config, keys)
    yield from _leader(config, keys)
    yield from _headings(config, keys)


def _mocap(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    mocap = config.mocap
    if not RATE_LEAST_HZ <= mocap.rate_hz <= RATE_MOST_HZ:
        why = (
            f"drones level where no setpoint comes for {STALE_SETPOINT_S:g} s" if mocap.rate_hz < RATE_LEAST_HZ else ""
        )
        wanted = f"{RATE_LEAST_HZ:g} to {RATE_MOST_HZ:g} Hz"
        yield keys.reject("mocap.rate_hz", POSES, why or "no mocap is as fast, and no ground", wanted)
    elif not RATE_FEW_HZ <= mocap.rate_hz <= RATE_MANY_HZ:
        why = "unusual: every frame is a control cycle"
        yield keys.warn("mocap.rate_hz", POSES, why, f"{RATE_FEW_HZ:g} to {RATE_MANY_HZ:g} Hz")
    if mocap.delay_s > DELAY_LONG_S:
        yield keys.warn("mocap.delay_s", POSES, "seconds are meant; a loop this late flies slowly, or not at all")
    if mocap.source == "csv":
        yield keys.warn("mocap.source", POSES, "recorded poses of the leader alone: nobody else is seen or can arm")
    elif mocap.file is not None:
        yield keys.warn("mocap.file", UNUSED, f'nothing is played with source "{mocap.source}"')
    yield from _camera_system(config, keys)
    yield from _axes(config, keys)


def _camera_system(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Judge the table of a camera system, and whether it is the lab's."""
    mocap = config.mocap
    if mocap.source in CAMERA_SYSTEMS:
        table = getattr(mocap, mocap.source)
        if table is None or "host" not in table.model_fields_set:
            why = f'is missing: source "{mocap.source}" needs the address of the computer that sends the poses'
            yield Finding(f"mocap.{mocap.source}.host", POSES, Grade.FAIL, "", why=why)
    if mocap.source in ALWAYS_MILLIMETRES and mocap.unit not in (None, "mm"):
        yield keys.reject("mocap.unit", POSES, f'source "{mocap.source}" sends millimetres', '"mm", or leave it out')
    for system in CAMERA_SYSTEMS:
        if system != mocap.source and getattr(mocap, system) is not None:
            yield keys.warn(f"mocap.{system}", UNUSED, f'the source is "{mocap.source}"')
    for key in ("assemble_s", "repeats_are_lost"):
        if key in mocap.model_fields_set and mocap.source not in BODY_BY_BODY:
            yield keys.warn(f"mocap.{key}", UNUSED, f'source "{mocap.source}" sends whole frames')
    if mocap.names and mocap.source not in CAMERA_SYSTEMS:
        yield keys.warn("mocap.names", UNUSED, f'source "{mocap.source}" names bodies as the lab does')
    bodies = {v.body for v in config.vehicles}
    for body in sorted(set(mocap.names.values()) - bodies):
        yield keys.reject("mocap.names", NAMES, f"{body} is none of the lab's bodies: {', '.join(sorted(bodies))}")
    if mocap.latency_s is not None and mocap.latency_s > mocap.delay_s:
        yield keys.reject(
            "mocap.latency_s", POSES, "is a part of delay_s, and cannot be more", f"<= {mocap.delay_s:g} s"
        )


def _axes(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Where the cameras' origin is, and rotations whose numbers are probably in another order."""
    farthest_m = max(map(abs, config.mocap.origin_lab_m))
    if farthest_m > ORIGIN_MOST_M:
        why = f"{farthest_m:g} m from the lab's origin: metres are meant, not millimetres"
        yield keys.reject("mocap.origin_lab_m", POSES, why, f"{ORIGIN_MOST_M:g} m at most")
    q_lab_from_mocap = np.array(config.mocap.q_lab_from_mocap)
    rotations = [("mocap.q_lab_from_mocap", config.mocap.q_lab_from_mocap)]
    rotations += [(vehicle_key(i, "q_marker_from_flu"), v.q_marker_from_flu) for i, v in enumerate(config.vehicles)]
    for key, q in rotations:
        if q == (0.0, 0.0, 0.0, 1.0) and (key != "mocap.q_lab_from_mocap" or config.mocap.axes is None):
            yield keys.warn(key, POSES, "half a turn about z; no rotation is [1, 0, 0, 0], as w comes first")
        elif key != "mocap.q_lab_from_mocap" and not (
            _is_level(q) or _is_level(multiply(q_lab_from_mocap, np.array(q)))
        ):
            why = "a level drone's marker frame would lie on its side, or upside down; `gcs doctor` measures it"
            yield keys.warn(key, POSES, why)
    natnet = config.mocap.natnet
    if natnet is not None and natnet.interface == natnet.host and not is_loopback(natnet.host):
        why = "is the address of the computer that Motive runs on; this computer's own is meant"
        yield keys.warn("mocap.natnet.interface", POSES, why)


def _is_level(q: QuatTuple | Float) -> bool:
    """Whether a rotation leaves the axis up within 45 degrees of up."""
    return 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]) > cos(0.25 * pi)


def _links(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """No two drones by one link, no port bound twice on this machine."""
    own = [(i, v) for i, v in enumerate(config.vehicles) if v.sysid is not None and v.link is not None]
    bound = _shared_ports(config)
    for order, (i, vehicle) in enumerate(own):
        kind, host, port = (vehicle.link or "").split(":")
        key = vehicle_key(i, "link")
        before = next((v for _, v in own[:order] if _endpoint(v) == _endpoint(vehicle)), None)
        if before is not None:
            yield keys.reject(key, LINK, f"{before.body} has the same: {UNADDRESSED}")
        elif int(port) in bound and (kind == "udpin" or _is_local(host)):
            yield keys.reject(key, PORT, f"UDP port {port} is {bound[int(port)]}")
        elif kind == "udpin":
            bound[int(port)] = f"the link of {vehicle.body}"
    if config.link.kind == "udp" and _is_local(config.link.host):
        yield from _both_ends(config, keys)


def _shared_ports(config: LabConfig) -> dict[int, str]:
    """The UDP ports that the ground itself listens on for drones without a link of their own."""
    if config.link.kind != "udp":
        return {}
    drones = [v for v in config.vehicles if v.sysid is not None and v.link is None]
    return {config.link.ground_port_base + (v.sysid or 0): f"the ground's own for {v.body}" for v in drones}


def _both_ends(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """On one machine the ground's port for one drone must not be another drone's own."""
    link, drones = config.link, [v for v in config.vehicles if v.sysid is not None and v.link is None]
    theirs = {link.drone_port_base + (v.sysid or 0): v.body for v in drones}
    for vehicle in drones:
        port = link.ground_port_base + (vehicle.sysid or 0)
        if port in theirs:
            why = (
                f"UDP port {port} would be the ground's for {vehicle.body} (link.ground_port_base + sysid) and that of "
                f"{theirs[port]} itself (link.drone_port_base + sysid), both on {link.host}"
            )
            yield keys.reject("link.drone_port_base", PORT, why)
            return


def _endpoint(vehicle: VehicleBody) -> tuple[bool, str, str]:
    """Where a drone's own link leads: whether it is bound here, host and port."""
    kind, host, port = (vehicle.link or "").split(":")
    return kind == "udpin", "127.0.0.1" if host == "localhost" or kind == "udpin" else host, port


def _is_local(host: str) -> bool:
    return host == "localhost" or host.startswith("127.")


def _bus(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    link = config.link
    for name, endpoints in (("zenoh_listen", link.zenoh_listen), ("zenoh_connect", link.zenoh_connect)):
        for endpoint, times in Counter(endpoints).items():
            if times > 1:
                yield keys.reject(f"link.{name}", LINK, f"{endpoint} is there {times} times")
        for k, endpoint in enumerate(endpoints):
            if name == "zenoh_connect" and endpoint.endswith(":0"):
                yield keys.reject(f"link.{name}[{k}]", PORT, "port 0 is any free one: nobody is known to be there")
    if not link.zenoh_listen and not link.zenoh_connect:
        why = "neither this nor link.zenoh_listen: no operator, mocap or agent finds the ground"
        yield keys.reject("link.zenoh_connect", LINK, why)


def _profiles(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    names = Counter(own.name for own in config.profiles)
    for k, own in enumerate(config.profiles):
        if names[own.name] > 1:
            yield keys.reject(f"profiles[{k}].name", NAMES, "two profiles have this name")
        elif own.name in PROFILES:
            yield keys.warn(f"profiles[{k}].name", NAMES, "replaces the shipped profile of this name")
        if own.name not in {v.profile for v in config.vehicles}:
            yield keys.warn(f"profiles[{k}].name", UNUSED, "no vehicle names this profile")
        yield from _sizes(k, own, keys)
    flown = sorted({v.profile for v in config.vehicles if v.sysid is not None})
    if len(flown) > 1:
        first = next(i for i in config.commanded if config.vehicles[i].profile != config.vehicles[0].profile)
        why = f"several profiles fly together ({', '.join(flown)}): the slowest sets how well the formation holds"
        yield keys.warn(vehicle_key(first, "profile"), NAMES, why)
    unnamed = [i for i in config.commanded if not config.vehicles[i].names_profile and config.vehicles[i].link is None]
    if unnamed:
        bodies = ", ".join(config.vehicles[i].body for i in unnamed[:3]) + (", ..." if len(unnamed) > 3 else "")
        kind = config.profile_of(config.vehicles[unnamed[0]])
        why = (
            f"{bodies}: no profile is named, and each is flown as {kind.name}, a vehicle of {kind.mass_kg * 1e3:.0f} g"
        )
        yield keys.warn(vehicle_key(unnamed[0], "profile"), NAMES, why, ", ".join(known_profiles(config)))
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.link is not None and vehicle.sysid is None:
            yield keys.warn(vehicle_key(i, "link"), UNUSED, "without a sysid nothing is sent to it")
        elif vehicle.link is not None and not vehicle.names_profile:
            why = (
                f"{vehicle.body} has a link, so it is a real drone, and no profile says which: this one is a simulated "
                f'40 g vehicle. Write profile = "..." there: {", ".join(known_profiles(config))}'
            )
            yield keys.reject(vehicle_key(i, "profile"), NAMES, why)
        elif vehicle.link is not None:
            yield keys.warn(vehicle_key(i, "guard"), LINK, f"{vehicle.body}: {UNGUARDED}")


def _sizes(k: int, own: VehicleProfile, keys: Keys) -> Iterator[Finding]:
    """Lengths and masses that no vehicle has together: one of them is in another unit."""
    arm_m = 0.5 * own.wheelbase_m
    gyration = (max(own.inertia_kg_m2[:2]) / own.mass_kg) ** 0.5 / arm_m
    if not ROTOR_LEAST <= own.rotor_radius_m / arm_m <= ROTOR_MOST:
        why = f"propellers of {own.rotor_radius_m:g} m radius, and arms of {arm_m:g} m: metres are meant"
        yield keys.reject(f"profiles[{k}].wheelbase_m", NAMES, why)
    elif own.weight_n < own.thrust_max_n and not (own.impossible_inertia or GYRATION_LEAST <= gyration <= 1.0):
        why = (
            f"with {own.mass_kg:g} kg and arms of {arm_m:g} m the mass is {gyration:.2g} of an arm from the middle: "
            "kilograms, metres and kg m^2 are meant"
        )
        yield keys.reject(f"profiles[{k}].inertia_kg_m2", NAMES, why, f"{GYRATION_LEAST:g} to 1")


def known_profiles(config: LabConfig) -> tuple[str, ...]:
    """The lab's own profiles, then those that are shipped."""
    own = tuple(profile.name for profile in config.profiles)
    return (*own, *(name for name in PROFILES if name not in own))


def judge_trajectory_keys(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Keys of a trajectory that its kind does not use."""
    path, table = config.leader.trajectory, "leader.trajectory"
    if config.leader.sysid is None:
        if path != TrajectoryConfig():
            yield keys.warn(f"{table}.kind", UNUSED, "a leader without a sysid is observed, and flies what it flies")
        if config.leader.trajectories:
            yield keys.warn(
                "leader.trajectories", UNUSED, "a leader without a sysid is observed, and flies what it flies"
            )
        return
    if path.model_fields_set and "kind" not in path.model_fields_set:
        yield keys.warn(f"{table}.kind", UNUSED, "not given, so the leader holds its place")
    is_dumped = {"length_m", "radius_m", "speed_m_s"} <= path.model_fields_set  # by a program, every key in it
    for name in sorted(path.model_fields_set - {"kind", "yaw_rate_rad_s"} - KINDS[path.kind].used):
        usual = type(path).model_fields[name].get_default(call_default_factory=True)
        if not is_dumped or getattr(path, name) != usual:
            yield keys.warn(f"{table}.{name}", UNUSED, f'kind "{path.kind}" does not use it')
    if path.kind == "circle" and path.laps is not None and path.duration_s != TrajectoryConfig().duration_s:
        yield keys.warn(f"{table}.duration_s", UNUSED, "laps says how long a circle is flown")


def _leader(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    leader, raised = config.leader, "flight.observed_leader_altitude_offset_m"
    if leader.sysid is None:
        yield keys.warn("leader.body", "leader", "only observed, as it has no sysid: where it goes is not judged here")
    elif config.flight.observed_leader_altitude_offset_m != 0.0:
        yield keys.warn(raised, UNUSED, "the leader is commanded")


def _limits(config: LabConfig) -> Iterator[Finding]:
    """The fence of a room that nobody has described."""
    is_real = config.mocap.source in CAMERA_SYSTEMS or any(v.link is not None for v in config.vehicles)
    if is_real and "fence" not in config.limits.model_fields_set:
        fence = config.limits.fence
        why = f"is not given: {list(fence.low_m)} to {list(fence.high_m)} m is taken for the room, and may not be it"
        yield Finding("limits.fence", POSES, Grade.WARN, "", why=why)


def _headings(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Radians are meant."""
    angles = [("leader.spawn_yaw_rad", config.leader.spawn_yaw_rad)]
    angles += [(f"followers[{k}].yaw_offset_rad", f.yaw_offset_rad) for k, f in enumerate(config.followers)]
    for name, slots in config.formation.shapes.items():
        angles += [(f"formation.shapes.{name}[{k}].yaw_offset_rad", s.yaw_offset_rad) for k, s in enumerate(slots)]
    for key, angle_rad in angles:
        if abs(angle_rad) > 2.0 * pi:
            yield keys.reject(key, "heading", "more than a whole turn: radians are meant, not degrees")
