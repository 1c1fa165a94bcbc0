"""The ground's intake in lockstep: one that is too slow in simulated time is shown, and flown safely."""

from analysis.load import Flight, from_records
from formation.messages import Phase
from sim import lockstep
from sim.scenario import LinkModel, Scenario, load
from sim.script import FLIGHT
from sim.world import World
from wire.logs.mcap_read import Entry

LONGEST_NS = 30_000_000_000


def _with_ingest(ingest_s: float) -> Scenario:
    """The triangle line; ingest_s: of the ground's work for each packet of a drone."""
    scenario = load("triangle_line")
    return scenario.model_copy(update={"link": scenario.link.model_copy(update={"ingest_s": ingest_s})})


def test_a_budget_that_suffices_changes_no_bit() -> None:
    forming = {"script": FLIGHT[:3], "longest_s": 6.0}
    flown = [
        lockstep.run_in_memory(_with_ingest(s).model_copy(update=forming), 7)[1] for s in (0.0, LinkModel().ingest_s)
    ]
    assert len(flown[0]) == len(flown[1])
    assert [str(entry.message) for entry in flown[0]] == [str(entry.message) for entry in flown[1]]


def _flown(ingest_s: float, seed: int, slow_from: Phase) -> tuple[Flight, list[str]]:
    """The triangle line with inertial samples, which are never superseded.

    From that phase on each packet of a drone costs the ground so much work.
    """
    scenario, records = load("triangle_line"), list[Entry]()
    lab = scenario.lab.model_copy(update={"link": scenario.lab.link.model_copy(update={"imu_rate_hz": 100.0})})
    scenario = scenario.model_copy(update={"lab": lab})
    world = World(scenario, seed, lambda topic, message, t_ns: records.append(Entry(topic, t_ns, message)))
    while world.operator.outcome is None and world.now_ns < lockstep.T0_NS + LONGEST_NS:
        world.step()
        if world.phase is slow_from:
            (ground,) = world._grounds
            ground._ingest_ns = round(ingest_s * 1e9)
            for intake in ground._intakes.values():
                intake._work_ns = ground._ingest_ns
    flight = from_records(lockstep.metadata(scenario, seed, "memory", lockstep.T0_NS), records)
    return flight, [message.text for message in flight.events.messages]


def _all_landed_softly(flight: Flight) -> bool:
    """Every drone at rest and disarmed at the end, and none was faster than a landing near the floor."""
    soft = True
    for track in flight.truth.values():
        soft &= bool((track["vel_lab_m_s"][track["pos_lab_m"][:, 2] < 0.1, 2] > -1.0).all())
        soft &= bool(track["on_ground"][-1] and not track["armed"][-1])
    return soft


def test_a_ground_that_falls_behind_in_flight_warns_holds_and_lets_its_drones_land() -> None:
    flight, texts = _flown(0.015, 7, Phase.FORMATION)
    for late_ms in (50, 100, 300):
        assert any(f"its telemetry arrives {late_ms} ms late" in text for text in texts)
    changes = [text for text in texts if " -> " in text]
    assert any(text.startswith("FORMATION -> HOLD") and "100 ms late" in text for text in changes)
    assert any(text.startswith("HOLD -> LAND") and "300 ms late" in text for text in changes)
    assert _all_landed_softly(flight)


def test_a_ground_that_never_keeps_up_does_not_take_off() -> None:
    """It was seconds behind, knew no drone's clock for it, and flew a formation on answers that were old."""
    flight, texts = _flown(0.015, 7, Phase.GROUND)
    assert any("its telemetry arrives 300 ms late" in text for text in texts)
    assert not any("-> TAKEOFF" in text for text in texts)
    assert _all_landed_softly(flight)
