from formation.messages import Event, EventCode, Severity
from wire.rejections import OTHER_REASONS, OTHERS, REASONS, SOURCES, RejectionLog

SECOND = 1_000_000_000


def test_the_first_is_told_at_once_and_a_flood_once_a_second() -> None:
    refusals = RejectionLog()
    told: list[Event] = []
    for k in range(6400):  # ten seconds of 640 a second
        now_ns = k * SECOND // 640
        refusals.note("10.0.0.9", "not MAVLink", now_ns)
        told += refusals.due(now_ns)
    assert told[0] == Event(Severity.WARNING, "10.0.0.9", "refused: 1 x not MAVLink", code=EventCode.INPUT_REJECTED)
    assert told[1].text == "refused: 640 x not MAVLink"
    assert len(told) == 10
    assert refusals.count == 6400


def test_nothing_is_told_of_nothing_and_what_waits_is_told_when_its_second_is_over() -> None:
    refusals = RejectionLog()
    assert refusals.due(5) == ()
    refusals.note("a", "x", 10)
    assert len(refusals.due(10)) == 1
    refusals.note("a", "x", 11, count=3)
    assert refusals.due(10 + SECOND - 1) == ()
    assert refusals.due(10 + SECOND) == (Event(Severity.WARNING, "a", "refused: 3 x x", code=EventCode.INPUT_REJECTED),)
    assert refusals.due(10 + 9 * SECOND) == ()


def test_invented_senders_and_reasons_stay_bounded_and_counted() -> None:
    refusals = RejectionLog()
    for k in range(1000):
        refusals.note(f"10.0.0.{k}", f"reason {k}", 0)
    events = refusals.due(0)
    assert len(events) == SOURCES + 1
    assert events[-1].source == OTHERS
    assert OTHER_REASONS in events[-1].text
    assert events[-1].text.count(" x ") == REASONS + 1
    assert refusals.count == 1000


def test_a_quiet_source_gives_its_place_to_a_new_one() -> None:
    refusals = RejectionLog()
    for k in range(SOURCES):
        refusals.note(f"old {k}", "x", 0)
    refusals.due(0)
    refusals.note("new", "x", 2 * SECOND)
    assert [event.source for event in refusals.due(2 * SECOND)] == ["new"]
