"""No sequence of requests and faults makes the core raise, or leaves motors commanded after STOPPED."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formation.messages import Datagram, Phase, Verb
from formation.safety.phases import STREAMING
from tests.gcs.fakes import FakeLab, triangle
from wire.ground_state import encode
from wire.link_messages import AttitudeSetpoint, CommandLong

NAMES = ("lead", "left", "right")


def _hide(lab, k):
    lab.hidden.symmetric_difference_update({NAMES[k]})


def _stop_frames(lab, _k):
    lab.frames_stopped = not lab.frames_stopped


def _mute(lab, k):
    lab.drones[k + 1].sends_nothing = not lab.drones[k + 1].sends_nothing


def _deafen(lab, k):
    lab.drones[k + 1].receives_nothing = not lab.drones[k + 1].receives_nothing


def _refuse(lab, k):
    lab.drones[k + 1].rejects_arming = not lab.drones[k + 1].rejects_arming


def _take_over(lab, k):
    lab.drones[k + 1].mode = 3 << 16


def _disarm(lab, k):
    lab.drones[k + 1].armed = False


def _carry_away(lab, k):
    lab.drones[k + 1].pos = lab.drones[k + 1].pos + np.array([1.5, 0.0, 0.2])


def _babble(lab, k):
    lab.core.receive(Datagram(k + 1, bytes(range(k, 200 + k))), lab.now_ns)
    lab.core.receive(Datagram(99, b"\xfd\x09\x00"), lab.now_ns)


FAULTS = (_hide, _stop_frames, _mute, _deafen, _refuse, _take_over, _disarm, _carry_away, _babble)
FLIGHT = (Verb.ARM, Verb.TAKEOFF, Verb.START, Verb.HOLD, Verb.LAND)

ARGUMENTS = {
    Verb.SHAPE: "configured", Verb.TRAJECTORY: "configured", Verb.EXCLUDE: "left", Verb.INCLUDE: "left",
    Verb.REPLACE: "9 left", Verb.MOVE: "lead 0.4 0 0 0.5",
}  # fmt: skip
REQUESTS = (*((verb, ARGUMENTS.get(verb, "")) for verb in Verb), (Verb.LAND, "left"), (Verb.ARM, "lead,right"))

steps = st.one_of(
    st.tuples(st.just("ask"), st.sampled_from(REQUESTS)),
    st.tuples(st.just("ask"), st.sampled_from([(verb, "") for verb in FLIGHT])),
    st.tuples(st.just("run"), st.floats(0.05, 4.0)),
    st.tuples(st.just("fault"), st.tuples(st.sampled_from(FAULTS), st.integers(0, 2))),
)


def _apply(lab: FakeLab, step) -> None:
    kind, what = step
    if kind == "ask":
        lab.ask(*what)
    elif kind == "run":
        lab.run(what)
    else:
        fault, k = what
        fault(lab, k)


def _check_since(lab: FakeLab, heard_from: dict[int, int]) -> None:
    """What each drone heard since: no setpoint outside the streaming phases, no arming once stopped."""
    for sysid, drone in lab.drones.items():
        news = drone.heard[heard_from[sysid] :]
        if lab.phase is Phase.STOPPED:
            assert not any(isinstance(m, AttitudeSetpoint) for m in news)
            assert not any(isinstance(m, CommandLong) and m.command == 400 and m.params[0] == 1.0 for m in news)
    json.loads(encode(lab.core.state(lab.now_ns)), parse_constant=pytest.fail)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(start=st.integers(0, len(FLIGHT)), rest=st.lists(steps, min_size=1, max_size=8))
def test_requests_and_faults_in_any_order(start, rest):
    lab = FakeLab(triangle())
    lab.run(2.0)
    for verb in FLIGHT[:start]:
        lab.ask(verb)
        lab.run(5.0 if verb is Verb.ARM else 2.0)
    for step in rest:
        was_stopped = lab.phase is Phase.STOPPED
        heard = {sysid: len(drone.heard) for sysid, drone in lab.drones.items()}
        _apply(lab, step)
        assert not was_stopped or lab.phase is Phase.STOPPED or step[1] == (Verb.RESET, "")
        if was_stopped and lab.phase is Phase.STOPPED:
            _check_since(lab, heard)
    lab.frames_stopped = False
    for drone in lab.drones.values():
        drone.receives_nothing = drone.sends_nothing = False
    lab.ask(Verb.STOP)
    heard = {sysid: len(drone.heard) for sysid, drone in lab.drones.items()}
    lab.run(2.0)
    assert lab.phase is Phase.STOPPED
    assert lab.phase not in STREAMING
    assert not any(drone.armed for drone in lab.drones.values())
    _check_since(lab, heard)
