"""Drones told apart: lifted in front of a mocap and autopilots that are swapped, or armed alone by a ground."""

import asyncio
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from formation.messages import Phase, Verb
from formation.requests import OperatorReply
from gcs.doctor.checks import Snapshot
from gcs.doctor.identify import Identified, StoppedError, by_hand, by_motors, judge
from gcs.finding import Finding, Grade
from tests.gcs.fakes import FakeLab, triangle

BODIES = ["lead", "left", "right"]
LEVEL, TIPPED = (1.0, 0.0, 0.0, 0.0), (math.cos(0.25), math.sin(0.25), 0.0, 0.0)
LAB = triangle()


class Hand:
    """Lifts the drones of a lab as it is asked to: their labels are 0, 1, 2, in the order of the lab file.

    bodies, sysids: what mocap and autopilot of each label are. lifts: which labels are lifted when one is asked for.
    """

    def __init__(
        self, bodies=(0, 1, 2), sysids=(1, 2, 3), lifts: Callable[[int], tuple[int, ...]] = lambda i: (i,)
    ) -> None:  # fmt: skip
        self.bodies, self.sysids, self.lifts = bodies, sysids, lifts
        self.lifted: Iterator[tuple[int, ...]] = iter(())
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)
        if text.startswith("Lift "):
            label = BODIES.index(text.split()[1])
            self.lifted = iter([(), (), *[self.lifts(label)] * 3])

    async def look(self) -> Snapshot:
        lifted = next(self.lifted, ())
        pos, q, own = np.zeros((3, 3)), np.tile(LEVEL, (3, 1)), dict.fromkeys(self.sysids, np.array(LEVEL))
        for label in lifted:
            pos[self.bodies[label], 2], q[self.bodies[label]] = 0.3, TIPPED
            own[self.sysids[label]] = np.array(TIPPED)
        return Snapshot(pos, q, np.ones(3, bool), own)

    def findings(self) -> tuple[Finding, ...]:
        return judge(LAB, asyncio.run(by_hand(LAB, self.look, 8, self.say)))


def _bad(findings: tuple[Finding, ...]) -> dict[str, tuple[str, str]]:
    return {f.subject: (f.found, f.why) for f in findings if f.grade is Grade.FAIL}


def test_a_lab_as_in_its_file_passes() -> None:
    findings = Hand().findings()
    assert [(f.subject, f.found, f.wanted) for f in findings][1] == ("left", "left, system 2", "left, system 2")
    assert _bad(findings) == {}


@pytest.mark.parametrize("swapped", [{"sysids": (1, 3, 2)}, {"bodies": (0, 2, 1)}], ids=["system ids", "names"])
def test_a_swap_is_named_with_the_keys_that_put_it_right(swapped) -> None:
    hand = Hand(**swapped)
    bad = _bad(hand.findings())
    assert sorted(bad) == ["left", "right"]
    whys = " ".join(why for _, why in bad.values())
    assert "write followers[0].sysid = 3" in whys
    assert "write followers[1].sysid = 2" in whys
    values = LAB.model_dump()
    values["followers"][0]["sysid"], values["followers"][1]["sysid"] = 3, 2
    right = type(LAB).model_validate(values)
    again = judge(right, asyncio.run(by_hand(right, hand.look, 8, hand.say)))
    assert {"system ids are swapped" in f.why for f in again} == {False}


def test_another_drone_than_the_one_asked_for_is_no_swap() -> None:
    bad = _bad(Hand(lifts=lambda i: ((0,), (2,), (1,))[i]).findings())
    assert bad["left"][0] == "right, system 3"
    assert "another one was asked for" in bad["left"][1]


@pytest.mark.parametrize(
    ("lifts", "found"),
    [(lambda i: (), "no body, system -"), (lambda i: (i, 0) if i else (i,), "lead and left, system 1 and 2")],
    ids=["nobody lifts", "two at once"],
)
def test_what_is_not_decided_is_not_passed(lifts, found: str) -> None:
    assert _bad(Hand(lifts=lifts).findings())["left"] == (
        "not measured",
        f"one drone was to answer, and it was: {found}",
    )


def test_a_body_that_moves_without_an_autopilot_waits_for_one() -> None:
    hand = Hand(sysids=(1, 2, 9))
    own = {1: np.array(LEVEL)}

    async def look() -> Snapshot:
        seen = await hand.look()
        return Snapshot(seen.pos_lab_m, seen.q_lab_from_flu, seen.seen, own)

    found = asyncio.run(by_hand(LAB, look, 8, hand.say))
    assert found[1] == Identified(1, (1,), ())
    assert "left, system -: tip it until one of each has moved" in hand.said


class Operator:
    """At a ground of fake drones: answers each question, and counts how many are armed at once."""

    def __init__(self, names: dict[str, str | None]) -> None:
        """names: what is answered of whose motors turn, by the body that was asked for."""
        self.lab, self.names, self.said = FakeLab(LAB), names, [""]
        self.most_armed = 0
        self.lab.run(2.0)

    def ask(self, verb: Verb, argument: str) -> OperatorReply:
        request = self.lab.ask(verb, argument)
        while (reply := self.lab.reply(request)) is None:
            self.run(0.01)
        self.run(0.1)
        return reply

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.lab.step()
            self.most_armed = max(self.most_armed, sum(drone.armed for drone in self.lab.drones.values()))

    @property
    def armed(self) -> list[str]:
        return [drone.body for drone in self.lab.state.drones if drone.armed]

    def answer(self, within_s: float | None) -> str | None:
        self.run(within_s or 1.0)
        if self.said[-1].startswith("Arm "):
            return ""
        asked = next(text.split()[1] for text in reversed(self.said) if text.startswith("Arm "))
        assert self.armed == ([asked] if self.said[-1].startswith("Whose") else [])
        return self.names[asked]

    def identify(self) -> list[Identified]:
        return by_motors(LAB, self.ask, self.answer, self.said.append)

    @property
    def is_as_before(self) -> bool:
        state = self.lab.state
        return state.phase is Phase.GROUND and not any(drone.armed or drone.excluded for drone in state.drones)


def test_each_drone_is_armed_alone_and_a_swap_is_named() -> None:
    operator = Operator({"lead": "lead", "left": "right", "right": "left"})
    found = operator.identify()
    assert found == [Identified(0, (0,), (1,)), Identified(1, (2,), (2,)), Identified(2, (1,), (3,))]
    assert sorted(_bad(judge(LAB, found))) == ["left", "right"]
    assert operator.most_armed == 1
    assert operator.is_as_before


def test_without_an_answer_the_motors_stop_by_themselves() -> None:
    operator = Operator(dict.fromkeys(BODIES))
    assert operator.identify() == [Identified(i, (), (i + 1,)) for i in range(3)]
    assert operator.said.count("Disarmed. Whose motors turned?") == 3
    assert operator.is_as_before


def test_a_drone_that_moves_and_a_ctrl_c_end_it_disarmed(monkeypatch) -> None:
    operator = Operator(dict.fromkeys(BODIES))

    def answer(within_s: float | None) -> str | None:
        line = Operator.answer(operator, within_s)
        if within_s is not None:
            operator.lab.shift_m["right"] = (0.2, 0.0, 0.0)
        return line

    with pytest.raises(StoppedError, match=r"^right moved: the motors were stopped$"):
        by_motors(LAB, operator.ask, answer, operator.said.append)
    assert operator.is_as_before

    def interrupted(within_s: float | None) -> str | None:
        if within_s is not None:
            raise KeyboardInterrupt
        return operator.answer(within_s)

    with pytest.raises(KeyboardInterrupt):
        by_motors(LAB, operator.ask, interrupted, operator.said.append)
    assert operator.is_as_before


def test_nobody_is_told_apart_beside_a_flight_or_where_arming_is_refused() -> None:
    operator = Operator({})
    operator.lab.hidden.add("lead")
    operator.run(0.5)
    with pytest.raises(StoppedError, match=r"^lead was not armed: lead: no fresh pose"):
        operator.identify()
    assert operator.is_as_before
    operator.lab.hidden.clear()
    operator.lab.take_off()
    with pytest.raises(StoppedError, match="in HOLD"):
        operator.identify()
    assert operator.lab.phase is Phase.HOLD
