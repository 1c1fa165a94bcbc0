import asyncio
import math
from dataclasses import replace
from typing import ClassVar, cast

import numpy as np
import pytest

from formation.config import LabConfig
from formation.maths import frames
from formation.messages import RawFrame
from gcs.doctor.checks import check_mocap
from gcs.doctor.survey import Survey, examine
from gcs.finding import Finding, Grade
from mocap.core import MocapCore

MS = 1_000_000
HALF = math.sqrt(0.5)


def _lab(**mocap) -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": mocap,
            "leader": {"body": "lead", "sysid": 1},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}],
        }
    )


def _frames(
    config=None, n=500, period_ms=10.0, delay_ms=8.0, scale=1.0, q=frames.IDENTITY, jitter_ms=0.1, lost=(), **changes
):
    """What a mocap with these faults makes the mocap process publish, with each frame's receipt."""
    rng, core = np.random.default_rng(1), MocapCore(config or _lab())
    bodies = changes.get("bodies", ("lead", "left"))
    pos = np.array(changes.get("pos", [[0.0, 0.0, 0.0], [-0.4, 0.4, 0.0]]))
    received = []
    for seq in range(n):
        if seq in lost:
            continue
        t_ns = 10**12 + round((seq * period_ms + jitter_ms * rng.choice([-1.0, 1.0])) * MS)
        seen = np.array([rng.random() < changes.get("seen", 1.0) for _ in bodies])
        noise = rng.normal(0.0, changes.get("noise_m", 1e-4), pos.shape)
        raw = RawFrame(seq, t_ns, tuple(bodies), (pos + noise) * scale, np.tile(q, (len(bodies), 1)), seen)
        received_ns = t_ns + round(delay_ms * MS)
        frame = core.receive(raw, received_ns)
        assert frame is not None
        received.append((received_ns, frame))
    return received


def _bad(findings: tuple[Finding, ...]) -> dict[tuple[str, str], Finding]:
    return {(f.subject, f.check): f for f in findings if f.grade is not Grade.PASS}


def test_a_good_mocap_passes_every_check_and_a_silent_one_fails():
    assert _bad(check_mocap(_lab(), _frames())) == {}
    (finding,) = check_mocap(_lab(), [])
    assert (finding.check, finding.grade) == ("frames", Grade.FAIL)


@pytest.mark.parametrize(
    ("fault", "subject", "check", "grade", "words"),
    [
        ({"period_ms": 5.0}, "mocap", "rate", Grade.FAIL, "100 Hz"),
        ({"jitter_ms": 4.5, "n": 190}, "mocap", "jitter", Grade.FAIL, ""),  # too few to be re-timed
        ({"lost": range(100, 120)}, "mocap", "lost frames", Grade.WARN, "4.0%"),
        ({"delay_ms": 30.0}, "mocap", "delay", Grade.WARN, "30.0 ms"),
        ({"delay_ms": 0.1}, "mocap", "delay", Grade.WARN, "not measured"),  # stamped as they are sent
        ({"bodies": ("lead", "Rigid Body 2")}, "left", "seen", Grade.FAIL, "Rigid Body 2"),
        ({"seen": 0.8}, "left", "seen", Grade.WARN, ""),
        ({"noise_m": 0.003}, "left", "noise at rest", Grade.FAIL, " mm"),
        ({"noise_m": 0.0}, "left", "noise at rest", Grade.WARN, "not measured"),  # frozen
        ({"scale": 1000.0}, "mocap", "units", Grade.FAIL, "millimetres"),
    ],
)
def test_a_fault_is_named_with_its_figure(fault, subject, check, grade, words):
    found = _bad(check_mocap(_lab(), _frames(**fault), ["Rigid Body 2"]))[subject, check]
    assert found.grade is grade
    assert words in f"{found.found}, {found.wanted}: {found.why}"


def test_frames_that_come_in_pairs_have_their_mean_rate():
    """Two simulators whose messages interlock: 12 ms, then 8 ms, as two ArduCopters were seen to."""
    steady = _frames(jitter_ms=0.0)
    paired = [(t, replace(f, t_capture_ns=f.t_capture_ns + f.seq % 2 * 2 * MS)) for t, f in steady]
    assert ("mocap", "rate") not in _bad(check_mocap(_lab(), paired))


def test_stamps_that_are_arrival_times_are_named():
    """A network that holds one frame in ten back by 20 ms lets those behind it arrive with it, 1 us apart."""
    late, newest_ns = [], 0
    for received_ns, frame in _frames():
        arrival_ns = received_ns + (20 * MS if frame.seq % 10 == 0 else 0)
        newest_ns = max(newest_ns + 1000, arrival_ns)
        late.append((newest_ns, replace(frame, t_capture_ns=newest_ns - 8 * MS)))
    bad = _bad(check_mocap(_lab(), late))
    assert bad["mocap", "stamps"].found == "arrival times"
    assert bad["mocap", "stamps"].grade is Grade.WARN
    bad = _bad(check_mocap(_lab(), _frames(), retimed_scatter_s=0.00021))  # even, and yet told
    assert bad["mocap", "stamps"].found == "arrival times, re-timed with a scatter of 0.21 ms"


def test_a_y_up_mocap_is_named_by_bodies_that_lie_on_their_side():
    # A level drone seen by a y-up mocap: its up axis lies along the mocap's y.
    bad = _bad(check_mocap(_lab(), _frames(q=np.array([HALF, -HALF, 0.0, 0.0]))))
    assert "y-up" in bad["lead", "level at rest"].why
    put_right = _lab(q_lab_from_mocap=(HALF, HALF, 0.0, 0.0))
    frames_put_right = _frames(put_right, q=np.array([HALF, -HALF, 0.0, 0.0]))
    assert ("lead", "level at rest") not in _bad(check_mocap(put_right, frames_put_right))


def test_fence_floor_and_separation():
    bad = _bad(check_mocap(_lab(), _frames(pos=[[2.7, 0.0, 0.5], [2.6, 0.0, 0.5]])))
    assert bad["lead", "inside the fence"].grade is Grade.FAIL
    assert "0.20 m outside" in bad["lead", "inside the fence"].why
    assert bad["lead", "on the floor"].grade is Grade.WARN
    assert bad["left", "separation"].found == "0.10 m"


def test_a_delay_that_is_only_the_configured_one_is_not_measured():
    """A recording is stamped by mocap.delay_s itself: whatever it says was found to be right."""
    bad = _bad(check_mocap(_lab(source="csv", file="x", delay_s=0.008), _frames(delay_ms=8.0)))
    assert (bad["mocap", "delay"].found, bad["mocap", "delay"].grade) == ("not measured", Grade.WARN)
    assert bad["mocap", "lost frames"].found == "not measured"


def test_without_a_camera_nobody_is_asked_to_move_a_drone():
    """The doctor once had every drone stood and tipped, and then said that there were no frames."""

    class Blind:
        received: ClassVar[list[object]] = []
        unknown_bodies, retimed_scatter_s, signing = (), None, ()

        async def settle(self) -> None:
            """Nothing comes."""

        async def check_drones(self) -> tuple[Finding, ...]:
            return ()

    async def asked(text: str) -> None:
        raise AssertionError(text)

    found = asyncio.run(examine(_lab(), asked, cast("Survey", Blind()), 0.0))
    assert {(f.check, f.found) for f in found} == {("frames", "0 frames"), ("axes", "not measured")}
