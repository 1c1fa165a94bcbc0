"""Drones moved by hand in front of mocaps that are wrong in one way each."""

import math

import numpy as np
import pytest

from formation.config import LabConfig
from formation.maths import frames
from formation.messages import RawFrame
from gcs.doctor.checks import Moves, Snapshot, check_axes
from gcs.finding import Finding, Grade
from mocap.alignment import Alignment

HALF = math.sqrt(0.5)
NAMES = ("lead", "left", "right")
PLACES = np.array([[0.0, 0.0, 0.0], [-0.4, 0.4, 0.0], [-0.4, -0.4, 0.0]])
HAND = np.array([[0.5, 0.02, 0.0], [0.01, 0.45, 0.02], [0.0, -0.03, 0.5], [0.0, 0.0, 0.0]])


class WrongMocap:
    """True poses in lab axes; what it sends is in its own axes, names and marker frames."""

    def __init__(self, q_mocap_from_lab=(1.0, 0, 0, 0), scale=1.0, names=NAMES, q_flu_from_marker=(1.0, 0, 0, 0)):
        self.q_mocap_from_lab = np.array(q_mocap_from_lab, float)
        self.scale, self.names = scale, names
        self.q_flu_from_marker = np.array(q_flu_from_marker, float)

    def sends(self, pos, q) -> RawFrame:
        q_mocap = frames.multiply(self.q_mocap_from_lab, frames.multiply(q, self.q_flu_from_marker))
        return RawFrame(0, 1, self.names, frames.rotate(self.q_mocap_from_lab, pos) * self.scale, q_mocap,
                        np.ones(3, bool))  # fmt: skip


def _lab(**changes) -> LabConfig:
    bodies = [
        {"body": n, "sysid": i + 1, "offset_m": (0, 1, 0), **changes.get("vehicle", {})} for i, n in enumerate(NAMES)
    ]
    leader = {key: value for key, value in bodies[0].items() if key != "offset_m"}
    return LabConfig.model_validate({"mocap": changes.get("mocap", {}), "leader": leader, "followers": bodies[1:]})


def _examine(mocap: WrongMocap, config: LabConfig, turn=math.pi / 2, sysids=(1, 2, 3)) -> tuple[Finding, ...]:
    """sysids: of the autopilots that are in the drones, in the order of the lab file; None: it is silent."""
    alignment, moved = Alignment(config), []
    for vehicle in range(3):
        pos, q, snapshots = PLACES.copy(), np.tile(frames.IDENTITY, (3, 1)), []
        for step in range(6):
            frame = alignment.align(mocap.sends(pos, q), 0, 1, 2)
            own = {sysid: each for sysid, each in zip(sysids, q, strict=True) if sysid is not None}
            snapshots.append(Snapshot(frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, own))
            if step == 4:
                q = q.copy()
                q[vehicle] = frames.multiply(q[vehicle], np.array([math.cos(0.25), 0.0, math.sin(0.25), 0.0]))
            if step < 4:
                pos = pos.copy()
                pos[vehicle] += HAND[step]
            if step == 3:
                q = q.copy()
                q[vehicle] = frames.from_yaw(np.array(turn))
        moved.append(Moves(vehicle, tuple(snapshots)))
    return check_axes(config, moved)


def _bad(findings) -> dict[tuple[str, str], str]:
    return {(f.subject, f.check): f.why for f in findings if f.grade is Grade.FAIL}


def test_a_right_mocap_passes():
    findings = _examine(WrongMocap(), _lab())
    assert {f.grade for f in findings} == {Grade.PASS}
    assert {f.check for f in findings} == {"body name", "axes", "yaw zero", "turns left", "system id"}
    turned_right = _bad(_examine(WrongMocap(), _lab(), turn=-math.pi / 2))
    assert set(turned_right) == {(name, "turns left") for name in NAMES}


def test_swapped_bodies_are_named():
    bad = _bad(_examine(WrongMocap(names=("lead", "right", "left")), _lab()))
    assert set(bad) == {("left", "body name"), ("right", "body name")}
    assert "is right for the mocap: bodies are swapped" in bad["left", "body name"]


def test_swapped_system_ids_are_named_and_a_silent_autopilot_is_not_passed():
    findings = _examine(WrongMocap(), _lab(), sysids=(None, 3, 2))
    bad = _bad(findings)
    assert set(bad) == {("left", "system id"), ("right", "system id")}
    assert bad["left", "system id"] == "the drone in your hand answers as right's 3: system ids are swapped"
    (lead,) = [f for f in findings if (f.subject, f.check) == ("lead", "system id")]
    assert (lead.grade, lead.found) == (Grade.WARN, "not measured")


WRONG_AXES = {
    "a quarter turn": ((HALF, 0, 0, HALF), "turned by 90 degrees about up"),
    "half a turn": ((0, 0, 0, 1.0), "turned by 180 degrees about up"),
    "y-up, forward left": ((0.5, -0.5, 0.5, 0.5), "the mocap is y-up"),
    "upside down": ((0, 1.0, 0, 0), "permuted"),
}


@pytest.mark.parametrize(
    "configured", [{}, {"q_lab_from_mocap": (HALF, HALF, 0.0, 0.0)}], ids=["", "on top of another"]
)
@pytest.mark.parametrize("wrong", WRONG_AXES)
def test_wrong_axes_are_named_and_the_line_to_write_puts_them_right(wrong, configured):
    q_mocap_from_lab, words = WRONG_AXES[wrong]
    mocap = WrongMocap(q_mocap_from_lab)
    why = _bad(_examine(mocap, _lab(mocap=configured)))["lead", "axes"]
    assert configured or words in why
    written = [float(x) for x in why.partition("[")[2].rstrip("]").split(",")]
    again = _examine(mocap, _lab(mocap={"q_lab_from_mocap": written}))
    assert {f.grade for f in again} == {Grade.PASS}


def test_millimetres_are_named_and_the_rest_is_still_judged():
    findings = _examine(WrongMocap(scale=1000.0), _lab())
    assert set(_bad(findings)) == {(name, "units") for name in NAMES}
    assert any(f.check == "yaw zero" and f.grade is Grade.PASS for f in findings)


def test_a_marker_frame_turned_on_the_body_is_named_with_its_alignment():
    mocap = WrongMocap(q_flu_from_marker=(HALF, 0, 0, HALF))
    bad = _bad(_examine(mocap, _lab()))
    assert set(bad) == {(name, "yaw zero") for name in NAMES}
    written = [float(x) for x in bad["left", "yaw zero"].partition("[")[2].rstrip("]").split(",")]
    assert _bad(_examine(mocap, _lab(vehicle={"q_marker_from_flu": written}))) == {}


def test_a_drone_lost_while_it_is_moved_is_neither_passed_nor_taken_for_another():
    """Unseen in one look, it stood at (0, 0, 0) there: its way from and to there was its longest."""
    level = np.tile(frames.IDENTITY, (3, 1))
    seen = np.array([True, False, True])
    hidden = Snapshot(np.where(seen[:, None], PLACES, 0.0), level, seen, {})
    snapshots = tuple(Snapshot(PLACES, level, np.ones(3, bool), {}) for _ in range(5))
    for vehicle in (1, 2):
        finding, _ = check_axes(_lab(), [Moves(vehicle, (snapshots[0], hidden, *snapshots[1:]))])
        assert finding.grade is Grade.FAIL
        assert finding.found == ("not measured" if vehicle == 1 else "no body moved")
