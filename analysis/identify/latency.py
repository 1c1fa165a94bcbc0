"""How much older the mocap's poses are than their stamps say, held against the autopilot's own attitude.

VRPN and QTM stamp frames up to a constant. A drone that leans tells its attitude by its own sensors, on a clock that
TIMESYNC lays beside the ground's: the shift at which both show gravity alike is that constant. Gravity in the body's
axes needs no heading; how the markers lie on the body is a constant difference, and fitted along.
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
from wire.link_messages.clocks import TimeSync
from wire.link_messages.motion import Attitude, AttitudeQuaternion

MOST_S = 0.1
GAP_S = 0.1
"""Attitudes farther apart say nothing of what is between them."""
LEAST, LEAST_LEAN = 200, 5e-3

Told = tuple[Float, Float]


def told(flight: Flight) -> dict[int, Told]:
    """What each drone said of its attitude, by sysid: times on the flight's clock, s (K,), and `_up` of it (K, 2)."""
    sent_s = {
        (sysid, message.ts1_ns): t_s
        for t_s, sysid, message in from_ground(flight)
        if isinstance(message, TimeSync) and message.tc1_ns == 0
    }
    offsets: dict[int, ClockOffset] = {}
    said: dict[int, list[tuple[int, Float]]] = {}
    for t_s, sysid, message in from_drones(flight):
        if isinstance(message, TimeSync) and (sysid, message.ts1_ns) in sent_s:
            asked_ns = round(1e9 * sent_s[sysid, message.ts1_ns])
            offsets.setdefault(sysid, ClockOffset()).exchange(asked_ns, message.tc1_ns, round(1e9 * t_s))
        elif isinstance(message, AttitudeQuaternion | Attitude):
            said.setdefault(sysid, []).append((message.t_boot_ms, np.asarray(message.q_lab_from_flu)))
    return {sysid: _on_our_clock(said[sysid], offset) for sysid, offset in offsets.items() if sysid in said}


def late(flight: Flight, vehicle: Vehicle, own: Told | None) -> Estimate | str:
    """By how much, s, of one vehicle's poses; or why it cannot be told. To be added to `mocap.latency_s`."""
    if own is None or len(own[0]) < LEAST:
        return "the autopilot told too little of its own attitude"
    index, poses = flight.vehicles.index(vehicle), flight.poses
    flown = poses.seen[:, index] & airborne(flight, poses.t_s)
    own_s, own_down = own
    t_s = poses.t_s[flown]
    after = np.clip(np.searchsorted(own_s, t_s), 1, len(own_s) - 1)
    near = (own_s[after] - own_s[after - 1] < GAP_S) & (t_s > own_s[0] + MOST_S) & (t_s < own_s[-1] - MOST_S)
    t_s, shown = t_s[near], _up(poses.q_lab_from_flu[flown, index][near])
    if len(t_s) < LEAST or float(np.std(shown, axis=0).max()) < LEAST_LEAN:
        return "it hardly leant"

    def residual(parameters: Float) -> Float:
        when = t_s - parameters[0]
        felt = np.stack([np.interp(when, own_s, own_down[:, axis]) for axis in range(2)], axis=1)
        apart: Float = (shown - felt - parameters[1:]).T.ravel()
        return apart

    start = np.concatenate([[0.0], np.median(shown, axis=0) - np.median(own_down, axis=0)])
    found = least_squares(residual, start, bounds=([-MOST_S, -1.0, -1.0], [MOST_S, 1.0, 1.0]),
                          diff_step=[1e-3] * 3, x_scale=[0.01] * 3)  # fmt: skip
    spread = covariance(np.asarray(found.jac), found.fun, np.tile(t_s, 2))
    return about(float(found.x[0]), float(np.sqrt(spread[0, 0])))


def _on_our_clock(said: list[tuple[int, Float]], offset: ClockOffset) -> Told:
    """Rising in time; a stamp that comes again is left out."""
    newest: dict[int, Float] = dict(said)
    boot_ms = sorted(newest)
    times_s = np.array([1e-9 * (offset.to_ours_ns(1_000_000 * ms) or 0) for ms in boot_ms])
    return times_s, _up(np.array([newest[ms] for ms in boot_ms]))


def _up(q_lab_from_flu: Float) -> Float:
    """Up in the body's axes, x and y: (..., 2)."""
    return frames.rotate(frames.inverse(q_lab_from_flu), UP)[..., :2]
