"""The core as a whole: by time and input alone, on its own clock, at the rates of PX4 v1.16.2's off-board link."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.flight.estimator import Estimator
from drone_agent.guard.position import LoopSetpoint
from drone_agent.link.schedule import RASTER_NS, Schedule
from drone_agent.simulation.airframe import Airframe, share_air
from drone_agent.simulation.disturbance import Disturbance, SweptFan
from drone_agent.simulation.inertial import InertialError, InertialSensor
from formation.config import LinkConfig
from formation.maths.arrays import Float
from formation.vehicle.profile import profile
from tests.drone_agent.agent_harness import MS, Harness, S, target
from wire.link_messages import BRIDGE_COMPONENT, Address, AttitudeQuaternion, NamedValue, TimeSync
from wire.mavlink.framing import FrameCutter


def test_the_same_input_gives_the_same_flight() -> None:
    def flight() -> tuple[list[tuple[int, str]], list[float]]:
        harness = Harness(pose="mocap", disturbance={"fan": {}})
        harness.fly_offboard(0.4)
        return [(t, repr(m)) for t, m in harness.heard], harness.truth.pos_lab_m.tolist()

    assert flight() == flight()


@given(st.lists(st.integers(1, 40 * MS), min_size=1, max_size=30))
@settings(max_examples=25)
def test_looking_does_not_change_the_flight(steps: list[int]) -> None:
    def core() -> AgentCore:
        return AgentCore(SimulatedDroneConfig(disturbance=Disturbance(fan=SweptFan())), 7)

    watched, left_alone = core(), core()
    now_ns = 7
    for step in steps:
        now_ns += step
        watched.tick(now_ns)
        watched.truth(now_ns)
    end_ns = 7 + 2 * S
    np.testing.assert_array_equal(watched.truth(end_ns).pos_lab_m, left_alone.truth(end_ns).pos_lab_m)


def airframe(start_lab_m: Float) -> Airframe:
    sensor = InertialSensor(InertialError(), 1)
    return Airframe(profile("px4_quad"), Disturbance(), start_lab_m, 0.0, 0, sensor, Estimator(0))


def test_truth_is_exact_between_the_steps_of_the_physics() -> None:
    """A free fall in air, sampled anywhere: z = -g (t - (1 - exp(-D t)) / D) / D, D = 1 1/s; first order in 1 ms."""
    frame = airframe(np.array([0.0, 0.0, 50.0]))
    for t_ns in (1_234_567, 250_000_001, 499_999_999):
        t_s = t_ns * 1e-9
        fallen_m = 9.8 * (t_s - (1.0 - np.exp(-t_s)))
        assert frame.state_at(t_ns).pos_lab_m[2] - 50.0 == pytest.approx(-fallen_m, rel=0.005, abs=1e-5)
    assert frame.t_ns == 499 * MS


def test_vehicles_that_share_air_push_those_below_them() -> None:
    """Hovering motors 0.6 m above; nothing any more once they are off."""
    lower, upper = airframe(np.zeros(3)), airframe(np.array([0.0, 0.0, 0.6]))
    upper.state.motor_thrust_n[:] = 2.45
    share_air([lower, upper])
    assert -2.5 < lower.push_lab_m_s2[2] < -2.0
    assert upper.push_lab_m_s2[2] == 0.0
    upper.state.motor_thrust_n[:] = 0.0
    share_air([lower, upper])
    assert lower.push_lab_m_s2[2] == 0.0


def test_setpoints_rule_after_the_vehicles_delay_in_their_order() -> None:
    frame = airframe(np.zeros(3))
    delay_ns = round(profile("px4_quad").command_delay_s * 1e9)
    first, second = (LoopSetpoint(frame.state.q_lab_from_flu, np.zeros(3), t) for t in (0.1, 0.2))
    frame.order(10 * MS, first)
    frame.order(20 * MS, second)
    frame.advance_to(10 * MS + delay_ns)
    assert frame.setpoint.thrust_norm == 0.0
    frame.advance_to(12 * MS + delay_ns)
    assert frame.setpoint is first
    frame.advance_to(100 * MS + delay_ns)
    assert frame.setpoint is second


def test_the_age_of_a_setpoint_is_reported_on_the_grounds_clock() -> None:
    harness = Harness(pose="mocap")
    ground_ahead_ns = 1234 * S
    harness.run(0.05)
    request = next(m for m in harness.of(TimeSync) if m.tc1_ns == 0)
    harness.send(TimeSync(harness.now_ns + ground_ahead_ns, request.ts1_ns, Address(1, BRIDGE_COMPONENT)))
    harness.run(3.0)
    # The exchange took 50 ms, all of it after the ground's stamp: half of that is the error of the offset.
    stamp_ms = (harness.now_ns + ground_ahead_ns - 30 * MS) // MS
    setpoint = target(harness, 0.0)
    harness.send(type(setpoint)(setpoint.target, stamp_ms, setpoint.q_lab_from_flu, np.zeros(3), 0.0, setpoint.ignore))
    harness.run(0.03)
    value = harness.last(NamedValue)
    assert value.name == "age_ms"
    assert value.value == pytest.approx(30.0, abs=26.0)


def test_rates_are_met_on_average_on_the_raster() -> None:
    schedule = Schedule({31: 50.0, 32: 30.0, 0: 1.0}, (), 0)
    sent: dict[int, list[int]] = {0: [], 31: [], 32: []}
    while (now_ns := schedule.next_ns) < 10 * S:
        for number in schedule.pop_due(now_ns):
            sent[number].append(now_ns)
    assert [len(sent[n]) for n in (0, 31, 32)] == [10, 500, 300]
    assert all(t % RASTER_NS == 0 for times in sent.values() for t in times)
    assert max(np.diff(sent[32])) <= 40 * MS


SEEN_HZ = {30: 100, 31: 50, 33: 50, 105: 50, 32: 30, 83: 10, 111: 10, 1: 5, 245: 5, 0: 1}


def sent_in_4_s(kind: str) -> list[list[int]]:
    """The message ids of every datagram sent of four seconds, once it is ready."""
    harness = Harness(link=LinkConfig(kind=kind))
    harness.run(4.0)  # until it knows where it is
    datagrams: list[list[int]] = []
    end_ns = harness.now_ns + 4_000_000_000
    while (due_ns := harness.core.due_ns) <= end_ns:
        harness.now_ns = max(due_ns, harness.now_ns)
        out = harness.core.tick(harness.now_ns)
        datagrams += [[frame.number for frame in FrameCutter().cut(d.data)] for d in out.datagrams]
    return datagrams


def test_px4_over_udp_loads_a_link_as_the_real_one_does():
    datagrams = sent_in_4_s("udp")
    assert all(len(numbers) == 1 for numbers in datagrams)
    rates = Counter(numbers[0] for numbers in datagrams)
    for number, rate_hz in SEEN_HZ.items():
        assert abs(rates[number] / 4 - rate_hz) <= 1, number
    assert len(datagrams) / 4 > 300


def _attitudes_after(stall_s: float, kind: str) -> tuple[list[int], int]:
    """Boot times, ms, of all ATTITUDE_QUATERNION that one late turn sends, and how long before it the stall began."""
    harness = Harness(link=LinkConfig(kind=kind))
    harness.run(4.0)
    began_ms = harness.now_ns // MS
    out = harness.core.tick(harness.now_ns + round(stall_s * S))
    packets = [packet.message for d in out.datagrams for packet in harness.codec.receive(d.data)]
    return [m.t_boot_ms for m in packets if isinstance(m, AttitudeQuaternion)], began_ms


def test_a_process_that_had_no_turn_sends_what_the_autopilot_has_sent_meanwhile():
    """PX4 on a computer of its own goes on: the ground finds a burst, each packet as old as its stamp says."""
    boot_ms, began_ms = _attitudes_after(0.3, "udp")
    assert boot_ms == list(range(began_ms + 20, began_ms + 301, 20))
    late, _ = _attitudes_after(30.0, "udp")
    assert len(late) == 51  # a second of it: a socket's buffer holds no more
    assert len(_attitudes_after(0.3, "zenoh")[0]) == 1


def test_over_the_bus_packets_share_datagrams():
    datagrams = sent_in_4_s("zenoh")
    assert max(len(numbers) for numbers in datagrams) > 1
