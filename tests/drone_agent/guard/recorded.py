"""A lockstep flight's recorded streams through the navigator, against truth.

    python -m tests.drone_agent.guard.recorded [scenario ...]

Open loop: a drift is added to recorded poses, which no drone follows.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from drone_agent.guard.navigator import Navigator
from formation import topics
from formation.maths.arrays import Float
from formation.messages import Datagram, LabFrame, Truth
from sim.lockstep import run_in_memory
from sim.scenario import Scenario, load
from wire.clock_offset import SenderClock
from wire.link_messages.address import GROUND
from wire.link_messages.motion import AttitudeQuaternion, InertialSample
from wire.mavlink.codec import Codec

ONE = np.array([0])


@dataclass
class Recorded:
    """One drone's streams: (arrival, stamp, message) of its link, its poses and its truth, our clock."""

    link: list[tuple[int, int, InertialSample | AttitudeQuaternion]] = field(default_factory=list)
    poses: list[tuple[int, int, Float, Float]] = field(default_factory=list)
    truth: list[Truth] = field(default_factory=list)


def flown(name: str, imu_rate_hz: float = 100.0, seed: int = 1) -> dict[int, Recorded]:
    """Fly a shipped scenario in lockstep; the streams of every drone by its sysid."""
    scenario = load(name)
    lab = scenario.lab
    lab = lab.model_copy(update={"link": lab.link.model_copy(update={"imu_rate_hz": imu_rate_hz})})
    scenario = Scenario.model_validate(scenario.model_dump() | {"lab": lab.model_dump()})
    return recorded(scenario, ((e.topic, e.t_ns, e.message) for e in run_in_memory(scenario, seed)[1]))


def recorded(scenario: Scenario, records: Iterable[tuple[topics.Topic, int, object]]) -> dict[int, Recorded]:
    """The streams of every drone in a log's records."""
    bodies = {v.sysid: v.body for v in scenario.lab.vehicles if v.sysid is not None}
    out = {sysid: Recorded() for sysid in bodies}
    codecs = {sysid: Codec(GROUND) for sysid in bodies}
    clocks = {sysid: SenderClock() for sysid in bodies}
    for topic, t_ns, message in records:
        if topic is topics.MOCAP and isinstance(message, LabFrame):
            for sysid, body in bodies.items():
                i = message.bodies.index(body)
                if message.seen[i]:
                    pose = (t_ns, message.t_capture_ns, message.pos_lab_m[i], message.q_lab_from_flu[i])
                    out[sysid].poses.append(pose)
        elif topic is topics.TRUTH and isinstance(message, Truth):
            out[message.sysid].truth.append(message)
        elif topic is topics.LINK_UP and isinstance(message, Datagram):
            for packet in codecs[message.sysid].receive(message.data):
                if isinstance(packet.message, InertialSample | AttitudeQuaternion):
                    m = packet.message
                    stamp_ns = m.t_boot_us * 1000 if isinstance(m, InertialSample) else m.t_boot_ms * 1_000_000
                    made_ns = clocks[message.sysid].made_ns(stamp_ns, t_ns)
                    out[message.sysid].link.append((t_ns, made_ns, m))
    return out


@dataclass(frozen=True)
class Result:
    """Of one drone: when a fault was found (s after the drift began), and its errors while and after that."""

    found_s: float
    names: tuple[str, ...]
    pos_rms_m: float
    vel_rms_m_s: float
    pos_after_m: float


def run(r: Recorded, drift_m_s: float, at_s: float, judged_s: float = 0.5) -> Result:
    """Feeds it in order of arrival; judged_s after the drift began it is held against the truth."""
    nav = Navigator(1, pose_rate_hz=120.0)
    start_ns = r.poses[0][1]
    at_ns, end_ns = start_ns + round(at_s * 1e9), start_ns + round((at_s + judged_s) * 1e9)
    truth_ns = np.array([t.t_ns for t in r.truth])
    inputs = sorted(
        [*((a, 0, k) for k, (a, *_) in enumerate(r.link)), *((a, 1, k) for k, (a, *_) in enumerate(r.poses))]
    )
    found, names, errors = np.nan, [], []
    for _, kind, k in inputs:
        if kind == 0:
            _, made_ns, m = r.link[k]
            if isinstance(m, InertialSample):
                t = np.array([made_ns])
                nav.receive_imu(ONE, t, m.specific_force_flu_m_s2[None], m.rate_flu_rad_s[None])
            else:
                nav.receive_attitude(ONE, np.array([made_ns]), m.q_lab_from_flu[None], m.rate_flu_rad_s[None])
            continue
        _, t_ns, pos, q = r.poses[k]
        if t_ns > end_ns:
            break
        shown = pos + drift_m_s * max(t_ns - at_ns, 0) * 1e-9 * np.array([1.0, 0.0, 0.0])
        nav.receive_pose(ONE, np.array([t_ns]), shown[None], q[None])
        for fault in nav.new_faults():
            names.append(f"{fault.signature.name} at {(fault.t_ns - at_ns) * 1e-9:.2f} s")
            found = (fault.t_ns - at_ns) * 1e-9 if np.isnan(found) else found
        if at_ns - 5_000_000_000 < t_ns <= at_ns:
            x = nav.bodies[0].estimate
            true = r.truth[int(np.argmin(np.abs(truth_ns - x.t_ns)))]
            late_s = (x.t_ns - true.t_ns) * 1e-9
            errors.append(
                [*(x.pos_lab_m - true.pos_lab_m - late_s * true.vel_lab_m_s), *(x.vel_lab_m_s - true.vel_lab_m_s)]
            )
    true = r.truth[int(np.argmin(np.abs(truth_ns - end_ns)))]
    rms = np.sqrt(np.mean(np.square(np.array(errors).reshape(-1, 6)), axis=0)) if errors else np.full(6, np.nan)
    return Result(
        found,
        tuple(names),
        float(np.linalg.norm(rms[:3])),
        float(np.linalg.norm(rms[3:])),
        float(np.linalg.norm(nav.predicted(0, true.t_ns).pos_lab_m - true.pos_lab_m)),
    )


def main() -> None:
    for name in sys.argv[1:] or ["px4_circle", "triangle_circle"]:
        for sysid, r in flown(name).items():
            length_s = (r.poses[-1][1] - r.poses[0][1]) * 1e-9
            print(name, sysid, f"{length_s:.1f} s, {len(r.link)} messages, {len(r.poses)} poses")
            print("  clean:", run(r, 0.0, length_s - 3.0))
            for speed in (0.08, 0.11, 0.15, 0.3):
                for at_s in (12.0, 19.0):
                    print("  drift", speed, "at", at_s, run(r, speed, at_s))


if __name__ == "__main__":
    main()
