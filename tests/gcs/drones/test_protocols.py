"""Commands and parameters, repeated until they are answered."""

import struct

import pytest

from gcs.drones.protocols import CommandChannel, ParameterReader, arm, disarm, land, stream
from wire.link_messages import Address, CommandAck, MavAutopilot, MavCommand, ParamType, ParamValue, Result

DRONE = Address(3, 1)
GROUND = Address(255, 190)
MS = 1_000_000


def test_an_unanswered_command_is_repeated_with_a_rising_confirmation_then_given_up():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    sent = [(ms, command.confirmation) for ms in range(3000) if (command := channel.due(ms * MS)) is not None]
    assert sent == [(250 * i, i) for i in range(8)]
    answer = channel.answers[arm(DRONE)]
    assert answer.result is None
    assert str(answer) == "no answer"
    assert not answer.accepted


def _ack(command: int, result: Result = Result.ACCEPTED) -> CommandAck:
    return CommandAck(GROUND, command, result)


def test_commands_go_one_at_a_time_in_order_each_until_its_own_answer():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.ask(land(DRONE))
    channel.ask(land(DRONE))
    assert channel.due(0).command == 400
    channel.receive(_ack(21), MS)
    assert channel.due(2 * MS) is None
    assert channel.due(300 * MS).confirmation == 1
    channel.receive(_ack(400, Result.TEMPORARILY_REJECTED), 302 * MS)
    assert str(channel.answers[arm(DRONE)]) == "temporarily rejected"
    assert channel.due(303 * MS).command == 21
    channel.receive(_ack(21), 304 * MS)
    assert channel.due(2000 * MS) is None
    assert channel.answers[land(DRONE)].accepted


def test_progress_puts_the_repeat_off():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.due(0)
    channel.receive(_ack(MavCommand.COMPONENT_ARM_DISARM, Result.IN_PROGRESS), 100 * MS)
    assert channel.due(1000 * MS) is None
    assert channel.due(3200 * MS) is not None


def _value(name: str, raw: bytes, kind: ParamType) -> ParamValue:
    return ParamValue(name, raw, kind, 2, 0)


def _float(name: str, value: float) -> ParamValue:
    return _value(name, struct.pack("<f", value), ParamType.REAL32)


@pytest.mark.parametrize(
    ("autopilot", "raw"), [(MavAutopilot.PX4, struct.pack("<i", 11)), (MavAutopilot.ARDUPILOT, struct.pack("<f", 11.0))]
)
def test_an_integer_is_read_as_its_autopilot_sends_it(autopilot, raw):
    reader = ParameterReader(DRONE, autopilot)
    reader.ask(["EKF2_EV_CTRL"])
    assert [request.name for request in reader.due(0)] == ["EKF2_EV_CTRL"]
    assert reader.receive(_value("EKF2_EV_CTRL", raw, ParamType.INT32), armed=False) == ""
    assert reader.values == {"EKF2_EV_CTRL": 11.0}
    assert not reader.reading


def test_silent_names_are_asked_six_times_four_at_once_then_given_up():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    reader.ask(["A", "B", "C", "D", "E"])
    asked: list[str] = []
    for ms in range(0, 20_000, 10):
        asked += [request.name for request in reader.due(ms * MS)]
    assert asked[:4] == ["A", "B", "C", "D"]
    assert {name: asked.count(name) for name in "ABCDE"} == dict.fromkeys("ABCDE", 6)
    assert not reader.reading
    assert reader.values == {}


def _knowing(value: float = 0.5) -> ParameterReader:
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    reader.ask(["MPC_THR_HOVER"])
    assert reader.receive(_float("MPC_THR_HOVER", value), armed=True) == ""  # a ground that begins in flight
    return reader


def test_an_announced_change_is_asked_for_and_only_the_answer_taken():
    reader = _knowing()
    assert reader.receive(_float("MPC_THR_HOVER", 0.4), armed=False) == "parameter that was not asked for"
    assert reader.values == {"MPC_THR_HOVER": 0.5}
    assert [request.name for request in reader.due(0)] == ["MPC_THR_HOVER"]
    assert reader.receive(_float("MPC_THR_HOVER", 0.4), armed=False) == ""
    assert reader.values["MPC_THR_HOVER"] == pytest.approx(0.4)


def test_nothing_that_is_known_changes_while_armed():
    """Asked for or not: a drone led by another hover thrust rises, or falls."""
    for asked in (False, True):
        reader = _knowing()
        if asked:
            reader.ask(["MPC_THR_HOVER"])
        assert reader.receive(_float("MPC_THR_HOVER", 0.1), armed=True) == "MPC_THR_HOVER announced anew while armed"
        assert reader.values == {"MPC_THR_HOVER": 0.5}
        assert reader.due(0) == []


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_value_that_is_not_finite_or_of_a_type_that_does_not_fit_is_rejected(value):
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    reader.ask(["MPC_THR_HOVER"])
    assert reader.receive(_float("MPC_THR_HOVER", value), armed=False) == "parameter that is not finite"
    assert reader.receive(_value("MPC_THR_HOVER", bytes(4), ParamType.REAL64), armed=False)
    assert reader.values == {}


def test_what_nobody_asked_for_is_not_kept():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    for k in range(5000):
        assert reader.receive(_value(f"P{k}", struct.pack("<i", 1), ParamType.INT32), armed=False)
    assert (reader.values, reader.due(0)) == ({}, [])


def test_an_answer_counts_for_the_oldest_command_of_its_number():
    """The first of two intervals is sent twice and answered twice; the second is lost, and has to be sent again."""
    channel, one, other = CommandChannel(), stream(DRONE, 30, 50.0), stream(DRONE, 32, 50.0)
    channel.ask(one)
    channel.ask(other)
    assert [channel.due(ms * MS).params[0] for ms in (0, 250)] == [30.0, 30.0]
    channel.receive(_ack(511), 260 * MS)
    assert channel.due(261 * MS).params[0] == 32.0
    channel.receive(_ack(511), 262 * MS)
    assert set(channel.answers) == {one}
    assert channel.due(511 * MS).params[0] == 32.0
    channel.receive(_ack(511), 520 * MS)
    channel.receive(_ack(511), 530 * MS)
    assert channel.answers[other].accepted


def test_an_answer_to_a_refused_command_is_not_that_of_the_same_command_asked_again():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    assert channel.due(0) is not None
    assert channel.due(250 * MS) is not None
    channel.receive(_ack(400, Result.DENIED), 300 * MS)
    channel.reset_answer(arm(DRONE))
    channel.ask(arm(DRONE))
    assert channel.due(310 * MS) is not None
    channel.receive(_ack(400, Result.DENIED), 320 * MS)
    assert arm(DRONE) not in channel.answers
    channel.receive(_ack(400), 330 * MS)
    assert channel.answers[arm(DRONE)].accepted


def test_answers_that_were_lost_keep_no_later_command_waiting_for_more_than_a_second():
    channel = CommandChannel()
    channel.ask(disarm(DRONE))
    for ms in range(0, 2500, 10):
        channel.due(ms * MS)
    channel.ask(arm(DRONE))
    for ms in range(2500, 4500, 10):
        if channel.due(ms * MS) is not None:
            channel.receive(_ack(400), ms * MS)
    assert channel.answers[arm(DRONE)].accepted
    assert channel.answers[arm(DRONE)].t_ns <= 3500 * MS
