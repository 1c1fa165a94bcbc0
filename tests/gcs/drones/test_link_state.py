import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from formation.config import VehicleBody
from formation.messages import Severity
from gcs.drones.link_state import DroneLink
from gcs.drones.telemetry import WORDS_A_SECOND
from tests.gcs.fakes import PX4_PARAMETERS
from tests.gcs.link import MS, PAPER, Drone, a_link, beat, tell
from wire.link_messages import (
    GROUND,
    Address,
    Battery,
    CommandAck,
    CommandLong,
    EkfStatus,
    ExtendedSysState,
    InertialSample,
    LandedState,
    LinkMessage,
    MavAutopilot,
    NamedValue,
    Origin,
    ParamRequestRead,
    Result,
    SetOrigin,
    StatusText,
    TimeSync,
)


def _asked(link: DroneLink, drone: Drone, start_ms: int = 0, lasts_ms: int = 1000) -> list[LinkMessage]:
    """What the link asks for meanwhile, each command acknowledged as it comes."""
    asked: list[LinkMessage] = []
    for ms in range(start_ms, start_ms + lasts_ms, 10):
        for message in link.due(ms * MS):
            asked.append(message)
            if isinstance(message, CommandLong):
                drone.say(link, CommandAck(GROUND, message.command, Result.ACCEPTED), ms * MS)
    return asked


def _intervals(link: DroneLink) -> dict[float, float]:
    """SET_MESSAGE_INTERVAL as asked: message and interval."""
    asked = [m for m in _asked(link, Drone()) if isinstance(m, CommandLong)]
    return {m.params[0]: m.params[1] for m in asked if m.command == 511}


def _origins(link: DroneLink) -> list[SetOrigin]:
    return [m for m in _asked(link, Drone(), lasts_ms=3000) if isinstance(m, SetOrigin)]


def test_an_autopilot_that_was_gone_for_three_heartbeats_is_asked_for_everything_again():
    """What hovers is not forgotten before it is read again; only after that silence it is announced again."""
    link, drone = a_link(), Drone()
    drone.say(link, beat())
    before = [m for m in _asked(link, drone, 0) if isinstance(m, CommandLong)]
    assert before
    tell(link, {"MPC_THR_HOVER": 0.45}, MavAutopilot.PX4)
    drone.say(link, beat(), 1000 * MS)
    assert [event.text for event in link.events] == ["drone 3 is here, PX4"]
    assert not any(isinstance(m, CommandLong) for m in _asked(link, drone, 1000))
    drone.say(link, beat(), 4000 * MS)  # ArduCopter's SITL restarts in about two seconds
    assert [m for m in _asked(link, drone, 4000) if isinstance(m, CommandLong)] == before
    assert math.isclose(link.hover_thrust_norm, 0.45, rel_tol=1e-6)
    assert [event.text for event in link.events].count("drone 3 is here, PX4") == 2


@pytest.mark.parametrize(
    ("autopilot", "mode", "name", "offboard"),
    [
        (MavAutopilot.PX4, 6 << 16, "OFFBOARD", True),
        (MavAutopilot.PX4, 4 << 16 | 6 << 24, "LAND", False),
        (MavAutopilot.ARDUPILOT, 4, "GUIDED", True),
    ],
)
def test_a_heartbeat_tells_autopilot_arming_and_mode_in_its_own_words(autopilot, mode, name, offboard):
    link = a_link()
    Drone().say(link, beat(autopilot, armed=offboard, mode=mode), 5 * MS)
    assert (link.model.table.autopilot, link.mode, link.armed, link.offboard) == (autopilot, name, offboard, offboard)
    assert link.telemetry.heartbeat_ns == 5 * MS


def test_another_component_is_not_the_autopilot_and_another_system_is_reported():
    link = a_link()
    Drone(component=191).say(link, beat(armed=True))
    assert link.telemetry.heartbeat is None
    Drone(sysid=9).say(link, beat(armed=True))
    assert link.telemetry.heartbeat is None
    assert link.telemetry.foreign_sysid == 9
    assert [(e.severity, e.text) for e in link.events] == [(Severity.ERROR, "drone 9 answers on the link of drone 3")]


def test_telemetry_is_kept_and_texts_become_events_in_the_drones_name():
    link, drone = a_link(), Drone()
    assert math.isnan(link.telemetry.battery)
    drone.say(link, ExtendedSysState(LandedState.IN_AIR))
    drone.say(link, Battery((3.9,), 4.0, 10.0, 0.5))
    assert link.telemetry.landed is LandedState.IN_AIR
    assert math.isclose(link.telemetry.battery, 0.5)
    assert math.isclose(link.telemetry.battery_v, 3.9, rel_tol=1e-3)
    drone.say(link, StatusText(Severity.CRITICAL, "Disarming denied: not landed"))
    assert [(e.severity, e.source, e.text) for e in link.events] == [
        (Severity.CRITICAL, "left", "Disarming denied: not landed")
    ]
    assert list(link.reports.texts) == ["Disarming denied: not landed"]


def test_the_bridge_beside_an_autopilot_gets_our_clock_at_once_and_is_heard():
    link, bridge = a_link(), Drone(component=191)
    assert not link.answers
    bridge.say(link, TimeSync(0, 77), 5 * MS)
    assert link.answers
    assert [m for m in link.due(6 * MS) if isinstance(m, TimeSync) and m.tc1_ns] == [
        TimeSync(5 * MS, 77, Address(3, 191))
    ]
    bridge.say(link, NamedValue(0, "age_ms", 12.5))
    assert math.isclose(link.telemetry.setpoint_age_s, 0.0125)
    bridge.say(link, StatusText(Severity.WARNING, "Setpoints are stale: level and hold"))
    assert [event.text for event in link.events] == ["Setpoints are stale: level and hold"]
    bridge.say(link, beat(armed=True))
    assert link.telemetry.heartbeat is None
    assert link.sequence.received == 0


@pytest.mark.parametrize(
    ("autopilot", "name", "ignored"),
    [
        (MavAutopilot.PX4, "paper_40g", 0),
        (MavAutopilot.PX4, "px4_quad", 3),
        (MavAutopilot.ARDUPILOT, "px4_quad", 0),
    ],
)
def test_setpoints_have_the_rates_the_autopilot_can_take(autopilot, name, ignored):
    """PX4 reads roll and pitch rates as a second setpoint: only who is known to feed them forward gets them."""
    link = a_link(name)
    assert link.setpoint_ignore == 7, "until its autopilot is known, no rates"
    Drone().say(link, beat(autopilot))
    assert link.setpoint_ignore == ignored


@pytest.mark.parametrize(
    ("autopilot", "name", "default"),
    [(MavAutopilot.PX4, "MPC_THR_HOVER", 0.5), (MavAutopilot.ARDUPILOT, "MOT_THST_HOVER", 0.35)],
)
def test_hover_thrust_is_the_autopilots_once_it_was_measured(autopilot, name, default):
    link = a_link()
    assert link.hover_thrust_norm == PAPER.hover_thrust_norm
    Drone().say(link, beat(autopilot))
    tell(link, {name: default}, autopilot)
    assert link.hover_thrust_norm == PAPER.hover_thrust_norm
    tell(link, {name: 0.45}, autopilot)
    assert math.isclose(link.hover_thrust_norm, 0.45, rel_tol=1e-6)


ORIGIN = (47.0, 8.0, 400.0)


@pytest.mark.parametrize(
    ("autopilot", "origin", "has_position", "sent"),
    [
        (MavAutopilot.ARDUPILOT, ORIGIN, False, 3),
        (MavAutopilot.ARDUPILOT, ORIGIN, True, 0),
        (MavAutopilot.ARDUPILOT, None, False, 0),
        (MavAutopilot.PX4, ORIGIN, False, 0),
    ],
)
def test_an_ardupilot_without_position_alone_is_sent_the_origin_until_it_repeats_it(
    autopilot, origin, has_position, sent
):
    link, drone = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, origin=origin), Drone()
    drone.say(link, beat(autopilot))
    if has_position:
        drone.say(link, EkfStatus(0x10, ardupilot=True))
    assert [(m.target_system, m.lat_deg, m.lon_deg, m.alt_m) for m in _origins(link)] == [(3, *ORIGIN)] * sent
    drone.say(link, Origin(*ORIGIN))
    assert _origins(link) == []


def test_parameters_and_streams_are_asked_for_and_what_nobody_reads_is_switched_off_on_a_link_of_our_own():
    shared = a_link()
    Drone().say(shared, beat())
    asked = _asked(shared, Drone(), lasts_ms=200)
    assert {m.name for m in asked if isinstance(m, ParamRequestRead)} <= {*PX4_PARAMETERS, "MPC_THR_HOVER"}
    assert next(m for m in asked if isinstance(m, CommandLong)).target == Address(3, 1)
    assert any(isinstance(m, TimeSync) for m in asked)
    shared = a_link()
    Drone().say(shared, beat())
    assert _intervals(shared) == {31.0: 20_000.0, 245.0: 500_000.0, 147.0: 1_000_000.0}
    own = DroneLink(
        VehicleBody(body="left", sysid=3, link="udpin:127.0.0.1:14540", guard="none"), 3, PAPER, ((32, 100.0),)
    )
    Drone().say(own, beat())
    asked = _intervals(own)
    assert (asked[30.0], asked[105.0], asked[331.0]) == (-1.0, -1.0, -1.0)
    assert (asked[31.0], asked[32.0]) == (20_000.0, 10_000.0)


def test_an_accelerometer_is_heard_where_it_was_asked_for_on_our_clock():
    """A boot clock 3 s behind ours: samples of 2.000 and 2.005 s are ours of 5.000 and 5.005 s."""
    sample = InertialSample(2_000_000, np.array([0.5, -0.25, 9.8]), np.zeros(3))
    later = InertialSample(2_005_000, np.array([1.5, 0.25, 9.8]), np.zeros(3))
    wanted = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, ((105, 200.0),))
    unasked = a_link()
    for link, asked_us in ((wanted, 5_000.0), (unasked, None)):
        drone = Drone()
        drone.say(link, beat())
        assert _intervals(link).get(105.0) == asked_us
        asked = next(m for m in link.due(4000 * MS) if isinstance(m, TimeSync))
        drone.say(link, sample, 4001 * MS)  # no clock yet
        drone.say(link, TimeSync(1001 * MS, asked.ts1_ns, GROUND), 4002 * MS)
        drone.say(link, sample, 5002 * MS)
        drone.say(link, later, 5007 * MS)
    assert wanted.telemetry.force.pop_mean(4994 * MS) is None
    np.testing.assert_allclose(wanted.telemetry.force.pop_mean(5006 * MS), [1.0, 0.0, 9.8])
    assert wanted.telemetry.force.pop_mean(6000 * MS) is None
    drone.say(wanted, InertialSample(3_010_000, np.array([3e38, 0.0, 9.8]), np.zeros(3)), 6001 * MS)
    assert wanted.reports.rejections.count == 1
    drone.say(wanted, sample, 6001 * MS)
    assert wanted.telemetry.force.pop_mean(6010 * MS) is None  # of a frame long gone
    assert unasked.telemetry.force.pop_mean(6000 * MS) is None


def test_a_missing_imu_stream_is_reported_once_and_its_return_too():
    link, drone = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, ((105, 200.0),)), Drone()
    for second in range(6):
        drone.say(link, beat(), second * 1000 * MS)
        asked = next((m for m in link.due(second * 1000 * MS) if isinstance(m, TimeSync)), None)
    assert asked is not None
    assert [event.text for event in link.events[1:]] == ["sends no HIGHRES_IMU that was asked for: flown without"]
    drone.say(link, TimeSync(5001 * MS, asked.ts1_ns, GROUND), 5001 * MS)
    drone.say(link, InertialSample(5_900_000, np.array([0.0, 0.0, 9.8]), np.zeros(3)), 5900 * MS)
    drone.say(link, beat(), 6000 * MS)
    assert [event.text for event in link.events[2:]] == ["sends HIGHRES_IMU"]


def test_a_drone_with_too_much_to_say_is_heard_in_part_and_counted():
    link, drone = a_link(), Drone()
    said = 0
    for k in range(3000):  # three seconds of a thousand a second
        drone.say(link, StatusText(Severity.INFO, f"again {k}"), k * MS)
        link.due(k * MS)
        events = link.reports.pop(k * MS)
        said += sum(event.text.startswith("again") for event in events)
        assert len(events) <= 2
    assert said == 3 * WORDS_A_SECOND
    assert link.reports.rejections.count == 3000 - said


def test_a_flood_of_questions_is_answered_as_often_as_something_is_sent():
    link, drone = a_link(), Drone()
    for k in range(1000):
        drone.say(link, TimeSync(0, k, GROUND), 7)
    assert [m.ts1_ns for m in link.due(8) if isinstance(m, TimeSync) and m.tc1_ns == 7] == [998, 999]


@pytest.mark.parametrize(("number", "function"), [(1, 1), (0, 3), (0, 4)])
def test_the_charge_of_another_battery_than_the_one_to_fly_by_is_not_its(number: int, function: int):
    """A payload's empty battery would land the swarm; a full one would hide that the drone's own is empty."""
    link, drone = a_link(), Drone()
    drone.say(link, Battery((3.9,), 4.0, 10.0, 0.5))
    sender = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    volts = [3000] + [65535] * 9
    other = mavlink.MAVLink_battery_status_message(
        number, function, 1, 32767, volts, -1, -1, -1, 5, 0, 0, [0] * 4, 0, 0
    )
    link.receive(other.pack(sender), 0)
    assert (link.telemetry.battery, round(link.telemetry.battery_v, 2)) == (0.5, 3.9)
