"""Checks of the mocap from some seconds of frames, with the drones at rest. Pure."""

from collections.abc import Iterator, Sequence

import numpy as np

from formation.config import LabConfig, MocapConfig
from formation.maths.arrays import Bool, Float
from formation.messages import LabFrame
from formation.safety.rules import nearest, outside_box
from gcs.finding import Finding, Grade, graded, unmeasured
from mocap.figures import noise_m, timing

Received = tuple[int, LabFrame]

RATE_WITHIN = 0.1
JITTER_SHARE, LOST_SHARE, SEEN_SHARE = 0.5, 0.02, 0.95
NOISE_M = 0.001
DELAY_WITHIN_S, DELAY_LEAST_S = 0.01, 0.001
MILLIMETRES_M = 50.0
LEVEL_RAD, ON_SIDE_RAD = np.radians(8.0), np.radians(60.0)
FLOOR_M = 0.1
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
    simulated = config.mocap.source == "mavlink"  # of no camera: a busy computer's, which the flight may still carry
    fair, most = found.jitter_s <= JITTER_SHARE / wanted_hz, f"under {500.0 / wanted_hz:.1f} ms"
    yield graded(MOCAP, "jitter", f"{found.jitter_s * 1e3:.2f} ms", most, fair, "uneven frames", simulated)
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
    if source in ("csv", "mavlink"):
        return unmeasured(MOCAP, check, wanted, f'source "{source}" numbers no frames: what is lost does not show')
    return graded(MOCAP, check, f"{lost:.1%}", wanted, lost <= LOST_SHARE, "network or cameras", fair=True)


def _delay(mocap: MocapConfig, delay_s: float) -> Finding:
    """From exposure to receipt, where frames say when they were exposed; else it is only what the lab file says."""
    check, wanted = "delay", f"{mocap.delay_s * 1e3:.1f} ms"
    if mocap.source in ("csv", "mcap", "mavlink"):
        return unmeasured(
            MOCAP, check, wanted, f'source "{mocap.source}" reports no exposure time: mocap.delay_s is used'
        )
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
        if config.mocap.source != "mavlink":  # a simulator's true pose has no noise: one at rest is the same each time
            yield _noise(vehicle.body, pos[seen[:, i], i])
        x, y = q[seen[:, i], i, 1], q[seen[:, i], i, 2]
        tilt = float(np.median(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))))
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
