"""The latency of the mocap's poses against their stamps, estimated from the autopilot's own attitude.

VRPN and QTM stamp frames with an unknown constant delay. The autopilot reports its own attitude, and TIMESYNC gives its
clock against the ground's. The time shift that best aligns the direction of gravity in both is that delay. Gravity in
body axes needs no heading. The marker frame's tilt on the body is a constant, which is fitted too.
"""

import numpy as np
from scipy.optimize import least_squares

from analysis.identify.estimate import Estimate, about, covariance
from analysis.identify.signals import UP
from analysis.load import Flight, Vehicle
from analysis.packets import from_drones, from_ground
from analysis.tracking import airborne
from formation.maths import frames
from formation.maths.arrays import Float
from wire.clock_offset import ClockOffset
from wire.link_messages import Attitude, AttitudeQuaternion, TimeSync

MOST_S = 0.1
GAP_S = 0.1
"""No interpolation between attitudes farther apart than this."""
LEAST, TILT_MIN = 200, 5e-3

Attitudes = tuple[Float, Float]


def attitudes_of(flight: Flight) -> dict[int, Attitudes]:
    """The attitudes that each drone reported, by sysid: times on the flight's clock, s (K,), and their `_up` (K, 2)."""
    sent_s = {
        (sysid, message.ts1_ns): t_s
        for t_s, sysid, message in from_ground(flight)
        if isinstance(message, TimeSync) and message.tc1_ns == 0
    }
    offsets: dict[int, ClockOffset] = {}
    reported: dict[int, list[tuple[int, Float]]] = {}
    for t_s, sysid, message in from_drones(flight):
        if isinstance(message, TimeSync) and (sysid, message.ts1_ns) in sent_s:
            asked_ns = round(1e9 * sent_s[sysid, message.ts1_ns])
            offsets.setdefault(sysid, ClockOffset()).exchange(asked_ns, message.tc1_ns, round(1e9 * t_s))
        elif isinstance(message, AttitudeQuaternion | Attitude):
            reported.setdefault(sysid, []).append((message.t_boot_ms, np.asarray(message.q_lab_from_flu)))
    return {sysid: _on_our_clock(reported[sysid], offset) for sysid, offset in offsets.items() if sysid in reported}


def late(flight: Flight, vehicle: Vehicle, own: Attitudes | None) -> Estimate | str:
    """The latency, s, of one vehicle's poses, to be added to `mocap.latency_s`; or why there is no estimate."""
    if own is None or len(own[0]) < LEAST:
        return "the autopilot reported too few attitudes"
    index, poses = flight.vehicles.index(vehicle), flight.poses
    flown = poses.seen[:, index] & airborne(flight, poses.t_s)
    own_s, own_down = own
    t_s = poses.t_s[flown]
    after = np.clip(np.searchsorted(own_s, t_s), 1, len(own_s) - 1)
    near = (own_s[after] - own_s[after - 1] < GAP_S) & (t_s > own_s[0] + MOST_S) & (t_s < own_s[-1] - MOST_S)
    t_s, shown = t_s[near], _up(poses.q_lab_from_flu[flown, index][near])
    if len(t_s) < LEAST or float(np.std(shown, axis=0).max()) < TILT_MIN:
        return "it hardly leant"

    def residual(parameters: Float) -> Float:
        when = t_s - parameters[0]
        own_at = np.stack([np.interp(when, own_s, own_down[:, axis]) for axis in range(2)], axis=1)
        residuals: Float = (shown - own_at - parameters[1:]).T.ravel()
        return residuals

    start = np.concatenate([[0.0], np.median(shown, axis=0) - np.median(own_down, axis=0)])
    found = least_squares(residual, start, bounds=([-MOST_S, -1.0, -1.0], [MOST_S, 1.0, 1.0]),
                          diff_step=[1e-3] * 3, x_scale=[0.01] * 3)  # fmt: skip
    cov = covariance(np.asarray(found.jac), found.fun, np.tile(t_s, 2))
    return about(float(found.x[0]), float(np.sqrt(cov[0, 0])))


def _on_our_clock(reported: list[tuple[int, Float]], offset: ClockOffset) -> Attitudes:
    """Rising in time; a stamp that comes again is left out."""
    newest: dict[int, Float] = dict(reported)
    boot_ms = sorted(newest)
    times_s = np.array([1e-9 * (offset.to_ours_ns(1_000_000 * ms) or 0) for ms in boot_ms])
    return times_s, _up(np.array([newest[ms] for ms in boot_ms]))


def _up(q_lab_from_flu: Float) -> Float:
    """Up in the body's axes, x and y: (..., 2)."""
    return frames.rotate(frames.inverse(q_lab_from_flu), UP)[..., :2]
