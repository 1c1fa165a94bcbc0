"""A lab judged as a whole: everything that its file alone decides, before anything is started. Pure."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from formation.config import PERSONAL_SPACE, LabConfig
from formation.exposure import endpoint_host, is_local_endpoint, is_local_link, is_loopback
from formation.guidance.patterns import PATTERNS
from formation.guidance.preview import Preview, expected_start, preview, trajectory_from
from formation.guidance.shape import Shape, configured, separations
from gcs.finding import Finding
from gcs.lab.feasibility import judge_feasibility
from gcs.lab.flight_volume import judge_flight_volume, written_shapes
from gcs.lab.keys import Keys
from gcs.lab.wiring import judge_trajectory_keys, judge_wiring
from wire.security.bus_access import REMEDY

SECURITY = "security"
EXPOSED = "not on this machine, and nothing authenticates it"
SEPARATION = "separation"
ROUNDING_M = 1e-9


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
