import math

import numpy as np
import pytest

from formation.config import VehicleBody
from formation.messages import Severity
from gcs.drones.link_state import WORDS_A_SECOND, DroneLink
from tests.gcs.fakes import PX4_OFFBOARD, PX4_PARAMETERS
from tests.gcs.link import MS, PAPER, Drone, a_link, beat, tell
from wire.link_messages.address import GROUND, Address
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import CommandAck, CommandLong, Result
from wire.link_messages.motion import InertialSample, Origin, SetOrigin
from wire.link_messages.packet import LinkMessage
from wire.link_messages.parameters import ParamRequestRead, ParamType, ParamValue
from wire.link_messages.status import (
    Battery,
    EkfStatus,
    ExtendedSysState,
    LandedState,
    MavAutopilot,
    NamedValue,
    StatusText,
    SysStatus,
)
from wire.mavlink.codec import Codec


def _heard(link: DroneLink, data: list[LinkMessage]) -> list[LinkMessage]:
    return [type(message) for message in data]


def test_a_heartbeat_tells_autopilot_mode_and_arming():
    link, drone = a_link(), Drone()
    drone.say(link, beat(armed=True, mode=PX4_OFFBOARD), 5 * MS)
    assert (link.model.name, link.mode, link.armed, link.offboard) == ("PX4", "OFFBOARD", True, True)
    assert link.heartbeat_ns == 5 * MS
    assert [event.text for event in link.events] == ["drone 3 is here, PX4"]


def test_the_same_drone_is_announced_again_only_after_a_long_silence():
    link, drone = a_link(), Drone()
    for second in (0, 1, 2, 20, 21):
        drone.say(link, beat(), second * 1000 * MS)
    assert len(link.events) == 2


def _asked(link: DroneLink, drone: Drone, start_ms: int) -> list[LinkMessage]:
    """What the link asks for within a second, each command acknowledged as it comes."""
    asked: list[LinkMessage] = []
    for ms in range(start_ms, start_ms + 1000, 10):
        for message in link.due(ms * MS):
            asked.append(message)
            if isinstance(message, CommandLong):
                drone.say(link, CommandAck(GROUND, message.command, Result.ACCEPTED), ms * MS)
    return asked


def test_an_autopilot_that_was_gone_for_three_heartbeats_is_asked_for_everything_again():
    link, drone = a_link(), Drone()
    drone.say(link, beat())
    before = [m for m in _asked(link, drone, 0) if isinstance(m, CommandLong)]
    assert before
    drone.say(link, beat(), 1000 * MS)
    assert not any(isinstance(m, CommandLong) for m in _asked(link, drone, 1000))
    drone.say(link, beat(), 4000 * MS)  # ArduCopter's SITL restarts in about two seconds
    assert [m for m in _asked(link, drone, 4000) if isinstance(m, CommandLong)] == before


def test_a_restart_does_not_forget_what_hovers_before_it_is_read_again():
    link, drone = a_link(), Drone()
    drone.say(link, beat())
    tell(link, {"MPC_THR_HOVER": 0.45}, MavAutopilot.PX4)
    drone.say(link, beat(), 5000 * MS)
    assert math.isclose(link.hover_thrust_norm, 0.45, rel_tol=1e-6)


@pytest.mark.parametrize(
    ("autopilot", "mode", "name", "offboard"),
    [
        (MavAutopilot.PX4, 6 << 16, "OFFBOARD", True),
        (MavAutopilot.PX4, 4 << 16 | 6 << 24, "LAND", False),
        (MavAutopilot.PX4, 3 << 16, "POSCTL", False),
        (MavAutopilot.PX4, 99 << 16, "MODE 99", False),
        (MavAutopilot.ARDUPILOT, 4, "GUIDED", True),
        (MavAutopilot.ARDUPILOT, 9, "LAND", False),
        (MavAutopilot.ARDUPILOT, 99, "MODE 99", False),
    ],
)
def test_modes_are_named_in_the_autopilots_own_words(autopilot, mode, name, offboard):
    link = a_link()
    Drone().say(link, beat(autopilot, mode=mode))
    assert (link.mode, link.offboard) == (name, offboard)


def test_the_first_heartbeat_asks_for_parameters_and_streams():
    link = a_link()
    Drone().say(link, beat())
    asked: list[LinkMessage] = []
    for ms in range(0, 200, 10):
        asked += link.due(ms * MS)
    assert {m.name for m in asked if isinstance(m, ParamRequestRead)} <= {*PX4_PARAMETERS, "MPC_THR_HOVER"}
    first = next(m for m in asked if isinstance(m, CommandLong))
    assert (first.command, first.params[:2], first.target) == (511, (31.0, 20_000.0), Address(3, 1))
    assert any(isinstance(m, TimeSync) for m in asked)


def test_another_component_is_not_the_autopilot_and_another_system_is_reported():
    link = a_link()
    Drone(component=191).say(link, beat(armed=True))
    assert link.telemetry.heartbeat is None
    Drone(sysid=9).say(link, beat(armed=True))
    assert link.telemetry.heartbeat is None
    assert link.foreign_sysid == 9
    assert [(e.severity, e.text) for e in link.events] == [(Severity.ERROR, "drone 9 answers on the link of drone 3")]


def test_telemetry_is_kept_and_unknown_battery_is_nan():
    link, drone = a_link(), Drone()
    assert math.isnan(link.telemetry.battery)
    drone.say(link, ExtendedSysState(LandedState.IN_AIR))
    drone.say(link, Battery((3.9,), 4.0, 10.0, 0.5))
    drone.say(link, NamedValue(1, "age_ms", 12.5))
    assert link.telemetry.landed is LandedState.IN_AIR
    assert math.isclose(link.telemetry.battery, 0.5)
    assert math.isclose(link.telemetry.battery_v, 3.9, rel_tol=1e-3)
    assert math.isclose(link.telemetry.setpoint_age_s, 0.0125)


def test_status_texts_become_events_in_the_drones_name():
    link = a_link()
    Drone().say(link, StatusText(Severity.CRITICAL, "Disarming denied: not landed"))
    assert [(e.severity, e.source, e.text) for e in link.events] == [
        (Severity.CRITICAL, "left", "Disarming denied: not landed")
    ]
    assert list(link.texts) == ["Disarming denied: not landed"]


def test_a_time_sync_request_is_answered_at_once():
    link = a_link()
    assert not link.has_answers
    Drone().say(link, TimeSync(0, 77), 5 * MS)
    assert link.has_answers
    answers = [m for m in link.due(6 * MS) if isinstance(m, TimeSync) and m.tc1_ns]
    assert [(m.tc1_ns, m.ts1_ns) for m in answers] == [(5 * MS, 77)]


def test_the_bridge_beside_an_autopilot_gets_our_clock_and_is_heard():
    link, bridge = a_link(), Drone(component=191)
    bridge.say(link, TimeSync(0, 77), 5 * MS)
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


def test_setpoints_have_the_rates_the_autopilot_can_take():
    masks = {}
    for autopilot in (MavAutopilot.PX4, MavAutopilot.ARDUPILOT):
        for name in ("paper_40g", "px4_quad"):
            link = a_link(name)
            assert link.setpoint_ignore == 7, "until its autopilot is known, no rates"
            Drone().say(link, beat(autopilot))
            masks[autopilot.name, name] = link.setpoint_ignore
    # PX4 reads roll and pitch rates as a second, competing setpoint: only who is known to feed them forward gets them.
    assert masks == {
        ("PX4", "paper_40g"): 0,
        ("PX4", "px4_quad"): 3,
        ("ARDUPILOT", "paper_40g"): 0,
        ("ARDUPILOT", "px4_quad"): 0,
    }


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


def _origins(link: DroneLink, until_ms: int) -> list[SetOrigin]:
    return [m for ms in range(0, until_ms, 10) for m in link.due(ms * MS) if isinstance(m, SetOrigin)]


def test_an_ardupilot_without_position_is_sent_the_origin_until_it_repeats_it():
    origin = (47.0, 8.0, 400.0)
    link = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, origin=origin)
    drone = Drone()
    drone.say(link, beat(MavAutopilot.ARDUPILOT))
    told = _origins(link, 3000)
    assert [(m.target_system, m.lat_deg, m.lon_deg, m.alt_m) for m in told] == [(3, *origin)] * 3
    drone.say(link, Origin(*origin))
    assert _origins(link, 3000) == []


def test_an_autopilot_that_needs_no_origin_is_sent_none():
    for autopilot, origin in ((MavAutopilot.PX4, (47.0, 8.0, 400.0)), (MavAutopilot.ARDUPILOT, None)):
        link = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, origin=origin)
        Drone().say(link, beat(autopilot))
        assert _origins(link, 3000) == []
    ready = DroneLink(VehicleBody(body="left", sysid=3), 3, PAPER, origin=(47.0, 8.0, 400.0))
    Drone().say(ready, beat(MavAutopilot.ARDUPILOT))
    Drone().say(ready, EkfStatus(0x10, ardupilot=True))
    assert _origins(ready, 3000) == []


def _intervals(link: DroneLink) -> dict[float, float]:
    """SET_MESSAGE_INTERVAL as asked: message and interval, every command answered at once."""
    asked = {}
    for ms in range(0, 1000, 10):
        for m in link.due(ms * MS):
            if isinstance(m, CommandLong) and m.command == 511:
                asked[m.params[0]] = m.params[1]
                Drone().say(link, CommandAck(GROUND, 511, Result.ACCEPTED), ms * MS)
    return asked


def test_what_nobody_reads_is_switched_off_only_on_a_link_of_our_own():
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
    assert wanted._reject_log.count == 1
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
        events, link.events = link.events, []
        said += sum(event.text.startswith("again") for event in events)
        assert len(events) <= 2
    assert said == 3 * WORDS_A_SECOND
    assert link._reject_log.count == 3000 - said


def test_a_flood_of_questions_is_answered_as_often_as_something_is_sent():
    link, drone = a_link(), Drone()
    for k in range(1000):
        drone.say(link, TimeSync(0, k, GROUND), 7)
    answers = [message for message in link.due(8) if isinstance(message, TimeSync) and message.tc1_ns == 7]
    assert [answer.ts1_ns for answer in answers] == [998, 999]


def test_everything_that_is_acted_on_is_read():
    drone = Codec(Address(3, 1))
    acted_on = (
        beat(), CommandAck(GROUND, 400, Result.ACCEPTED, 0), TimeSync(0, 1, GROUND), Origin(47.0, 8.0, 0.0),
        ParamValue("A", bytes(4), ParamType.INT32, 1, 0), ExtendedSysState(LandedState.IN_AIR),
        NamedValue(0, "age_ms", 1.0), Battery((4.0,), 1.0, 1.0, 0.5),
        EkfStatus(1, ardupilot=True), EkfStatus(1, ardupilot=False),
        StatusText(Severity.INFO, "x"), SysStatus(0, 0, 0, 0.0, 1.0, 1.0, 0.5),
    )  # fmt: skip
    for message in acted_on:
        (packet,) = a_link().codec.receive(drone.encode(message))
        assert type(packet.message) is type(message)
