"""One flight of the campaign: the operator flies the script, then asks for a landing until all are down."""

from collections.abc import Sequence
from dataclasses import dataclass

from formation.messages import Phase, Verb
from gcs.recording import Record
from sim.campaign.oracle import Verdict, judge
from sim.campaign.recorder import FlightRecorder
from sim.faults.fault import Fault
from sim.lockstep import uncollected
from sim.monitors import WITHOUT_NONE, Without
from sim.scenario import Scenario
from sim.world import T0_NS, World

NEVER_FORMED_NS = 14_000_000_000
ASK_AGAIN_NS = 1_000_000_000
PATIENCE_S = 14.0
"""Beyond height / descent rate: ten that a landing may take longer, and the makes' own waits before they disarm."""
AFTER_NS = 300_000_000
AFTER_STOP_NS = 1_900_000_000
"""So long a stop must have lasted; at rest for two seconds, a drone may be armed again."""


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight's verdict, and how many seconds it was."""

    verdict: Verdict
    duration_s: float


class Ending:
    """When the operator asks for the landing, and when the flight is over."""

    def __init__(self, scenario: Scenario) -> None:
        flight = scenario.lab.flight
        self._formation_ns = round((scenario.formation_s or 4.0) * 1e9)
        self._longest_ns = round((flight.altitude_m / flight.descend_m_s + PATIENCE_S) * 1e9)
        self._land_ns = T0_NS + NEVER_FORMED_NS
        self._formed = False
        self._ask_ns: int | None = None
        self._down_ns: int | None = None
        self._stopped_ns: int | None = None

    def over(self, world: World, *, down: bool, flown: bool) -> bool:
        """Whether it is; asks for the landing when it is time. flown: whether any drone was ever armed."""
        now_ns = world.now_ns
        if world.phase is Phase.FORMATION and not self._formed:
            self._formed, self._land_ns = True, now_ns + self._formation_ns
        if world.phase is Phase.STOPPED and self._stopped_ns is None:
            self._stopped_ns = now_ns
        if now_ns >= self._land_ns and not down and now_ns >= (self._ask_ns or 0):
            self._ask_ns = now_ns + ASK_AGAIN_NS
            world.ask(Verb.LAND)
        if not (down and flown):
            self._down_ns = None
        elif self._down_ns is None:
            self._down_ns = now_ns
        at_rest = self._down_ns is not None and now_ns - self._down_ns > AFTER_NS
        return now_ns > self._land_ns + self._longest_ns or (at_rest and self._settled(world))

    def _settled(self, world: World) -> bool:
        """Whether nothing that is still to come could lift a drone again."""
        if self._stopped_ns is not None:
            return world.now_ns > self._stopped_ns + AFTER_STOP_NS
        return world.now_ns >= self._land_ns or world.phase in (Phase.GROUND, Phase.LAND)


class Flight:
    """A flight that is under way: `advance` until it is over, then `verdict`."""

    def __init__(
        self, scenario: Scenario, seed: int, log: Record | None = None, without: Without = WITHOUT_NONE
    ) -> None:
        """log: where its records go, if anywhere; without: monitors that are switched off."""
        self._recorder = FlightRecorder(scenario, log)
        self.world = World(scenario, seed, self._recorder.record, without)
        self._ending = Ending(scenario)

    @property
    def t_s(self) -> float:
        """How long it has lasted."""
        return (self.world.now_ns - T0_NS) * 1e-9

    def advance(self) -> bool:
        """Fly on to the next exposure of the cameras; whether the flight is over."""
        world, before_ns = self.world, self.world.exposed_ns
        while world.exposed_ns == before_ns:
            world.step()
        down = self._recorder.sample(world)
        return self._ending.over(world, down=down, flown=self._recorder.armed_ever)

    def verdict(self, *, benign: bool = False) -> Verdict:
        """The oracle's, on the flight so far; benign: as `judge` has it."""
        return judge(self._recorder.truth(self.world.faults.first_ns), benign=benign)


def fly(
    scenario: Scenario, seed: int, log: Record | None = None, *, benign: bool = False, without: Without = WITHOUT_NONE
) -> Flown:
    """Fly a scenario with its faults and judge it."""
    with uncollected():
        flight = Flight(scenario, seed, log, without)
        while not flight.advance():
            pass
    return Flown(flight.verdict(benign=benign), flight.t_s)


def begins_soon(flight: Flight, faults: Sequence[Fault], within_ns: int) -> bool:
    """Whether the first of the faults begins within that time from now."""
    onsets = flight.world.faults
    return min(onsets.begins_ns(fault) for fault in faults) < flight.world.now_ns + within_ns
