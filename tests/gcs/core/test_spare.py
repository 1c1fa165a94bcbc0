"""A spare of another system id takes a drone's place on the ground; what flies next flies it."""

import numpy as np
import pytest

from formation.messages import Phase, Verb
from formation.reasons import Reason
from tests.gcs.fakes import STAY, FakeDrone, FakeLab, answer, commands, reasons, triangle
from wire.link_messages import MavCommand

RIGHT, SPARE = 3, 7


@pytest.fixture
def lab() -> FakeLab:
    """The triangle after a flight: `right` is switched off, and a spare is put where it stood, heavier by a fifth."""
    lab = FakeLab(triangle(leader=STAY))
    lab.fly()
    lab.land()
    lab.drones[RIGHT].sends_nothing = lab.drones[RIGHT].receives_nothing = True
    lab.run(4.0)
    lab.spare = FakeDrone(SPARE, (-0.4, -0.45, 0.0), 1.2 * lab.drones[RIGHT].hover)
    return lab


def replaced(lab: FakeLab, argument: str = "7 right"):
    lab.in_place = {"right": SPARE} if SPARE in lab.drones else {}
    request = lab.ask(Verb.REPLACE, argument)
    lab.run(4.0)
    return lab.reply(request)


def test_the_spare_flies_in_its_place_and_the_log_says_so(lab: FakeLab) -> None:
    lab.drones[SPARE] = lab.spare
    reply = replaced(lab)
    assert reply.accepted
    assert reply.text.startswith("right is system 7 until this ground ends: to keep it, write sysid = 7")
    assert ("replaced", "right") in lab.reported
    assert [(drone.body, drone.sysid) for drone in lab.state.drones] == [("lead", 1), ("left", 2), ("right", 7)]
    lab.run(3.0)
    heard = len(lab.drones[RIGHT].heard)
    lab.fly()
    lab.run(5.0)
    assert lab.phase is Phase.FORMATION
    np.testing.assert_allclose(lab.spare.pos - lab.drones[1].pos, [-0.4, -0.4, 0.0], atol=0.02)
    lab.land()
    assert len(lab.drones[RIGHT].heard) == heard
    assert commands(lab.spare, MavCommand.COMPONENT_ARM_DISARM)


def test_one_that_crashed_armed_is_replaced_once_it_is_silent(lab: FakeLab) -> None:
    lab.drones[SPARE] = lab.spare
    lab.drones[RIGHT].armed, lab.drones[RIGHT].sends_nothing = True, False
    lab.run(1.2)
    assert Reason.ARMED_IN in reasons(lab, Verb.REPLACE, "7 right")
    lab.drones[RIGHT].sends_nothing = True
    lab.run(3.5)
    assert replaced(lab).accepted


@pytest.mark.parametrize(
    ("argument", "reason"),
    [
        ("7 middle", Reason.NO_DRONE),
        ("2 right", Reason.SYSID_IN_USE),
        ("3 right", Reason.SYSID_IN_USE),
        ("251 right", Reason.NO_SYSID),
        ("right", Reason.NO_DRONE),
        ("x right", Reason.NO_SYSID),
    ],
)
def test_refusals_before_anything_is_listened_to(lab: FakeLab, argument: str, reason: Reason) -> None:
    assert reasons(lab, Verb.REPLACE, argument) == [reason]


def test_a_spare_that_is_silent_or_armed_is_refused_and_may_be_asked_again(lab: FakeLab) -> None:
    silent = replaced(lab)
    assert silent.codes == ("spare_unheard",)
    assert "drone-agent --lab ... --body right --sysid 7" in silent.text
    lab.drones[SPARE] = lab.spare
    lab.spare.armed = True
    lab.ask(Verb.REPLACE, "7 right")
    assert answer(lab, Verb.REPLACE, "7 right").codes == ("spare_awaited",)
    lab.run(1.5)
    assert lab.replies[-1].codes == ("spare_armed",)
    lab.spare.armed = False
    lab.run(1.2)
    assert replaced(lab).accepted


def test_in_flight_nobody_is_replaced(lab: FakeLab) -> None:
    lab.drones[SPARE] = lab.spare
    replaced(lab)
    lab.run(3.0)
    lab.take_off()
    assert reasons(lab, Verb.REPLACE, "3 right") == [Reason.OUT_OF_TURN]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"security": {}}, Reason.KEYS_BY_SYSID),
        ({"leader": STAY | {"link": "udp:127.0.0.1:14551", "guard": "none"}}, Reason.OWN_LINK),
    ],
)
def test_what_the_lab_file_alone_can_say_is_refused(changes, reason: Reason) -> None:
    lab = FakeLab(triangle(**changes))
    lab.run(2.0)
    assert reasons(lab, Verb.REPLACE, "7 lead") == [reason]
