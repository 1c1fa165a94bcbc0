"""The heading of one vehicle: one FTESO of a heading that we command, several of one that is only observed.

A slot is a lever's length from the leader, so the noise of its heading shakes every follower, and a follower's command
holds only `ahead_s` later. How fast an observer may be is a matter of noise and of what the leader does, so there are
three, and one that takes the heading for constant. Each is judged by what it foretold: its prediction over `ahead_s`,
compared with the heading that is measured then, low-passed as a follower's loop does it. By that the mean square e_k:

    weight_k = (e_least / e_k)^4, sum 1

Noise is in that, because a prediction multiplies it as the command does; and so is a wobble too fast to be followed in
time, which is best not followed. A turn that begins would be found one prediction later. So where an angle is off the
fastest one's by more than noise and its own record explain, no record counts: each observer is then wrong by as much as
its prediction differs from the fastest one's.
"""

from math import exp, pi

import numpy as np

from formation.estimation.observers import NOISE_LAG_S, learned
from formation.estimation.response import SECONDS
from formation.estimation.settings import ObserverSettings
from formation.estimation.state import HeadingBank, VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import heading_of
from formation.paper.eq34_observer import fteso_step

SHARES = np.array((0.04, 0.42, 1.0))
"""Of the bandwidth, of the three observers."""
AMPLIFIED = np.array((0.2, 0.5, 1.0, 0.2))
"""What their predictions, low-passed, make of noise: believed of them before it is known."""
FASTEST, CONSTANT, OBSERVERS = 2, 3, 4
CONSTANT_LAG_S, JUDGED_LAG_S, REMEMBERED_S = 1.0, 0.2, 1.0  # of the constant, of errors, of mean squares
SIGMAS, LEAST_RAD = 4.0, 1e-4  # of noise and record, beyond which an observer is wrong; the least of both


@kernel
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@kernel
def observe_heading(z: VehicleEstimate, seen: bool, dt_s: float, settings: ObserverSettings) -> None:
    """One step of the heading, its angle unwrapped; unseen, the turn asked for alone, and no Z3."""
    heading, gains = z.heading, settings.heading
    psi, rate, dist, turn = heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2, heading.acc_command_rad_s2
    ahead = psi + dt_s * rate + 0.5 * dt_s * dt_s * (turn + dist)
    if not seen:
        heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2 = ahead, rate + dt_s * turn, 0.0
        _wait(z.heading_bank, dt_s)
        return
    y = ahead + wrapped(heading_of(z.q_lab_from_flu) - ahead)
    if settings.commanded_index < 0:
        observe_bank(z, y, dt_s, settings)
    else:
        heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2 = fteso_step(
            psi, rate, dist, turn, y, dt_s, gains.bandwidth_rad_s, gains.alpha, gains.scale, gains.smooth
        )


@kernel
def observe_bank(z: VehicleEstimate, y: float, dt_s: float, settings: ObserverSettings) -> None:
    """All observers of one heading over one step to the measured angle y, and the estimate between them."""
    bank, gains, heading = z.heading_bank, settings.heading, z.heading
    unexpected = y - _after(bank.observed[FASTEST], dt_s)
    bank.noise_rad2 = learned(bank.noise_rad2, unexpected * unexpected, 1.0 - exp(-dt_s / NOISE_LAG_S), LEAST_RAD)
    for k in range(OBSERVERS):
        one = bank.observed[k]
        if k == CONSTANT:
            one[0] += (1.0 - exp(-dt_s / CONSTANT_LAG_S)) * (y - one[0])
        else:
            w = SHARES[k] * gains.bandwidth_rad_s
            one[0], one[1], one[2] = fteso_step(
                one[0], one[1], one[2], 0.0, y, dt_s, w, gains.alpha, gains.scale, gains.smooth
            )
    _judge(bank, z.t_ns, y, dt_s, settings.ahead_s)
    _foretell(bank, z.t_ns, dt_s, settings.ahead_s)
    weight = np.empty(OBSERVERS)
    _weights(bank, bank.noise_rad2 * min(gains.bandwidth_rad_s * dt_s, 1.0), settings.ahead_s, weight)
    heading.yaw_rad, heading.rate_rad_s, heading.dist_rad_s2 = 0.0, 0.0, 0.0
    for k in range(OBSERVERS):
        heading.yaw_rad += weight[k] * bank.observed[k, 0]
        heading.rate_rad_s += weight[k] * bank.observed[k, 1]
        heading.dist_rad_s2 += weight[k] * bank.observed[k, 2]


@kernel
def _after(one: Float, after_s: float) -> float:
    """The angle after that time, of one observer (3)."""
    angle: float = one[0] + after_s * (one[1] + 0.5 * after_s * one[2])
    return angle


@kernel
def _judge(bank: HeadingBank, now_ns: int, y: float, dt_s: float, ahead_s: float) -> None:
    """Compares what was foretold for the time since the last frame with what is measured, y now."""
    low = bank.measured_rad + (1.0 - exp(-dt_s / JUDGED_LAG_S)) * (y - bank.measured_rad)
    share = 1.0 - exp(-ahead_s / len(bank.earlier_ns) / REMEMBERED_S)
    for slot in range(len(bank.earlier_ns)):
        late_s = (now_ns - bank.earlier_ns[slot]) * SECONDS - ahead_s
        if bank.earlier_ns[slot] > 0 and late_s >= 0.0:
            bank.earlier_ns[slot] = 0
            then = low + min(late_s / dt_s, 1.0) * (bank.measured_rad - low)
            for k in range(OBSERVERS):
                error = then - bank.earlier_rad[slot, k]
                most = 9.0 * max(bank.square_rad2[k], SIGMAS * SIGMAS * bank.noise_rad2)  # one outlier moves none far
                bank.square_rad2[k] += share * (min(error * error, most) - bank.square_rad2[k])
    bank.measured_rad = low


@kernel
def _foretell(bank: HeadingBank, now_ns: int, dt_s: float, ahead_s: float) -> None:
    """Predicts the angle by every observer, and keeps that in a free slot at even times."""
    share = 1.0 - exp(-dt_s / JUDGED_LAG_S)
    for k in range(OBSERVERS):
        bank.foretold_rad[k] += share * (_after(bank.observed[k], ahead_s) - bank.foretold_rad[k])
    free, newest_ns, slots = -1, 0, len(bank.earlier_ns)
    for slot in range(slots):
        newest_ns = max(newest_ns, bank.earlier_ns[slot])
        if bank.earlier_ns[slot] == 0:
            free = slot
    if free >= 0 and (newest_ns == 0 or (now_ns - newest_ns) * SECONDS * slots >= ahead_s):
        bank.earlier_ns[free] = now_ns
        for k in range(OBSERVERS):
            bank.earlier_rad[free, k] = bank.foretold_rad[k]


@kernel
def _weights(bank: HeadingBank, noise_rad2: float, ahead_s: float, weight: Float) -> None:
    """Of every observer, sum 1, into weight; noise: the mean square of what it makes of the fastest one's angle."""
    fastest, least, total, surprise = bank.observed[FASTEST], np.inf, 0.0, 0.0
    for k in range(OBSERVERS):
        weight[k] = max(bank.square_rad2[k], LEAST_RAD * LEAST_RAD)
        now, explained = fastest[0] - bank.observed[k, 0], SIGMAS * SIGMAS * (noise_rad2 + weight[k])
        if now * now > explained:
            surprise = max(surprise, 1.0 - explained / (now * now))
    for k in range(OBSERVERS):
        later = _after(fastest, ahead_s) - _after(bank.observed[k], ahead_s)
        weight[k] += surprise * later * later
        least = min(least, weight[k])
    for k in range(OBSERVERS):
        weight[k] = (least / weight[k]) ** 4
        total += weight[k]
    for k in range(OBSERVERS):
        weight[k] /= total


@kernel
def _wait(bank: HeadingBank, dt_s: float) -> None:
    """Unseen for dt_s: every observer goes on at its rate, and what was foretold is not judged."""
    for slot in range(len(bank.earlier_ns)):
        bank.earlier_ns[slot] = 0
    for k in range(OBSERVERS):
        bank.observed[k, 0] = _after(bank.observed[k], dt_s)
        bank.observed[k, 1] += dt_s * bank.observed[k, 2]
        bank.observed[k, 2] = 0.0
