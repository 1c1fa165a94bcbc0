"""Whether poses, links, ports and names of a lab can work together. By the file alone."""

from collections import Counter
from collections.abc import Iterator
from math import cos, pi

from formation.config import LabConfig, TrajectoryConfig, VehicleBody
from formation.exposure import is_loopback
from formation.mocap_config import CAMERA_SYSTEMS
from formation.model import QuatTuple
from formation.trajectory_config import KINDS
from formation.vehicle.profile import PROFILES, VehicleProfile
from gcs.finding import Finding, Grade
from gcs.lab.keys import Keys

LINK, PORT, POSES, UNUSED, NAMES = "link", "port", "poses", "not used", "names"
SETPOINT_S = 0.1  # an agent levels after so long without a setpoint
RATE_LEAST_HZ, RATE_FEW_HZ, RATE_MANY_HZ, RATE_MOST_HZ = 2.0 / SETPOINT_S, 50.0, 500.0, 2000.0
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
"""Of an arm: a propeller's radius (shipped vehicles: 0.41 to 1.0), and how far out the mass is (0.33 to 0.65)."""
W_LAST = (0.0, 0.0, 0.0, 1.0)


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


def vehicle_key(i: int, name: str) -> str:
    """The key of vehicle i's own `name`."""
    return f"leader.{name}" if i == 0 else f"followers[{i - 1}].{name}"


def _mocap(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    mocap = config.mocap
    if not RATE_LEAST_HZ <= mocap.rate_hz <= RATE_MOST_HZ:
        why = f"drones level where no setpoint comes for {SETPOINT_S:g} s" if mocap.rate_hz < RATE_LEAST_HZ else ""
        wanted = f"{RATE_LEAST_HZ:g} to {RATE_MOST_HZ:g} Hz"
        yield keys.reject("mocap.rate_hz", POSES, why or "no mocap is as fast, and no ground", wanted)
    elif not RATE_FEW_HZ <= mocap.rate_hz <= RATE_MANY_HZ:
        why = "unusual: every frame is a control cycle"
        yield keys.warn("mocap.rate_hz", POSES, why, f"{RATE_FEW_HZ:g} to {RATE_MANY_HZ:g} Hz")
    if mocap.delay_s > DELAY_LONG_S:
        yield keys.warn("mocap.delay_s", POSES, "seconds are meant; a loop this late flies slowly, or not at all")
    if mocap.source in ("csv", "mcap"):
        whose = "of the leader alone, nobody else is seen or can arm" if mocap.source == "csv" else "of an earlier day"
        yield keys.warn("mocap.source", POSES, f"recorded poses, {whose}")
    elif mocap.file is not None:
        yield keys.warn("mocap.file", UNUSED, f'nothing is played with source "{mocap.source}"')
    yield from _camera_system(config, keys)
    yield from _axes(config, keys)
    if mocap.source == "mavlink" and config.leader.sysid is None:
        why = 'with source "mavlink" drones say themselves where they are: a leader that is none is never seen'
        yield keys.reject("leader.sysid", POSES, why)
    elif mocap.source != "mavlink":
        for i, follower in enumerate(config.followers):
            if "spawn_lab_m" in follower.model_fields_set and any(follower.spawn_lab_m):
                yield keys.warn(f"followers[{i}].spawn_lab_m", UNUSED, f'the mocap says, with source "{mocap.source}"')


def _camera_system(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """What is said of a camera system, and whether it is the lab's."""
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
    rotations = [("mocap.q_lab_from_mocap", config.mocap.q_lab_from_mocap)]
    rotations += [(vehicle_key(i, "q_marker_from_flu"), v.q_marker_from_flu) for i, v in enumerate(config.vehicles)]
    for key, q in rotations:
        if q == W_LAST and (key != "mocap.q_lab_from_mocap" or config.mocap.axes is None):
            yield keys.warn(key, POSES, "half a turn about z; no rotation is [1, 0, 0, 0], as w comes first")
        elif key != "mocap.q_lab_from_mocap" and not (_is_level(q) or _is_level(_product(rotations[0][1], q))):
            why = "a level drone's marker frame would lie on its side, or upside down; `gcs doctor` measures it"
            yield keys.warn(key, POSES, why)
    natnet = config.mocap.natnet
    if natnet is not None and natnet.interface == natnet.host and not is_loopback(natnet.host):
        why = "is the address of the computer that Motive runs on; this computer's own is meant"
        yield keys.warn("mocap.natnet.interface", POSES, why)


def _is_level(q: QuatTuple) -> bool:
    """Whether a rotation leaves the axis up within 45 degrees of up."""
    return 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]) > cos(0.25 * pi)


def _product(a: QuatTuple, b: QuatTuple) -> QuatTuple:
    w, x, y, z = a
    return (
        w * b[0] - x * b[1] - y * b[2] - z * b[3],
        w * b[1] + x * b[0] + y * b[3] - z * b[2],
        w * b[2] - x * b[3] + y * b[0] + z * b[1],
        w * b[3] + x * b[2] - y * b[1] + z * b[0],
    )


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
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.link is not None and vehicle.sysid is None:
            yield keys.warn(vehicle_key(i, "link"), UNUSED, "without a sysid nothing is sent to it")
        elif vehicle.link is not None and "profile" not in vehicle.model_fields_set:
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
    elif not (own.impossible_inertia or GYRATION_LEAST <= gyration <= 1.0):
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
