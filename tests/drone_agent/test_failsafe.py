"""The stages of a stream that falls silent, by the times alone."""

import numpy as np

from drone_agent.bridge.takeover import STEP_NS, Takeover, Turn
from drone_agent.failsafe import StreamFailsafe
from drone_agent.stages import Stage, Trigger
from tests.drone_agent.agent_harness import MS, Harness
from wire.link_messages.address import GROUND
from wire.link_messages.commands import CommandAck, Result


def _streamed(failsafe: StreamFailsafe, period_ms: int = 10, last_ms: int = 1000) -> None:
    failsafe.pull(Trigger.ARM, 0)
    failsafe.pull(Trigger.STREAM, 0)
    for ms in range(0, last_ms + 1, period_ms):
        failsafe.follow(GROUND, ms * MS)


def test_holds_when_stale_then_lands() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.deadline_ns == 1100 * MS
    assert failsafe.advance(1100 * MS - 1) is None
    assert failsafe.advance(1100 * MS) is Stage.HOLD
    assert failsafe.deadline_ns == 2100 * MS
    assert failsafe.advance(2100 * MS) is Stage.LAND
    assert failsafe.deadline_ns is None
    assert not failsafe.follow(GROUND, 2110 * MS)
    assert failsafe.stage is Stage.LAND


def test_the_second_setpoint_in_time_ends_a_hold() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    failsafe.advance(1200 * MS)
    assert not failsafe.follow(GROUND, 1300 * MS)
    assert failsafe.broken
    assert failsafe.follow(GROUND, 1400 * MS)
    assert failsafe.stage is Stage.FOLLOW
    assert not failsafe.broken
    assert not failsafe.follow(GROUND, 1410 * MS)


def test_a_stream_that_has_become_a_trickle_is_not_followed_again_and_landed_by() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.advance(1100 * MS) is Stage.HOLD
    for ms in range(1170, 2100, 170):
        assert not failsafe.follow(GROUND, ms * MS)
        assert failsafe.advance(ms * MS) is None
    assert failsafe.advance(2100 * MS) is Stage.LAND


def test_a_slow_stream_is_stale_after_three_of_its_periods() -> None:
    failsafe = StreamFailsafe(0.1, None)
    _streamed(failsafe, period_ms=200, last_ms=5000)
    assert failsafe.deadline_ns == 5600 * MS


def test_a_client_of_20_hz_that_misses_its_turn_and_catches_up_is_not_stale() -> None:
    """As MAVSDK's offboard plugin was seen to send beside two busy loops: 105 ms, then 21; it keeps to its raster."""
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe, period_ms=50, last_ms=2000)
    for ms in (2105, 2126, 2150, 2238, 2242, 2300, 2350, 2400, 2505):
        assert failsafe.advance(ms * MS) is None
        assert not failsafe.follow(GROUND, ms * MS)
    assert failsafe.stage is Stage.FOLLOW
    assert failsafe.advance(2655 * MS) is Stage.HOLD


def test_a_fast_stream_that_loses_nine_in_ten_is_stale_as_soon_as_ever() -> None:
    failsafe, rng = StreamFailsafe(0.1, None), np.random.default_rng(4)
    _streamed(failsafe)
    for ms in range(1010, 120_000, 10):
        if rng.random() < 0.1:
            failsafe.follow(GROUND, ms * MS)
            assert failsafe.deadline_ns == (ms + 100) * MS


def test_without_a_pose_a_hold_lands_at_once() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.advance(1099 * MS, no_pose=True) is None
    assert [failsafe.advance(1100 * MS, no_pose=True) for _ in range(3)] == [Stage.HOLD, Stage.DESCEND, None]


def test_an_own_time_out_that_floats_round_up_is_still_the_autopilots() -> None:
    """0.3 s as a MAVLink float is 0.30000001192...: the deadline and the silence must mean the same nanosecond."""
    harness = Harness(parameters={"COM_OF_LOSS_T": 0.3})
    harness.fly_offboard(0.5)
    harness.run(0.5)
    assert "No offboard signal" in harness.texts()
    assert not any("stale" in text for text in harness.texts())


def _taken_over() -> Takeover:
    takeover = Takeover(0.1, 1.0)
    takeover.saw(0, armed=True, offboard=True)
    takeover.note(GROUND, 0)
    return takeover


def test_the_bridge_holds_lets_down_and_commands_a_landing_until_it_is_taken() -> None:
    takeover = _taken_over()
    assert takeover.due(100 * MS, fed=True, stands=False) == Turn((Stage.HOLD,), Stage.HOLD, lands=False)
    assert takeover.deadline_ns() == 100 * MS + STEP_NS
    assert takeover.due(1100 * MS, fed=True, stands=False) == Turn((Stage.LAND,), Stage.LAND, lands=False)
    assert takeover.due(2000 * MS, fed=True, stands=True) == Turn((), Stage.LAND, lands=True)
    assert takeover.due(2010 * MS, fed=True, stands=True) == Turn((), Stage.LAND, lands=False)
    assert takeover.due(2300 * MS, fed=True, stands=True).lands
    takeover.acknowledged(CommandAck(GROUND, 21, Result.ACCEPTED))
    assert takeover.deadline_ns() is None


def test_the_bridge_without_a_pose_commands_a_landing_at_once() -> None:
    turn = _taken_over().due(100 * MS, fed=False, stands=False)
    assert turn == Turn((Stage.HOLD, Stage.DESCEND), Stage.DESCEND, lands=True)


def test_the_bridge_leaves_an_autopilot_alone_whose_mode_it_does_not_know() -> None:
    takeover = _taken_over()
    takeover.mode_unknown()
    assert takeover.due(500 * MS, fed=True, stands=False) == Turn()
    takeover.saw(500 * MS, armed=True, offboard=False)
    assert takeover.deadline_ns() is None
