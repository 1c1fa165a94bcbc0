"""The doctor's checks, pure: of the mocap from some seconds of frames, of each drone, and of axes by moves by hand.

*Mocap.* With the drones at rest: rate, delay, losses; each body's noise, level, place.
*Drone.* Link, clock, parameters and signing key.
*Axes.* Proof of the mocap's axes, each body's name and each yaw zero. The operator stands every drone with its nose
along the lab's x axis, then moves one at a time: forward along its nose, left, up, turns it left, and tips it. Whatever
the mocap saw instead says what is wrong with it; whose autopilot was tipped, whether system ids are swapped.
"""

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from formation.config import LabConfig, MocapConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Flags, Float, Quat, Quats, Vec3, Vec3s
from formation.messages import LabFrame
from formation.safety.rules import nearest, outside_box
from formation.vehicle.profile import VehicleProfile
from gcs.drones.autopilot_model import HOVER_WITHIN, GroundModel, ParameterRule
from gcs.finding import MILLIMETRES_M, Finding, Fix, Grade, Refit, graded, unmeasured
from gcs.security.signing_probe import ProbeOutcome
from mocap.figures import noise_m, timing
from wire.config_file import dump_profile
from wire.link_messages import MavAutopilot

Received = tuple[int, LabFrame]

RATE_WITHIN = 0.1
JITTER_SHARE, LOST_SHARE, SEEN_SHARE = 0.5, 0.02, 0.95
NOISE_M = 0.001
DELAY_WITHIN_S, DELAY_LEAST_S = 0.01, 0.001
LEVEL_RAD, ON_SIDE_RAD = np.radians(8.0), np.radians(60.0)
FLOOR_M = 0.1
TIPPED_RAD = np.radians(12.0)
FRAMES_LEAST = 10
MOCAP = "mocap"


def check_mocap(
    config: LabConfig, received: Sequence[Received], unknown: Sequence[str] = (), retimed_scatter_s: float | None = None
) -> tuple[Finding, ...]:
    """Judge frames, each with the time it was received, ns.

    unknown: bodies that the mocap has beside the lab's. retimed_scatter_s: of capture times, where they are re-timed.
    """
    if len(received) < FRAMES_LEAST:
        found = f"{len(received)} frames"
        return (Finding(MOCAP, "frames", Grade.FAIL, found, "a stream", "no mocap, or not on this bus"),)
    pos = np.stack([frame.pos_lab_m for _, frame in received])
    q = np.stack([frame.q_lab_from_flu for _, frame in received])
    seen = np.stack([frame.seen for _, frame in received])
    return (
        *_timing(config, received, retimed_scatter_s),
        *_bodies(config, seen, unknown),
        *_rest(config, pos, q, seen),
        *_positions(config, pos, seen),
    )


def _timing(config: LabConfig, received: Sequence[Received], retimed_scatter_s: float | None) -> Iterator[Finding]:
    arrived = np.array([t_ns for t_ns, _ in received])
    captured = np.array([frame.t_capture_ns for _, frame in received])
    numbers = np.array([frame.seq for _, frame in received])
    found = timing(captured, arrived, numbers)
    wanted_hz = config.mocap.rate_hz
    close = abs(found.rate_hz - wanted_hz) <= RATE_WITHIN * wanted_hz
    why = "mocap.rate_hz sets the watchdog and the delay margin"
    yield graded(MOCAP, "rate", f"{found.rate_hz:.1f} Hz", f"{wanted_hz:g} Hz", close, why)
    fair, most = found.jitter_s <= JITTER_SHARE / wanted_hz, f"under {500.0 / wanted_hz:.1f} ms"
    yield graded(MOCAP, "jitter", f"{found.jitter_s * 1e3:.2f} ms", most, fair, "uneven frames")
    yield _stamps(found.arrival_stamps, retimed_scatter_s)
    yield _lost_frames(config.mocap.source, found.lost_share)
    yield _delay(config.mocap, found.delay_s)


def _stamps(are_arrival_times: bool, retimed_scatter_s: float | None) -> Finding:
    check, wanted = "stamps", "exposure times"
    why = "stamps are arrival times: let the source stamp each frame when it is exposed"
    if retimed_scatter_s is not None:
        found = f"arrival times, re-timed with a scatter of {retimed_scatter_s * 1e3:.2f} ms"
        return Finding(MOCAP, check, Grade.WARN, found, wanted, why)
    found = "arrival times" if are_arrival_times else wanted
    return graded(MOCAP, check, found, wanted, not are_arrival_times, why, fair=True)


def _lost_frames(source: str, lost: float) -> Finding:
    check, wanted = "lost frames", "under 2%"
    if source == "csv":
        return unmeasured(MOCAP, check, wanted, 'source "csv" numbers no frames: what is lost does not show')
    return graded(MOCAP, check, f"{lost:.1%}", wanted, lost <= LOST_SHARE, "network or cameras", fair=True)


def _delay(mocap: MocapConfig, delay_s: float) -> Finding:
    """From exposure to receipt, where frames say when they were exposed; else it is only what the lab file says."""
    check, wanted = "delay", f"{mocap.delay_s * 1e3:.1f} ms"
    if mocap.source == "csv":
        why = 'source "csv" reports no exposure time: mocap.delay_s is used'
        return unmeasured(MOCAP, check, wanted, why)
    if 0.0 <= delay_s < DELAY_LEAST_S:
        return unmeasured(MOCAP, check, wanted, "frames are stamped as they are sent, not as they are exposed")
    close = abs(delay_s - mocap.delay_s) <= DELAY_WITHIN_S
    why = "mocap.delay_s is what the delay margin is computed with"
    return graded(MOCAP, check, f"{delay_s * 1e3:.1f} ms", wanted, close, why, fair=True)


def _bodies(config: LabConfig, seen: Bool, unknown: Sequence[str]) -> Iterator[Finding]:
    others = f"; the mocap also has {', '.join(sorted(unknown))}" if unknown else ""
    for i, vehicle in enumerate(config.vehicles):
        share = float(seen[:, i].mean())
        why = "occluded, too few markers, or named otherwise" + others
        yield graded(vehicle.body, "seen", f"{share:.0%} of frames", "over 95%", share >= SEEN_SHARE, why, share > 0.5)


def _rest(config: LabConfig, pos: Float, q: Float, seen: Bool) -> Iterator[Finding]:
    """Noise and level of the bodies at rest."""
    for i, vehicle in enumerate(config.vehicles):
        if not seen[:, i].any() or vehicle.sysid is None:
            continue
        yield _noise(vehicle.body, pos[seen[:, i], i])
        tilt = float(np.median(_tilt_rad(q[seen[:, i], i])))
        why = "the marker frame is not level: q_marker_from_flu"
        if tilt > ON_SIDE_RAD:
            why = "lies on its side for this mocap: is the mocap y-up? q_lab_from_mocap = [0.7071, 0.7071, 0, 0]"
        yield graded(
            vehicle.body, "level at rest", f"{np.degrees(tilt):.0f} deg", "under 8 deg", tilt <= LEVEL_RAD, why
        )


def _noise(body: str, pos: Float) -> Finding:
    """How far the poses (k, 3) of a body at rest scatter; a pose that never changes at all is not seen anew."""
    check, wanted = "noise at rest", "under 1 mm"
    if len(pos) < FRAMES_LEAST:
        return unmeasured(body, check, wanted, f"seen in {len(pos)} frames only")
    found_m = noise_m(pos)
    if not np.ptp(pos, axis=0).any():
        return unmeasured(body, check, wanted, "every pose is the same to the last bit: a frozen source?")
    return graded(body, check, f"{found_m * 1e3:.2f} mm", wanted, found_m <= NOISE_M, "moving? reflections?")


def _positions(config: LabConfig, pos: Float, seen: Bool) -> Iterator[Finding]:
    """Units, floor, fence and separation of the bodies that were seen."""
    commanded = [i for i in config.commanded if seen[:, i].any()]
    if not commanded:
        return
    at = np.stack([np.median(pos[seen[:, i], i], axis=0) for i in commanded])
    names = [config.vehicles[i].body for i in commanded]
    farthest_m = float(np.abs(at).max())
    if farthest_m > MILLIMETRES_M:
        why = "the mocap sends millimetres: set it to metres"
        yield Finding(MOCAP, "units", Grade.FAIL, f"a body at {farthest_m:.0f} m", "metres", why)
        return
    yield Finding(MOCAP, "units", Grade.PASS, f"all within {farthest_m:.1f} m", "metres")
    fence = config.limits.fence
    outside = outside_box(at, fence.low_m, fence.high_m)
    near = nearest(at, np.ones(len(at), np.bool_))
    least_m = config.limits.min_separation_m
    for name, point, out_m, near_m in zip(names, at, outside, near, strict=True):
        where = "(" + ", ".join(f"{x:.2f}" for x in point) + ")"
        yield graded(name, "inside the fence", where, "inside", out_m == 0.0, f"{out_m:.2f} m outside limits.fence")
        high = abs(point[2]) > FLOOR_M
        yield graded(
            name, "on the floor", f"z {point[2]:.2f} m", "under 0.1 m", not high, "lab z = 0 is the floor", True
        )
        if np.isfinite(near_m):
            yield graded(name, "separation", f"{near_m:.2f} m", f"over {least_m:g} m", near_m >= least_m, "too close")


PACKETS_LEAST = 50  # below it one lost packet would be two per cent, and a twin might not have spoken
LOSS, LOSS_MOST = 0.01, 0.05
ROUND_TRIP_S = 0.02
HOVER_MOST = 0.25
ALWAYS_UNSIGNED = {
    MavAutopilot.PX4: "HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION",
    MavAutopilot.ARDUPILOT: "RADIO_STATUS, RADIO; everything on its first serial port (USB)",
}
"""Messages that firmwares accept unsigned, whatever their key: PX4's mavlink_sign_control.cpp, GCS_Signing.cpp."""
SIGNATURE, UNSIGNED_REJECTED = "signature", "unsigned refused"


@dataclass(frozen=True, slots=True)
class DroneReport:
    """One drone as it was found; None or NaN where nothing was learned. `parameters` holds only what it answered.

    packets: how many came from it. unhealthy: what the autopilot reports as missing; None where it reported
    nothing. awaiting_restart: parameters that are right by now and were not when it booted, each with why.
    """

    name: str
    sysid: int
    profile: VehicleProfile
    model: GroundModel | None
    version: str
    parameters: Mapping[str, float]
    unhealthy: tuple[str, ...] | None
    packets: int
    loss: float
    round_trip_s: float
    clock_offset_s: float | None
    duplicate: bool
    foreign_sysid: int | None
    battery: float
    awaiting_restart: tuple[tuple[str, str], ...] = ()
    names_profile: bool = True
    """Whether the lab file says which vehicle it is."""


def check_drone(report: DroneReport) -> tuple[Finding, ...]:
    """Judge one drone."""
    return tuple(_check(report))


def _check(report: DroneReport) -> Iterator[Finding]:
    name = report.name
    if report.foreign_sysid is not None:
        found = f"drone {report.foreign_sysid} answers"
        yield Finding(name, "sysid", Grade.FAIL, found, str(report.sysid), "wrong link, or wrong sysid")
    yield _check_own(report)
    if report.model is None:
        yield Finding(name, "heartbeat", Grade.FAIL, "none", "PX4 or ArduPilot", "off, or not on this link")
        return
    yield Finding(name, "autopilot", Grade.PASS, f"{report.model.name} {report.version or '(version not reported)'}")
    yield from _check_link(report)
    for rule in report.model.rules:
        yield _check_rule(report, rule)
    for parameter, why in report.awaiting_restart:
        # Some autopilots' clocks are their computers', and show no restart that nobody here heard.
        yield unmeasured(name, f"restart for {parameter}", "restarted", f"it {why}", Grade.FAIL)
    if not report.names_profile:
        yield _check_unnamed(report, report.model)
    yield _check_hover(report, report.model)
    yield from _check_health(report)
    if math.isnan(report.battery):
        yield unmeasured(
            name, "battery", "over 50%", "it reports no charge: the ground cannot land it before the battery is empty"
        )
    else:
        yield graded(name, "battery", f"{report.battery:.0%}", "over 50%", report.battery > 0.5, "charge it", True)


def _check_own(report: DroneReport) -> Finding:
    """Whether only one drone uses the sysid; unmeasured below PACKETS_LEAST packets."""
    check, wanted = "sysid is its own", "one drone"
    if report.duplicate:
        why = "two drones have this sysid: change one (PX4 MAV_SYS_ID, ArduPilot SYSID_THISMAV)"
        return Finding(report.name, check, Grade.FAIL, "two drones", wanted, why)
    if not report.packets:
        return unmeasured(report.name, check, wanted, "nothing was heard of it", Grade.FAIL)
    if report.packets < PACKETS_LEAST:
        return unmeasured(report.name, check, wanted, f"only {report.packets} packets came from it")
    return Finding(report.name, check, Grade.PASS, wanted, wanted)


def _check_health(report: DroneReport) -> Iterator[Finding]:
    check, wanted = "own health", "ready"
    if report.unhealthy is None:
        yield unmeasured(report.name, check, wanted, "MAVSDK did not hear it say")
    elif not report.unhealthy:
        yield Finding(report.name, check, Grade.PASS, wanted, wanted)
    for lack in report.unhealthy or ():
        yield Finding(report.name, check, Grade.WARN, lack, wanted, "it would refuse to arm")


def _check_link(report: DroneReport) -> Iterator[Finding]:
    name, found = report.name, f"{report.loss:.1%} lost"
    if report.packets < PACKETS_LEAST:
        yield unmeasured(name, "link", "under 1% lost", f"only {report.packets} packets came from it")
    else:
        well, fair = report.loss <= LOSS, report.loss <= LOSS_MOST
        yield graded(name, "link", found, "under 1%", well, "radio, or a busy machine", fair)
    if math.isnan(report.round_trip_s) or report.clock_offset_s is None:
        yield Finding(name, "clock", Grade.WARN, "no TIMESYNC", "answered", "ages of setpoints stay unknown")
        return
    found = f"{report.round_trip_s * 1e3:.1f} ms round trip, offset {report.clock_offset_s:+.3f} s"
    yield graded(name, "clock", found, "under 20 ms", report.round_trip_s <= ROUND_TRIP_S, "a slow link", fair=True)


def _check_rule(report: DroneReport, rule: ParameterRule) -> Finding:
    value = report.parameters.get(rule.name)
    grade = Grade.FAIL if rule.rejects(value) or rule.external_pose else Grade.WARN
    if value is None:
        return Finding(report.name, rule.name, grade, "not answered", rule.wanted, rule.why)
    if rule.holds(value):
        return Finding(report.name, rule.name, Grade.PASS, f"{value:g}", rule.wanted)
    fix = Fix(report.sysid, rule.name, rule.set_to)
    return Finding(report.name, rule.name, grade, f"{value:g}", rule.wanted, rule.why, fix)


def _check_hover(report: DroneReport, model: GroundModel) -> Finding:
    """The autopilot's own hover thrust against the profile's: both are believed by somebody in flight.

    It is never written: an autopilot learns it by flying, and what has been flown knows better than a profile.
    """
    name, wanted = model.table.hover_parameter, report.profile.hover_thrust_norm
    value = report.parameters.get(name)
    expected = f"{wanted:.2f} ({report.profile.name})"
    if value is None:
        return Finding(report.name, name, Grade.WARN, "not answered", expected, "the profile's is used")
    off = abs(value - wanted) / wanted
    found = f"{value:.2f}"
    if off <= HOVER_WITHIN:
        return Finding(report.name, name, Grade.PASS, found, expected)
    if not model.hover_measured(value):
        why = f"{model.name}'s default, never measured: the profile's is used, and the autopilot's own flying is off"
        return Finding(report.name, name, Grade.WARN, found, expected, why)
    grade = Grade.WARN if off <= HOVER_MOST else Grade.FAIL
    refit = refitted(report.profile, value, report.sysid)
    why = (
        "the autopilot's own is flown, so the profile is wrong for this drone: change the profile (--fix offers one), "
        "or measure its mass and identify a flight"
    )
    return Finding(report.name, name, grade, found, expected, why, refit=refit)


def _check_unnamed(report: DroneReport, model: GroundModel) -> Finding:
    """The profile of a drone whose entry names none, against the hover thrust by which the drone flies."""
    kind, value = report.profile, report.parameters.get(model.table.hover_parameter)
    found = f"none named: {kind.name}, {kind.mass_kg * 1e3:.0f} g, hovers at {kind.hover_thrust_norm:.2f}"
    reported = "" if value is None else f"; the drone says {model.table.hover_parameter} = {value:.2f}"
    differs = value is not None and abs(value - kind.hover_thrust_norm) > HOVER_WITHIN * kind.hover_thrust_norm
    why = f"it is flown as that vehicle{reported}: write its profile in the lab file"
    return Finding(report.name, "profile", Grade.FAIL if differs else Grade.WARN, found, "a name", why)


def refitted(profile: VehicleProfile, hover_norm: float, sysid: int) -> Refit:
    """The profile with the thrust that makes it hover at `hover_norm`; its mass, its curve and all else stay."""
    share = (1.0 - profile.thrust_curve) * hover_norm + profile.thrust_curve * hover_norm**2
    name = f"{profile.name}_{sysid}"
    fitting = profile.model_copy(update={"name": name, "thrust_max_n": float(f"{profile.weight_n / share:.4g}")})
    return Refit(sysid, name, dump_profile(fitting))


def check_signing(name: str, outcome: ProbeOutcome, *, is_bridged: bool) -> Iterator[Finding]:
    """Judge one drone by what it answered; is_bridged: a bridge stands between the network and its autopilot."""
    if outcome.unsigned_answers:
        why = (
            "it has the key and obeys unsigned commands on this link: move the link to another port of the autopilot"
            if outcome.has_key
            else "whoever reaches this network commands it: `gcs keys install FILE --serial DEV:BAUD` gives it the key"
        )
        yield Finding(name, SIGNATURE, Grade.FAIL, "unsigned obeyed", UNSIGNED_REJECTED, why)
    elif outcome.demands_signatures:
        yield Finding(name, SIGNATURE, Grade.PASS, UNSIGNED_REJECTED, UNSIGNED_REJECTED)
    else:
        why = (
            "it answers signed commands neither: it is off, or has another key"
            if outcome.received
            else "nothing came from it"
        )
        yield unmeasured(name, SIGNATURE, UNSIGNED_REJECTED, why, Grade.FAIL)
    always = None if is_bridged or outcome.autopilot is None else ALWAYS_UNSIGNED.get(outcome.autopilot)
    if always is not None:
        why = "its firmware accepts these unsigned, whatever its key: only a bridge (`drone-agent --bridge`) ends them"
        yield Finding(name, "always accepted unsigned", Grade.WARN, always, "nothing", why)


MOVED_M, TURNED_RAD = 0.1, np.radians(30.0)
FAR_MOVE_M = 20.0
ALIGNED_RAD, YAW_WITHIN_RAD = np.radians(12.0), np.radians(12.0)
LEAST_ALIKE = 0.8
DIRECTIONS = ("forward", "left", "up")
AXES = "axes"


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All n bodies at one moment, as the configuration turns them into lab and flu; no pose counts of one not seen."""

    pos_lab_m: Vec3s
    q_lab_from_flu: Quats
    seen: Flags
    own_q_lab_from_flu: Mapping[int, Quat]
    """By system id, of those autopilots that report it: their gravity is their own, whatever pose they are sent."""


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """One drone moved by hand: looks before the first move and after each of forward, left, up, a left turn, a tip."""

    vehicle: int
    snapshots: tuple[Snapshot, Snapshot, Snapshot, Snapshot, Snapshot, Snapshot]

    def displacement(self, step: int) -> Vec3s:
        """How far every body went in step 0..2, (n, 3)."""
        moved: Vec3s = self.snapshots[step + 1].pos_lab_m - self.snapshots[step].pos_lab_m
        return moved


def check_axes(config: LabConfig, moved: Sequence[Moves]) -> tuple[Finding, ...]:
    """Judge every drone's moves."""
    return tuple(f for moves in moved for f in (*_check_drone(config, moves), _check_autopilot(config, moves)))


def unmoved(config: LabConfig) -> tuple[Finding, ...]:
    """What is left unproven of every drone where no camera sees the moves: nobody is asked to make them."""
    why = "no frames to see moves by hand in"
    names = (config.vehicles[i].body for i in config.commanded)
    return tuple(unmeasured(name, AXES, "x, y, z", why, Grade.FAIL) for name in names)


def _check_autopilot(config: LabConfig, moves: Moves) -> Finding:
    """Whether the autopilot in the drone that was tipped is the one that the lab file names."""
    vehicle, (*_, before, after) = config.vehicles[moves.vehicle], moves.snapshots
    found = tipped_sysids(before, after)
    wanted = str(vehicle.sysid)
    if not found:
        return unmeasured(vehicle.body, "system id", wanted, "no autopilot reports that it was tipped: repeat")
    bodies = {each.sysid: each.body for each in config.vehicles}
    names = ", ".join(f"{bodies[sysid]}'s {sysid}" for sysid in found)
    why = f"the drone in your hand answers as {names}: system ids are swapped"
    return graded(vehicle.body, "system id", ", ".join(map(str, found)), wanted, found == [vehicle.sysid], why)


def tipped_sysids(before: Snapshot, after: Snapshot) -> list[int]:
    """The system ids of the autopilots that report that they were tipped meanwhile."""
    level, tipped = before.own_q_lab_from_flu, after.own_q_lab_from_flu
    risen_rad = {sysid: _tilt_rad(tipped[sysid]) - _tilt_rad(level[sysid]) for sysid in level.keys() & tipped.keys()}
    return sorted(sysid for sysid, rise_rad in risen_rad.items() if rise_rad > TIPPED_RAD)


def _tilt_rad(q_lab_from_flu: Quats | Quat) -> Float:
    """How far bodies (..., 4) are from level, rad."""
    x, y = q_lab_from_flu[..., 1], q_lab_from_flu[..., 2]
    tilt_rad: Float = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
    return tilt_rad


def _check_drone(config: LabConfig, moves: Moves) -> Iterator[Finding]:
    name = config.vehicles[moves.vehicle].body
    steps = [moves.displacement(k) for k in range(3)]
    seen = np.all([snapshot.seen for snapshot in moves.snapshots], axis=0)
    travel = np.where(seen, np.sum([np.linalg.norm(step, axis=-1) for step in steps], axis=0), 0.0)
    mover = int(np.argmax(travel))
    if travel[mover] < MOVED_M and not seen[moves.vehicle]:
        yield unmeasured(name, AXES, "x, y, z", "the mocap lost it while it was moved: repeat", Grade.FAIL)
        return
    if travel[mover] < MOVED_M:
        yield Finding(name, "body name", Grade.FAIL, "no body moved", name, "is this the drone that was moved?")
        return
    found = config.vehicles[mover].body
    why = f"the drone that was moved is {found} for the mocap: bodies are swapped"
    yield graded(name, "body name", found, name, mover == moves.vehicle, why)
    paths = np.stack([step[mover] for step in steps])
    if float(np.abs(paths).max()) > FAR_MOVE_M:
        size = f"{np.abs(paths).max():.0f} m by hand"
        yield Finding(name, "units", Grade.FAIL, size, "metres", "the mocap sends millimetres: set it to metres")
        paths = paths * 1e-3
    square = yield from _check_directions(config, name, paths)
    if square:
        yield from _check_yaw(config, moves, mover, paths[0])


def _check_directions(config: LabConfig, name: str, paths: Float) -> Generator[Finding, None, bool]:
    """Whether forward, left and up came out along x, y and z; else which rotation would put them there."""
    lengths = np.linalg.norm(paths, axis=-1)
    short = [DIRECTIONS[k] for k in range(3) if lengths[k] < MOVED_M]
    if short:
        yield Finding(name, AXES, Grade.FAIL, f"hardly moved {short[0]}", "a third of a metre", "move it farther")
        return False
    seen = (paths / lengths[:, None]).T  # columns: where forward, left and up went
    turn, alike = _nearest_turn(seen)
    if alike < LEAST_ALIKE:
        yield Finding(
            name, AXES, Grade.FAIL, _directions(seen), "x, y, z", "moves are not square to each other: repeat"
        )
        return False
    if np.linalg.det(turn) < 0.0:
        yield Finding(
            name, AXES, Grade.FAIL, _directions(seen), "x, y, z", "mirrored: the mocap's axes are left-handed"
        )
        return False
    if not np.array_equal(turn, np.eye(3)):
        q_lab_from_mocap = _rotation_to_write(config, turn)
        why = f"{_turn_words(turn)}: q_lab_from_mocap = [{', '.join(f'{x:.4f}' for x in q_lab_from_mocap)}]"
        yield Finding(name, AXES, Grade.FAIL, _directions(seen), "x, y, z", why)
        return False
    off = float(np.arccos(np.clip((np.trace(seen) - 1.0) / 2.0, -1.0, 1.0)))
    found = f"{_directions(seen)}, {np.degrees(off):.0f} deg off"
    yield graded(name, AXES, found, "x, y, z", off <= ALIGNED_RAD, "nose not along x, or axes a little turned", True)
    return True


def _check_yaw(config: LabConfig, moves: Moves, mover: int, forward: Vec3) -> Iterator[Finding]:
    """Whether the body's heading is where its nose went, and turns left when it is turned left."""
    name = config.vehicles[moves.vehicle].body
    q_before, q_after = moves.snapshots[3].q_lab_from_flu[mover], moves.snapshots[4].q_lab_from_flu[mover]
    nose = float(np.arctan2(forward[1], forward[0]))
    zero = float(frames.wrap_angle(frames.yaw(moves.snapshots[0].q_lab_from_flu[mover]) - nose))
    q_marker_from_flu = _alignment_to_write(config, mover, moves.snapshots[0].q_lab_from_flu[mover], nose)
    why = f"q_marker_from_flu = [{', '.join(f'{x:.4f}' for x in q_marker_from_flu)}]"
    found = f"{np.degrees(zero):+.0f} deg"
    yield graded(name, "yaw zero", found, "0 deg along the nose", abs(zero) <= YAW_WITHIN_RAD, why)
    turned = float(frames.wrap_angle(frames.yaw(q_after) - frames.yaw(q_before)))
    why = "turned right, or not enough: the marker frame is upside down, or the turn too small"
    yield graded(name, "turns left", f"{np.degrees(turned):+.0f} deg", "about +90 deg", turned >= TURNED_RAD, why)


def _nearest_turn(seen: Float) -> tuple[Float, float]:
    """The nearest signed permutation of the axes (a turn by right angles, or a mirror), and how alike it is, 0..1."""
    best, best_alike = np.eye(3), -1.0
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[list(order), range(3)] = signs
            alike = float(np.sum(turn * seen, axis=0).min())
            if alike > best_alike:
                best, best_alike = turn, alike
    return best, best_alike


def _directions(seen: Float) -> str:
    """ "x, y, z" for moves that went forward, left and up."""
    words = []
    for k in range(3):
        axis = int(np.argmax(np.abs(seen[:, k])))
        words.append(("" if seen[axis, k] > 0.0 else "-") + "xyz"[axis])
    return ", ".join(words)


def _turn_words(turn: Float) -> str:
    if np.array_equal(turn[:, 2], [0.0, 1.0, 0.0]):
        return "the mocap is y-up"
    if turn[2, 2] == 1.0:
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))
        return f"the mocap frame is turned by {angle:.0f} degrees about up"
    return "the mocap's axes are permuted"


def _rotation_to_write(config: LabConfig, turn: Float) -> Float:
    """The q_lab_from_mocap that undoes `turn` on top of the configured one."""
    configured = frames.matrix(frames.canonical(np.array(config.mocap.q_lab_from_mocap)))
    return _quaternion(turn.T @ configured)


def _alignment_to_write(config: LabConfig, mover: int, q_lab_from_flu: Float, nose_rad: float) -> Float:
    """The q_marker_from_flu under which the body, as it stood, points where its nose went."""
    configured = frames.canonical(np.array(config.vehicles[mover].q_marker_from_flu))
    q_lab_from_marker = frames.multiply(q_lab_from_flu, frames.inverse(configured))
    return frames.canonical(frames.multiply(frames.inverse(q_lab_from_marker), frames.from_yaw(np.array(nose_rad))))


def _quaternion(rotation: Float) -> Float:
    """The quaternion of a rotation matrix: the eigenvector of its symmetric 4 x 4 form (Bar-Itzhack, 2000)."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    _, vectors = np.linalg.eigh(k)
    return frames.canonical(vectors[:, -1])
