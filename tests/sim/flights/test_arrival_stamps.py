"""Flights on a network that holds frames back, stamped as they arrive: a leader that walks at us, or is gone."""

from collections import defaultdict, deque
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.maths.arrays import Float
from formation.messages import LabFrame, Phase, Truth, Verb
from formation.topics import Topic
from sim.cameras.emulator import Gap
from sim.scenario import Scenario, load, with_leader_file
from sim.world import T0_NS, World

NAME = "shared/data/vicon_v2_03.csv"
VICON = [folder / NAME for folder in Path(__file__).parents if (folder / NAME).exists()]
GAP_S = 0.87
LEADER_START_M = (0.0, 0.0, 1.4)
ON_ARRIVAL = {"arrival_stamps": True, "stall_s": 0.18, "stall_every_s": 1.0}


def recorded(path: Path, t_s: Float, pos_lab_m: Float) -> Path:
    """A recording of a body that never turns, with a camera's noise."""
    noisy_m = pos_lab_m + 1e-4 * np.random.default_rng(1).standard_normal(pos_lab_m.shape)
    rows = zip(t_s, *noisy_m.T, strict=True)
    path.write_text("".join(f"{round(t * 1e9)},{x:.6f},{y:.6f},{z:.6f},1,0,0,0\n" for t, x, y, z in rows))
    return path


def walk_at_a_follower(path: Path, speed_m_s: float) -> Path:
    """Four seconds on the spot, then three metres straight through where the right follower hovers."""
    t_s = np.arange(0.0, 7.0 + 3.0 / speed_m_s, 0.01)
    since_s, ramp_s = np.clip(t_s - 4.0, 0.0, None), 0.5
    way_m = np.where(since_s < ramp_s, since_s**2 / (2.0 * ramp_s), since_s - 0.5 * ramp_s) * speed_m_s
    direction = np.array([-1.0, -1.0, 0.0]) / np.sqrt(2.0)
    return recorded(path, t_s, LEADER_START_M + np.minimum(way_m, 3.0)[:, None] * direction)


def walk_in_circles(path: Path) -> Path:
    """Half a minute at 0.8 m/s on a circle of 1 m, as a hand carries a body."""
    t_s = np.arange(0.0, 30.0, 0.01)
    angle = 0.8 * np.clip(t_s - 1.0, 0.0, None)
    circle = np.column_stack([np.cos(angle) - 1.0, np.sin(angle), 0.1 * np.sin(1.7 * angle)])
    return recorded(path, t_s, LEADER_START_M + circle)


def a_scenario(leader: Path, gaps_at_s: tuple[float, ...] = (), **cameras: object) -> Scenario:
    scenario = with_leader_file(load("vicon_leader"), str(leader))
    gaps = tuple(Gap(at_s=at_s, for_s=GAP_S, body="leader") for at_s in gaps_at_s)
    return scenario.model_copy(update={"mocap": scenario.mocap.model_copy(update={"gaps": gaps} | cameras)})


@dataclass
class Flight:
    """One flight behind a recorded leader, and what is asked of it; seconds count from the start of the formation.

    phases: each phase entered, and when. least_m: between two bodies of which two are in the air, by the drones' truth
    and the leader as seen then.
    """

    scenario: Scenario
    phases: list[tuple[float, Phase]] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    leader_s: list[float] = field(default_factory=list)
    least_m: float = np.inf
    _truths: dict[int, deque[Truth]] = field(default_factory=lambda: defaultdict(partial(deque, maxlen=256)))
    _start_ns: int | None = None

    def __post_init__(self) -> None:
        self.world = World(self.scenario, 1, self._record)

    @property
    def t_s(self) -> float:
        """Since the formation started; -1 before it."""
        return -1.0 if self._start_ns is None else (self.world.now_ns - self._start_ns) * 1e-9

    def until(self, t_s: float) -> None:
        """Fly on until then."""
        while self.t_s < t_s:
            assert self.world.now_ns < T0_NS + 300 * 10**9
            self.world.step()

    def _record(self, topic: Topic, message: object, t_ns: int) -> None:
        if isinstance(message, Truth):
            self._truths[message.sysid].append(message)
        elif topic is topics.PHASE:
            if message.phase is Phase.FORMATION and self._start_ns is None:
                self._start_ns = t_ns
            self.phases.append((self.t_s, message.phase))
        elif topic is topics.EVENT or topic is topics.MOCAP_EVENT:
            self.events.append(message.text)
        elif isinstance(message, LabFrame) and self._start_ns is not None:
            self._look(message)

    def _look(self, frame: LabFrame) -> None:
        at = [self._at(path, frame.t_capture_ns) for path in self._truths.values() if not path[-1].on_ground]
        if frame.seen[0]:
            self.leader_s.append(self.t_s)
            at.append(frame.pos_lab_m[0])
        away = [np.linalg.norm(a - b) for k, a in enumerate(at) for b in at[:k]]
        self.least_m = min(self.least_m, *away)

    @staticmethod
    def _at(path: deque[Truth], t_ns: int) -> Float:
        truth = next((truth for truth in reversed(path) if truth.t_ns <= t_ns), path[0])
        return truth.pos_lab_m + (t_ns - truth.t_ns) * 1e-9 * truth.vel_lab_m_s

    def phases_after(self, t_s: float) -> list[Phase]:
        return [phase for at_s, phase in self.phases if at_s > t_s]


NIGHTLY = [pytest.param(*case, marks=pytest.mark.nightly) for case in ((0.5, {}), (1.0, {}), (1.0, ON_ARRIVAL))]


@pytest.mark.parametrize(("speed_m_s", "cameras"), [*NIGHTLY, (1.5, ON_ARRIVAL)])
def test_followers_in_hold_yield_to_a_leader_that_walks_at_them(
    tmp_path: Path, speed_m_s: float, cameras: dict[str, object]
) -> None:
    scenario = a_scenario(walk_at_a_follower(tmp_path / "walk.csv", speed_m_s), **cameras)
    flight = Flight(scenario)
    flight.until(2.0)
    flight.world.ask(Verb.HOLD)
    flight.until(6.2 + 1.4 / speed_m_s)
    assert flight.phases[-1][1] is Phase.HOLD
    assert scenario.lab.limits.min_separation_m < flight.least_m < 0.3, "it came near, and no nearer"


def test_a_formation_held_by_a_gap_waits_for_the_operator_and_resumes(tmp_path: Path) -> None:
    """The leader is out of sight for 0.87 s: HOLD after 0.2 s, and nothing but a start leads on."""
    scenario = a_scenario(walk_in_circles(tmp_path / "circles.csv"), (8.0, 18.0), **ON_ARRIVAL)
    flight = Flight(scenario)
    flight.until(12.0)
    assert flight.phases_after(0.0) == [Phase.HOLD]
    assert 8.2 < flight.phases[-1][0] < 10.0
    assert flight.leader_s[-1] > 11.5, "the leader was believed again long ago"
    flight.world.ask(Verb.START)
    flight.until(21.0)
    assert flight.phases_after(0.0) == [Phase.HOLD, Phase.FORMATION, Phase.HOLD]
    flight.world.ask(Verb.START)
    flight.until(27.0)
    assert flight.phases_after(20.0) == [Phase.FORMATION]
    assert np.diff(flight.leader_s).max() < GAP_S + 0.25
    assert flight.least_m > scenario.lab.limits.min_separation_m
    assert sum(text.startswith("stamps are arrival times: frames are re-timed") for text in flight.events) == 1


@pytest.mark.nightly
@pytest.mark.skipif(not VICON, reason=f"no {NAME} beside the repository: a leader recorded by a Vicon system")
def test_a_recorded_leader_with_arrival_stamps_and_gaps_is_followed_to_its_end() -> None:
    scenario = a_scenario(VICON[0], (20.0, 45.0, 70.0, 95.0), **ON_ARRIVAL)
    flight, resumed = Flight(scenario), 0
    flight.until(0.0)
    while flight.t_s < 113.0:
        flight.until(flight.t_s + 1.0)
        if flight.phases[-1][1] is Phase.HOLD:
            flight.world.ask(Verb.START)
            resumed += 1
    assert set(flight.phases_after(0.0)) <= {Phase.HOLD, Phase.FORMATION}
    assert resumed >= 4
    assert flight.leader_s[-1] > 112.5
    assert flight.least_m > scenario.lab.limits.min_separation_m
