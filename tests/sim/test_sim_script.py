import pytest

from formation.messages import OperatorReply, Phase, Verb
from sim.script import FLIGHT, REFUSED_FOR_NS, RETRY_NS, Operator, Outcome, Step

S = 1_000_000_000


def yes(operator: Operator, leader_done: bool, now_ns: int) -> Verb | None:
    """Let the operator ask, and grant it."""
    request = operator.next_request(leader_done, now_ns)
    if request is None:
        return None
    operator.receive(OperatorReply(request.id, True, ""), now_ns)
    return request.verb


def test_a_whole_flight_is_asked_for_step_by_step() -> None:
    operator = Operator(FLIGHT)
    assert yes(operator, False, 0) is None  # nothing is known of the ground yet
    operator.observe(Phase.GROUND, 0)
    assert yes(operator, False, 0) is Verb.ARM
    operator.observe(Phase.ARMED, S)
    assert yes(operator, False, S) is Verb.TAKEOFF
    operator.observe(Phase.TAKEOFF, 2 * S)
    assert yes(operator, False, 3 * S) is None
    operator.observe(Phase.HOLD, 4 * S)
    assert yes(operator, False, 4 * S + S // 2) is None
    assert yes(operator, False, 5 * S) is Verb.START
    operator.observe(Phase.FORMATION, 5 * S)
    assert yes(operator, False, 9 * S) is None
    assert yes(operator, True, 9 * S) is Verb.HOLD
    operator.observe(Phase.HOLD, 9 * S)
    assert yes(operator, True, 10 * S) is Verb.LAND
    operator.observe(Phase.LAND, 10 * S)
    assert operator.outcome is None
    operator.observe(Phase.GROUND, 14 * S)
    assert operator.outcome == Outcome("landed")


def test_a_refused_request_is_asked_again_and_given_up_with_the_grounds_own_reason() -> None:
    operator = Operator(FLIGHT)
    operator.observe(Phase.GROUND, 0)
    now, asked = 0, 0
    while operator.outcome is None:
        request = operator.next_request(False, now)
        if request is not None:
            asked += 1
            operator.receive(OperatorReply(request.id, False, "no pose of F"), now)
        now += 10_000_000
    assert operator.outcome == Outcome("aborted", "arm refused: no pose of F")
    assert abs(asked - REFUSED_FOR_NS // RETRY_NS) <= 2


def test_a_request_that_was_not_answered_is_made_again_and_an_answer_to_an_older_one_means_nothing() -> None:
    operator = Operator(FLIGHT)
    operator.observe(Phase.GROUND, 0)
    first = operator.next_request(False, 0)
    assert operator.next_request(False, RETRY_NS - 1) is None
    second = operator.next_request(False, RETRY_NS)
    assert first is not None
    assert second is not None
    assert second.verb is first.verb
    operator.receive(OperatorReply(first.id, True, ""), RETRY_NS)
    operator.observe(Phase.ARMED, RETRY_NS)
    assert operator.next_request(False, 2 * RETRY_NS) is None


@pytest.mark.parametrize(
    ("phases", "outcome"),
    [
        ((Phase.GROUND, Phase.ARMED, Phase.STOPPED), Outcome("aborted", "the ground stopped every drone")),
        ((Phase.GROUND, Phase.ARMED, Phase.GROUND), Outcome("aborted", "back on the ground before `takeoff`")),
    ],
)
def test_a_flight_that_ends_early_is_aborted(phases: tuple[Phase, ...], outcome: Outcome) -> None:
    operator = Operator(FLIGHT)
    for second, phase in enumerate(phases):
        operator.observe(phase, second * S)
        if second == 0:
            yes(operator, False, 0)
    assert operator.outcome == outcome


def test_the_last_step_may_leave_the_drones_holding() -> None:
    operator = Operator((Step(verb=Verb.ARM, phase="GROUND"), Step(verb=Verb.TAKEOFF, phase="ARMED")))
    operator.observe(Phase.GROUND, 0)
    yes(operator, False, 0)
    operator.observe(Phase.ARMED, S)
    yes(operator, False, S)
    operator.observe(Phase.HOLD, 2 * S)
    assert operator.outcome == Outcome("held")
