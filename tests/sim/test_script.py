import pytest

from formation.codes import FlightResult, Outcome
from formation.messages import OperatorReply, Phase, Verb
from sim.script import (
    ANSWER_NS,
    FLIGHT,
    READY_WITHIN_NS,
    REJECTED_FOR_NS,
    RETRY_NS,
    Operator,
    OperatorView,
)

S = 1_000_000_000


def see(operator: Operator, phase: Phase, now_ns: int, formed: bool = False, done: bool = False) -> None:
    operator.observe(OperatorView(phase, formed, done), now_ns)


def yes(operator: Operator, now_ns: int) -> Verb | None:
    """Let the operator ask, and grant it."""
    request = operator.next_request(now_ns)
    if request is None:
        return None
    operator.receive(OperatorReply(request.id, True, ""), now_ns)
    return request.verb


def test_a_whole_flight_is_asked_for_step_by_step() -> None:
    operator = Operator(FLIGHT)
    assert yes(operator, 0) is None  # nothing is known of the ground yet
    see(operator, Phase.GROUND, 0)
    assert yes(operator, 0) is Verb.ARM
    see(operator, Phase.ARMED, S)
    assert yes(operator, S) is Verb.TAKEOFF
    see(operator, Phase.TAKEOFF, 2 * S)
    assert yes(operator, 3 * S) is None
    see(operator, Phase.HOLD, 4 * S)
    assert yes(operator, 4 * S + S // 2) is None
    assert yes(operator, 5 * S) is Verb.START
    see(operator, Phase.FORMATION, 5 * S)
    assert yes(operator, 9 * S) is None
    see(operator, Phase.FORMATION, 9 * S, formed=True, done=True)
    assert yes(operator, 9 * S) is Verb.HOLD
    see(operator, Phase.HOLD, 9 * S)
    assert yes(operator, 10 * S) is Verb.LAND
    see(operator, Phase.LAND, 10 * S)
    assert operator.outcome is None
    see(operator, Phase.GROUND, 14 * S)
    assert operator.outcome == Outcome(FlightResult.LANDED)


def test_a_refused_request_is_asked_again_and_given_up_with_the_grounds_own_reason() -> None:
    operator = Operator(FLIGHT)
    see(operator, Phase.GROUND, 0)
    now, asked = 0, 0
    while operator.outcome is None:
        request = operator.next_request(now)
        if request is not None:
            asked += 1
            operator.receive(OperatorReply(request.id, False, "no pose of F"), now)
        now += 10_000_000
    assert operator.outcome == Outcome(FlightResult.ABORTED, "arm refused: no pose of F")
    assert abs(asked - REJECTED_FOR_NS // RETRY_NS) <= 2


def test_a_request_that_was_not_answered_is_made_again_and_an_answer_to_an_older_one_means_nothing() -> None:
    operator = Operator(FLIGHT)
    see(operator, Phase.GROUND, 0)
    first = operator.next_request(0)
    assert operator.next_request(ANSWER_NS - 1) is None
    second = operator.next_request(ANSWER_NS)
    assert first is not None
    assert second is not None
    assert second.verb is first.verb
    operator.receive(OperatorReply(first.id, True, ""), ANSWER_NS)
    see(operator, Phase.ARMED, ANSWER_NS)
    assert operator.next_request(ANSWER_NS + S) is None


@pytest.mark.parametrize(
    ("phases", "reason"),
    [
        ((Phase.GROUND, Phase.ARMED, Phase.STOPPED), "the ground stopped every drone"),
        ((Phase.GROUND, Phase.ARMED, Phase.GROUND), "back on the ground before `takeoff`"),
    ],
)
def test_a_flight_that_ends_early_is_aborted(phases: tuple[Phase, ...], reason: str) -> None:
    operator = Operator(FLIGHT)
    for second, phase in enumerate(phases):
        see(operator, phase, second * S)
        if second == 0:
            yes(operator, 0)
    assert operator.outcome == Outcome(FlightResult.ABORTED, reason)


def test_arming_waits_until_the_ground_has_nothing_against_it_but_not_for_ever() -> None:
    operator = Operator(FLIGHT)
    unready = OperatorView(Phase.GROUND, prearm_failures=("F: no heartbeat",))
    operator.observe(unready, 0)
    assert operator.next_request(READY_WITHIN_NS - 1) is None
    assert operator.next_request(READY_WITHIN_NS) is not None
    eager = Operator(FLIGHT)
    eager.observe(unready, 0)
    eager.observe(OperatorView(Phase.GROUND), S)
    assert eager.next_request(S) is not None
