from gcs.drones.commands import CommandChannel, arm, cut, disarm, land
from wire.link_messages.address import Address
from wire.link_messages.commands import CommandAck, MavCommand, Result

DRONE = Address(3, 1)
GROUND = Address(255, 190)
MS = 1_000_000


def _ack(command: int, result: Result = Result.ACCEPTED) -> CommandAck:
    return CommandAck(GROUND, command, result)


def test_an_unanswered_command_is_repeated_with_a_rising_confirmation_then_given_up():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    sent = [(ms, command.confirmation) for ms in range(3000) if (command := channel.due(ms * MS)) is not None]
    assert sent == [(250 * i, i) for i in range(8)]
    answer = channel.answers[arm(DRONE)]
    assert answer.result is None
    assert str(answer) == "no answer"
    assert not answer.accepted


def test_an_answer_ends_the_repeats():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.due(0)
    channel.receive(_ack(MavCommand.COMPONENT_ARM_DISARM), 100 * MS)
    assert channel.due(1000 * MS) is None
    assert channel.answers[arm(DRONE)].accepted


def test_a_refusal_is_kept_with_its_word():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.due(0)
    channel.receive(_ack(MavCommand.COMPONENT_ARM_DISARM, Result.TEMPORARILY_REJECTED), MS)
    assert str(channel.answers[arm(DRONE)]) == "temporarily rejected"


def test_commands_go_one_at_a_time_in_order():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.ask(land(DRONE))
    channel.ask(land(DRONE))
    assert channel.due(0).command == 400
    assert channel.due(MS) is None
    channel.receive(_ack(400), 2 * MS)
    assert channel.due(3 * MS).command == 21
    channel.receive(_ack(21), 4 * MS)
    assert channel.due(5 * MS) is None


def test_progress_puts_the_repeat_off():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.due(0)
    channel.receive(_ack(MavCommand.COMPONENT_ARM_DISARM, Result.IN_PROGRESS), 100 * MS)
    assert channel.due(1000 * MS) is None
    assert channel.due(3200 * MS) is not None


def test_answers_to_other_commands_are_not_taken():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.due(0)
    channel.receive(_ack(21), MS)
    assert channel.due(300 * MS).confirmation == 1


def test_an_urgent_command_goes_first_and_is_never_given_up():
    channel = CommandChannel()
    channel.ask(arm(DRONE))
    channel.ask(land(DRONE))
    channel.due(0)
    channel.urge(cut(DRONE))
    sent = []
    for ms in range(1, 3000):
        channel.urge(cut(DRONE))
        command = channel.due(ms * MS)
        if command is not None:
            sent.append((ms, command.params[:2]))
    assert len(sent) == 300
    assert all(params == (0.0, 21196.0) for _, params in sent)
    assert [sent[1][0] - sent[0][0], sent[2][0] - sent[1][0]] == [10, 10]


def test_disarming_is_not_forced_and_cutting_is():
    assert disarm(DRONE).params[:2] == (0.0, 0.0)
    assert cut(DRONE).params[:2] == (0.0, 21196.0)
