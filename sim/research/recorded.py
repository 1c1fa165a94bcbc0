"""A recorded flight, taken apart to be flown again: its frames, its vehicles, and what acted on them from outside.

The model of each vehicle is flown open loop with the recorded setpoints, on the recorded path; a smoother finds the
acceleration that is left (formation.estimation.smoother). What the poses show beside model and smoothed path is the
cameras' noise and the attitude's disturbance. Flown again with all of it, the same law gives the same flight.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.identify import response, thrust
from analysis.identify.sensing import attitudes_of, scatter
from analysis.identify.signals import UP, Sent, seen, sent
from analysis.identify.vehicle import Identified
from analysis.load import Flight
from analysis.series import nearest
from analysis.tracking import airborne
from formation.config import LabConfig
from formation.estimation.smoother import Smoothed, smooth
from formation.maths import frames
from formation.maths.arrays import Bool, Float, Quat, Quats
from formation.maths.records import Rows, chosen, copied
from formation.messages import Phase, Verb
from formation.vehicle.profile import VehicleProfile
from sim.research.host import GUST_NS, FlownVehicle, Vehicles, order
from sim.scenario import LinkModel, Pose, Scenario, TrueVehicle
from sim.world import T0_NS

GUST_S = GUST_NS * 1e-9
NOISE_LEAST_M = 1e-5
CLEAR = 2.0
"""The model is flown this many wheelbases above the floor at least: no foot touches it."""
CERTAIN = 0.3
"""An identified response counts whose length is known within this share; else the profile of the lab does."""
AS_ARMED = frozenset({Verb.STATUS, Verb.ARM, Verb.TAKE_CONTROL, Verb.TAKEOFF, Verb.START, Verb.ACKNOWLEDGE})
"""Requests that leave the plan as its phases say."""
Times = NDArray[np.int64]


class RecordedError(ValueError):
    """A log that cannot be flown again; the text says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A flight of n bodies, m of them commanded, at T frames; times as the host of studies counts them, ns.

    capture_ns, receive_ns (T); pos_lab_m (T, n, 3), q_lab_from_flu (T, n, 4), seen (T, n): the poses.
    noise_m (T, m, 3), turn (T, m, 4): what they show beside the smoothed path and the model's attitude.
    wind (K, m, 3): the disturbance every GUST_NS; known_hz (m, 3): up to there it is known.
    flown: the vehicles at begin_ns, from where they are simulated, until end_ns; attitudes: their own ones before it,
    as they arrive, (arrival, time, (m, 4)); none where the log has none.
    phases: when each began; trajectory_ns: when the leader's trajectory did. identified (m): whether the vehicle's
    response was found in this flight. cut: why not all of the formation is flown, in words.
    """

    lab: LabConfig
    scenario: Scenario
    capture_ns: Times
    receive_ns: Times
    pos_lab_m: Float
    q_lab_from_flu: Quats
    seen: Bool
    noise_m: Float
    turn: Float
    wind: Float
    known_hz: Float
    flown: Rows[FlownVehicle]
    begin_ns: int
    end_ns: int
    attitudes: tuple[tuple[int, int, Quats], ...]
    phases: tuple[tuple[int, Phase], ...]
    trajectory_ns: int | None
    identified: tuple[bool, ...]
    cut: str

    def without(self, body: str) -> "Recorded":
        """The same flight without that follower; RecordedError where there is none, or no other."""
        lab = self.lab
        followers = tuple(follower for follower in lab.followers if follower.body != body)
        if len(followers) in (0, len(lab.followers)):
            names = ", ".join(follower.body for follower in lab.followers)
            raise RecordedError(f"--without {body}: one of several followers is wanted; there are {names}")
        commanded = np.array([lab.vehicles[i].body != body for i in lab.commanded])
        bodies = np.array([vehicle.body != body for vehicle in lab.vehicles])
        lab = lab.model_copy(update={"followers": followers})
        known = {vehicle.sysid for vehicle in lab.vehicles}
        vehicles = tuple(v for v in self.scenario.vehicles if v.sysid in known)
        return replace(
            self,
            lab=lab,
            scenario=self.scenario.model_copy(update={"lab": lab, "vehicles": vehicles}),
            pos_lab_m=self.pos_lab_m[:, bodies],
            q_lab_from_flu=self.q_lab_from_flu[:, bodies],
            seen=self.seen[:, bodies],
            noise_m=self.noise_m[:, commanded],
            turn=self.turn[:, commanded],
            wind=np.ascontiguousarray(self.wind[:, commanded]),
            known_hz=self.known_hz[commanded],
            flown=chosen(self.flown, commanded),
            attitudes=tuple((at, t, q[commanded]) for at, t, q in self.attitudes),
            identified=tuple(k for k, stays in zip(self.identified, commanded, strict=True) if stays),
        )


def reconstruct(flight: Flight) -> Recorded:
    """The flight's parts; RecordedError where its log does not hold them."""
    lab = flight.run.lab
    if lab is None:
        raise RecordedError("the log does not hold its lab")
    begin_ns, end_ns, cut = _span(flight)
    poses = flight.poses
    arrived = np.argsort(poses.received_s, kind="stable")
    newest_s = np.maximum.accumulate(np.append(-1e-9, poses.t_s[arrived]))  # one that a newer one overtook is not flown
    fresh = arrived[poses.t_s[arrived] > newest_s[:-1]]
    capture_s, seen_at = poses.t_s[fresh], poses.seen[fresh]
    drones = np.array(lab.commanded)
    targets = [_sent(flight, lab.vehicles[i].sysid or 0, column) for column, i in enumerate(lab.commanded)]
    known = [_identified(flight, i, of) for i, of in zip(lab.commanded, targets, strict=True)]
    scenario = _scenario(lab, flight, [profile for profile, _, _ in known], [delay_s for _, delay_s, _ in known])
    pos, q = poses.pos_lab_m[fresh], poses.q_lab_from_flu[fresh]
    own, telemetry = attitudes_of(flight), bool(flight.up.t_s.size)
    turns = np.array([_own_turn(flight, i, own.get(lab.vehicles[i].sysid or 0)) for i in lab.commanded])
    series = pos[:, drones].reshape(len(capture_s), -1).T
    visible = np.repeat(seen_at[:, drones], 3, axis=1).T
    noise_m = np.repeat([_noise_m(capture_s[seen_at[:, i]], pos[seen_at[:, i], i]) for i in drones], 3)
    path = smooth(capture_s, series, visible, np.zeros((len(series), len(capture_s) - 1)), noise_m)
    model = _Model(scenario, turns, targets)
    open_loop = model.fly(capture_s, path, q[:, drones], begin_ns, end_ns)
    acc = _between(capture_s, open_loop.acc_lab_m_s2)
    path = smooth(capture_s, series, visible, acc, noise_m)
    shape = (len(drones), 3)
    middles_s = GUST_S * (np.arange(len(open_loop.acc_lab_m_s2)) + 0.5)
    return Recorded(
        lab=lab,
        scenario=scenario,
        capture_ns=_ns(capture_s),
        receive_ns=_ns(poses.received_s[fresh]),
        pos_lab_m=pos,
        q_lab_from_flu=q,
        seen=seen_at,
        noise_m=(series - path.pos_m).T.reshape(-1, *shape),
        turn=frames.multiply(frames.inverse(open_loop.q_lab_from_flu), q[:, drones]),
        wind=np.stack([np.interp(middles_s, capture_s, d) for d in path.dist_m_s2], axis=1).reshape(-1, *shape),
        known_hz=path.known_hz.reshape(shape),
        flown=open_loop.flown,
        begin_ns=begin_ns,
        end_ns=end_ns,
        attitudes=open_loop.attitudes if telemetry else (),
        phases=tuple((int(_ns(span.start_s)), span.phase) for span in flight.phases),
        trajectory_ns=_trajectory_ns(flight),
        identified=tuple(found for _, _, found in known),
        cut=cut,
    )


def _ns(t_s: Float | float) -> Times:
    """Of a log's seconds, in the host's time."""
    t_ns: Times = np.rint(np.asarray(t_s) * 1e9).astype(np.int64) + T0_NS
    return t_ns


def _span(flight: Flight) -> tuple[int, int, str]:
    """From when and until when it is flown again, and why not to the end of its formation."""
    formation, hold = flight.spans(Phase.FORMATION), flight.spans(Phase.HOLD)
    if not formation or not len(flight.poses) or not len(flight.reference):
        raise RecordedError("the log holds no flight in formation")
    first = formation[0]
    before = [span.start_s for span in hold if span.start_s < first.start_s]
    end_s, cut = first.end_s, ""
    for t_s, request in zip(flight.requests.t_s.tolist(), flight.requests.messages, strict=True):
        if first.start_s < t_s < end_s and request.verb not in AS_ARMED | {Verb.HOLD, Verb.LAND, Verb.STOP}:
            end_s, cut = t_s, f"`{request.verb}` at {t_s:.1f} s, after which the plan is another"
    begin_ns = int(_ns(before[-1] if before else first.start_s))
    return begin_ns + -(begin_ns - T0_NS) % GUST_NS, int(_ns(end_s)), cut


def _sent(flight: Flight, sysid: int, column: int) -> Sent:
    """The setpoints that one drone was sent; of a study, which has no links, its targets as their frames arrived."""
    if len(flight.down):
        found = sent(flight).get(sysid)
        if found is None:
            raise RecordedError(f"the log holds no setpoint for the drone of sysid {sysid}")
        return found
    target, poses = flight.target, flight.poses
    t_s = poses.received_s[nearest(poses.t_s, target.t_s)]
    return Sent(t_s, target["q_lab_from_flu"][:, column], target["rate_flu_rad_s"][:, column],
                target["thrust_norm"][:, column])  # fmt: skip


def _identified(flight: Flight, index: int, of: Sent) -> tuple[VehicleProfile, float, bool]:
    """A vehicle as this flight shows it, the delay of its link, s, and whether its response could be found."""
    lab = flight.run.lab
    assert lab is not None
    vehicle, base = flight.vehicles[index], lab.profile_of(lab.vehicles[index])
    saw = seen(flight, vehicle)
    found = response.fit(of, saw)
    if isinstance(found, str) or found.dead_time_s.half_width + found.lag_s.half_width > CERTAIN * (
        found.dead_time_s.value + found.lag_s.value
    ):
        return base, LinkModel().down_s, False
    fitted = thrust.fit(of, saw, found.delay_s.value, found.motor_lag_s.value)
    profile = Identified(vehicle, base, found, fitted, drag="", late_s="").profile()
    return profile, max(found.delay_s.value - profile.command_delay_s, 0.0), True


def _scenario(lab: LabConfig, flight: Flight, profiles: list[VehicleProfile], delays_s: list[float]) -> Scenario:
    """The vehicles as identified, beyond links of the least delay, without air."""
    vehicles = []
    for i, profile, delay_s in zip(lab.commanded, profiles, delays_s, strict=True):
        x, y, _ = flight.poses.pos_lab_m[0, i].tolist()
        true = profile.model_dump(exclude={"name", "battery", "gain_scale"})
        true["command_delay_s"] += delay_s - min(delays_s)
        start = Pose(pos_lab_m=(x, y, 0.0))
        vehicles.append(TrueVehicle(sysid=lab.vehicles[i].sysid or 0, start=start, vehicle=true))
    link = LinkModel(down_s=min(delays_s), jitter_s=0.0)
    return Scenario(name=flight.run.scenario or "flight", lab=lab, vehicles=tuple(vehicles), link=link)


def _noise_m(t_s: Float, pos_m: Float) -> float:
    found = scatter(t_s, pos_m)
    return NOISE_LEAST_M if found is None else max(found.value, NOISE_LEAST_M)


def _own_turn(flight: Flight, index: int, own: tuple[Float, Float] | None) -> Quat:
    """How an autopilot's own axes lie in the body's, level alone: by the attitudes that it reported."""
    if own is None or not len(own[0]):
        return frames.IDENTITY.copy()
    poses = flight.poses
    flown = poses.seen[:, index] & airborne(flight, poses.t_s)
    shown = frames.rotate(frames.inverse(poses.q_lab_from_flu[flown, index]), UP)[:, :2]
    reported = np.stack([np.interp(poses.t_s[flown], own[0], up) for up in own[1].T], axis=1)
    x, y = np.median(shown - reported, axis=0)
    return frames.from_rotation_vector(np.array([-y, x, 0.0]))


def _trajectory_ns(flight: Flight) -> int | None:
    """When the leader's trajectory began: when the frame arrived after which it is led along it, at rest at first.

    So the frame for which its reference moves is the second after it.
    """
    span, reference = flight.spans(Phase.FORMATION)[0], flight.reference
    if flight.leader.column is None:
        return None
    moves = reference["slot_vel_lead_m_s"][:, flight.leader.column].any(axis=-1)
    moving = reference.t_s[moves & (reference.t_s > span.start_s) & (reference.t_s <= span.end_s)]
    if not len(moving):
        return None
    first = int(nearest(flight.poses.t_s, moving[:1])[0])
    return int(_ns(flight.poses.received_s[max(first - 2, 0)]))


def _between(t_s: Float, acc_lab_m_s2: Float) -> Float:
    """Means from each time to the next, (S, T - 1), of what is held over each GUST_S, (K, m, 3)."""
    swept = np.vstack(
        [
            np.zeros((1, 3 * acc_lab_m_s2.shape[1])),
            GUST_S * np.cumsum(acc_lab_m_s2.reshape(len(acc_lab_m_s2), -1), axis=0),
        ]
    )
    edges_s = GUST_S * np.arange(len(swept))
    at = np.stack([np.interp(t_s, edges_s, column) for column in swept.T])
    means: Float = np.diff(at, axis=1) / np.diff(t_s)
    return means


@dataclass(frozen=True, slots=True, eq=False)
class _OpenLoop:
    """acc_lab_m_s2 (K, m, 3): of the model over each GUST_NS; q_lab_from_flu (T, m, 4): its attitudes at the frames."""

    acc_lab_m_s2: Float
    q_lab_from_flu: Quats
    flown: Rows[FlownVehicle]
    attitudes: tuple[tuple[int, int, Quats], ...]


class _Model:
    """The vehicles' model, led along the recorded path under the recorded setpoints."""

    def __init__(self, scenario: Scenario, turns: Quats, targets: list[Sent]) -> None:
        self._vehicles = Vehicles(scenario, None, 0)
        self._vehicles.flown["q_flu_from_own"] = turns
        profiles = [scenario.lab.profile_of(scenario.lab.vehicles[i]) for i in scenario.lab.commanded]
        self._low_m = np.array([CLEAR * profile.wheelbase_m for profile in profiles])
        inside_s = [dict(vehicle.vehicle)["command_delay_s"] for vehicle in scenario.vehicles]
        late_ns = [round((scenario.link.down_s + float(s)) * 1e9) for s in inside_s]  # type: ignore[arg-type]
        self._due = deque(_merged(targets, late_ns))

    def fly(self, capture_s: Float, path: Smoothed, q: Quats, begin_ns: int, end_ns: int) -> _OpenLoop:
        """Until end_ns; q (T, m, 4): the recorded attitudes, of which the first is where each begins."""
        vehicles, flown, m = self._vehicles, self._vehicles.flown, q.shape[1]
        capture_ns = _ns(capture_s)
        count = int(end_ns - T0_NS) // GUST_NS + 1
        grid_s = GUST_S * np.arange(count)
        pos, vel = (
            np.stack([np.interp(grid_s, capture_s, values) for values in of], axis=1).reshape(count, m, 3)
            for of in (path.pos_m, path.vel_m_s)
        )
        acc, attitude, own = np.zeros((count, m, 3)), q.copy(), list[tuple[int, int, Quats]]()
        flown["x"][:, 6:10] = q[0]
        snapshot, frame = copied(flown), 0
        for k in range(count):
            grid_ns = T0_NS + k * GUST_NS
            flown["x"][:, 0:3], flown["x"][:, 3:6] = pos[k], vel[k]
            if grid_ns == begin_ns:
                snapshot = copied(flown)
            flown["x"][:, 2] = np.maximum(flown["x"][:, 2], self._low_m)
            while self._due and self._due[0][0] < grid_ns + GUST_NS:
                _, q_lab_from_flu, rate, thrust_norm, due_ns = self._due.popleft()
                order(flown, q_lab_from_flu, rate, thrust_norm, due_ns)
            while frame < len(capture_ns) and capture_ns[frame] < grid_ns + GUST_NS:
                attitude[frame] = vehicles.states_at(int(capture_ns[frame]))[vehicles.bodies, 7:11]
                frame += 1
            vehicles.states_at(grid_ns + GUST_NS)
            acc[k] = (flown["x"][:, 3:6] - vel[k]) / GUST_S
            if grid_ns < begin_ns:
                own += [(due_ns, t_ns, q_own) for due_ns, (t_ns, q_own) in vehicles.attitudes.pop_due(begin_ns)]
        return _OpenLoop(acc, attitude, snapshot, tuple(own))


def _merged(targets: list[Sent], late_ns: list[int]) -> Iterator[tuple[int, Quats, Float, Float, Times]]:
    """Every time at which anybody was sent a setpoint, and what `order` takes of it; -1: this drone was sent none."""
    times_ns = [_ns(of.t_s) for of in targets]
    every_ns = np.unique(np.concatenate(times_ns))
    at = [np.clip(np.searchsorted(t, every_ns), 0, len(t) - 1) for t in times_ns]
    q, rate, thrust_norm = (
        np.stack([getattr(of, name)[k] for of, k in zip(targets, at, strict=True)], axis=1)
        for name in ("q_lab_from_flu", "rate_flu_rad_s", "thrust_norm")
    )
    due_ns = np.stack([np.where(t[k] == every_ns, every_ns + late, -1)
                       for t, k, late in zip(times_ns, at, late_ns, strict=True)], axis=1)  # fmt: skip
    return zip(every_ns.tolist(), q, rate, thrust_norm, due_ns, strict=True)
