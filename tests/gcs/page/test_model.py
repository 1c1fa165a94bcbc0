"""The page's view model, on states of a GcsCore that flies fake drones: no browser, no bus."""

import re
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest

from formation.messages import Event, Phase, Severity, Verb
from gcs.alarms import ACKNOWLEDGED, EventMemory, ShownAlarms, folded
from gcs.page import drawing
from gcs.page.drawing import Stand, above, perspective
from gcs.page.model import Control, Model
from gcs.page.scene import Trails, scene
from gcs.page.show import COLUMNS, UNITS, Cell, Level, Step, countdowns, row, show, stop_text, vital
from gcs.rehearsal import record, recorded
from tests.gcs.fakes import FakeLab, triangle
from wire.ground_state import Alarm, GroundState, PublishedEvent, encode


def step(state: GroundState, verb: Verb) -> Step:
    return next(one for one in show(state, None, 0.0).steps if one.verb is verb)


@pytest.fixture(scope="module")
def flight() -> dict[Phase, GroundState]:
    """The states of a flight, one for each phase, and the last of a stop."""
    lab, told = FakeLab(triangle()), {}

    def note(seconds: float) -> None:
        lab.run(seconds)
        told[lab.phase] = lab.state

    note(2.0)
    lab.command(Verb.ARM, Phase.ARMED)
    note(4.0)
    lab.command(Verb.TAKEOFF, Phase.TAKEOFF)
    note(1.0)
    lab.run_until(Phase.HOLD)
    note(0.5)
    lab.command(Verb.START, Phase.FORMATION)
    while not lab.state.trajectory_started:
        lab.step()
    note(0.5)
    lab.command(Verb.LAND, Phase.LAND)
    note(0.5)
    lab.command(Verb.STOP, Phase.STOPPED)
    note(1.5)
    return told


def test_a_step_is_allowed_in_its_phase_and_says_why_not_elsewhere(flight):
    allowed = {
        phase: {one.verb for one in show(state, None, 0.0).steps if one.allowed} for phase, state in flight.items()
    }
    assert allowed == {
        Phase.GROUND: {"arm"},
        Phase.ARMED: {"takeoff", "land"},
        Phase.TAKEOFF: {"hold", "land"},
        Phase.HOLD: {"start", "home", "hold", "land"},
        Phase.FORMATION: {"home", "hold", "land"},
        Phase.LAND: {"land"},
        Phase.STOPPED: {"land", "reset"},
    }
    assert step(flight[Phase.GROUND], Verb.START).out_of_turn
    assert not step(flight[Phase.GROUND], Verb.TAKE_CONTROL).out_of_turn
    assert step(flight[Phase.GROUND], Verb.TAKE_CONTROL).reasons == (
        "no drone is armed, there is nothing to take control of: `gcs arm`",
    )


def test_the_countdowns(flight):
    first, left_s = countdowns(flight[Phase.ARMED])[0].split(" disarms itself in ")
    assert first in ("lead", "left", "right")
    assert 0.0 < float(left_s.removesuffix(" s")) < 10.0
    t_s, whole_s = flight[Phase.FORMATION].trajectory_s
    assert countdowns(flight[Phase.FORMATION]) == (f"leader's trajectory: {whole_s - t_s:.0f} s of 3 s left",)
    assert countdowns(flight[Phase.LAND])[-1].startswith("landing: ")
    assert countdowns(flight[Phase.GROUND]) == ()


def test_a_stop_says_who_reports_its_motors_off_and_how_soon(flight):
    told = flight[Phase.STOPPED].drones
    assert all(0.0 <= drone.stopped_ms <= 30.0 for drone in told)  # fake drones answer at once, when asked
    assert stop_text(flight[Phase.STOPPED]).startswith("3 of 3 drones report their motors off: lead ")
    assert stop_text(flight[Phase.HOLD]) == ""
    lab = FakeLab(triangle())
    lab.fly()
    lab.drones[2].receives_nothing = True
    lab.ask(Verb.STOP)
    lab.run(0.5)
    assert stop_text(lab.state).endswith("; NOT YET: left")


def test_a_table_row_has_a_cell_for_each_column_with_its_unit_and_marks_what_is_wrong(flight):
    shown = show(flight[Phase.HOLD], None, 0.0)
    for name, unit, cell in zip(COLUMNS, UNITS, shown.rows[0], strict=True):
        assert unit or name == "id" or not cell.text.replace(".", "").isdigit(), name
    assert '<th title="time since its heartbeat, s">heard<small>s</small></th>' in drawing.table(shown)
    drone = flight[Phase.FORMATION].drones[1]
    cells = dict(zip(COLUMNS, row(drone, flying=True, battery_levels=LEVELS), strict=True))
    assert (cells["id"].text, cells["name"].text, cells["make"].text) == ("2", "left", "PX4")
    assert (cells["armed"].text, cells["validator"].text) == ("ARMED", "ok")
    assert float(cells["error"].text) < 50.0
    ill = replace(
        drone,
        battery=0.15,
        age_s=0.31,
        heartbeat_age_s=None,
        rejected="frozen",
        fence_margin_m=0.05,
        link_behind_s=0.12,
    )
    cells = dict(zip(COLUMNS, row(ill, flying=True, battery_levels=LEVELS), strict=True))
    assert cells["charge"] == Cell("15", Level.WARN)
    assert cells["pose"] == Cell("310", Level.BAD)
    assert cells["heard"] == Cell("never", Level.BAD)
    assert cells["validator"] == Cell("frozen", Level.BAD)
    assert cells["late"] == Cell("120", Level.BAD)
    assert cells["fence"] == Cell("0.05", Level.WARN)
    assert row(drone, flying=False, battery_levels=LEVELS)[COLUMNS.index("error")] == Cell("-")


def test_what_is_wrong_is_on_the_page_and_at_rest_nothing_is(flight):
    calm = show(flight[Phase.GROUND], None, 0.0)
    assert "p-aloft" not in drawing.head(calm)
    assert "not possible" not in drawing.steps(calm, True)
    assert "Take control: no drone is armed" in drawing.steps(calm, True)
    state = flight[Phase.GROUND]
    first, *others = state.drones
    against = {Verb.ARM: ("the stop button does not work: /dev/input/js0: gone",)}
    drones = (replace(first, armed=True), *others)
    ill = show(replace(state, not_landed=("left",), drones=drones, allowed={**state.allowed, **against}), None, 0.0)
    assert "NOT KNOWN TO HAVE LANDED: left" in drawing.head(ill)
    assert 'class="phase p-aloft"' in drawing.head(ill)
    assert "Take control is not possible" in drawing.steps(ill, True)
    assert "/dev/input/js0: gone" in drawing.steps(ill, True)


def test_silence_of_the_ground_is_shown_and_is_an_alarm_once(flight):
    model = Model(triangle())
    assert model.show(0, 0.0).lost == "waiting to hear the ground: `gcs run` starts one"
    model.receive_state(encode(flight[Phase.HOLD]), 10_000_000_000)
    assert model.show(10_900_000_000, 5.0).lost == ""
    assert model.show(13_000_000_000, 7.0).lost == "nothing heard of the ground for 3 s"
    model.show(14_000_000_000, 8.0)
    assert [(alarm.severity, alarm.times) for alarm in model.alarms.open] == [(Severity.CRITICAL, 1)]
    assert "NO CONNECTION" in drawing.lost(model.show(14_000_000_000, 8.0))
    model.receive_state(encode(flight[Phase.HOLD]), 15_000_000_000)
    assert drawing.lost(model.show(15_000_000_000, 9.0)) == ""
    assert [(alarm.goes_on, alarm.cleared) for alarm in model.alarms.open] == [(False, True)]
    assert model.alarms.latest[0].text == "over: the ground is not heard any more"


def test_the_mocap_is_not_called_silent_while_poses_come(flight):
    """Its state comes once a second: a view that has just opened has poses before that."""
    state = flight[Phase.HOLD]
    (name, cell), *_ = vital(state, None)
    assert (name, cell.level, cell.text.endswith(" ms old")) == ("mocap", Level.CALM, True)
    unseen = replace(state, drones=tuple(replace(drone, age_s=0.5) for drone in state.drones))
    assert vital(unseen, None)[0] == ("mocap", Cell("not heard", Level.WARN))


def test_the_last_rehearsal_is_shown_until_the_lab_changes(flight, tmp_path):
    lab, file = triangle(), tmp_path / "lab.toml"
    higher = lab.model_copy(update={"flight": lab.flight.model_copy(update={"altitude_m": 0.7})})

    def shown(config):
        model = Model(config)
        model.receive_state(encode(flight[Phase.GROUND]), 0)
        model.rehearsal = recorded(file)
        cell = dict(model.show(0, 0.0).vital)["rehearsal"]
        return cell.text, cell.level

    assert shown(lab) == ("none: gcs rehearse", Level.CALM)
    record(file, lab, "2026-11-27T20:04:00", passed=True, folder=tmp_path / "runs")
    assert shown(lab) == ("2026-11-27T20:04:00, passed", Level.CALM)
    assert shown(higher) == ("2026-11-27T20:04:00, of another lab file: gcs rehearse", Level.WARN)
    record(file, lab, "2026-11-27T20:05:00", passed=False, folder=tmp_path / "runs")
    assert shown(lab) == (f"2026-11-27T20:05:00, not passed: {tmp_path / 'runs'}", Level.BAD)
    (tmp_path / "lab-rehearsal.toml").write_text("no record")
    assert shown(lab) == ("none: gcs rehearse", Level.CALM)


LEVELS = (0.2, 0.1)
BATTERY = Event(Severity.WARNING, "safety", "left: battery low", lasts=True, code="rule-battery-low", subject="left")
OUTSIDE = Event(Severity.CRITICAL, "safety", "right: outside", lasts=True, code="rule-outside-fence", subject="right")


def published(told: EventMemory, session: int = 7) -> GroundState:
    """What the alarms of a page are made of."""
    state = FakeLab(triangle()).state
    return replace(state, ground_session=session, events=told.newest, alarms=told.alarms.open)


@pytest.mark.parametrize("first", ["acknowledged", "over"])
def test_the_newest_alarm_is_first_and_stays_until_it_is_acknowledged_and_over(first: str):
    shown, told = ShownAlarms(), EventMemory()
    told.note(BATTERY, 1_000_000)
    told.note(OUTSIDE, 2_000_000)
    told.note(Event(Severity.WARNING, "left", "low voltage"), 3_000_000)  # which has no end
    told.note(replace(BATTERY, text="left: battery low, said otherwise"), 4_000_000)
    shown.receive_ground(published(told))
    shown.receive_ground(published(told))  # the same again is no news
    assert [(one.text, one.times, one.unix_s) for one in shown.open] == [
        ("left: battery low, said otherwise", 2, 4.0),
        ("low voltage", 1, 3.0),
        (OUTSIDE.text, 1, 2.0),
    ]
    assert shown.loud
    told.note(ACKNOWLEDGED if first == "acknowledged" else OUTSIDE.over(), 5_000_000)
    shown.receive_ground(published(told))
    alarm = next(one for one in shown.open if one.text == OUTSIDE.text)
    assert (alarm.acknowledged, alarm.goes_on) == ((True, True) if first == "acknowledged" else (False, False))
    assert folded(shown.open)[1] == ("" if first == "acknowledged" else "1 cleared")
    assert ("<summary>1 cleared</summary>" in drawing.alarms(shown.open, ())) is (first == "over")
    assert shown.loud is (first == "over")
    assert ("goes on, acknowledged" in drawing.alarms(shown.open, ())) is (first == "acknowledged")
    told.note(OUTSIDE.over() if first == "acknowledged" else ACKNOWLEDGED, 6_000_000)
    shown.receive_ground(published(told))
    assert [one.code for one in shown.open] == [BATTERY.code]
    told.note(OUTSIDE, 7_000_000)  # comes again: news
    assert next((one.text, one.acknowledged) for one in told.alarms.open) == (OUTSIDE.text, False)


def test_few_lines_show_the_severest_alarms_and_count_the_others():
    alarms = [Alarm(float(k), Severity.WARNING, "left", f"warning {k}") for k in range(9)]
    severe = Alarm(0.5, Severity.EMERGENCY, "right", "falls")
    standing, others = folded([*alarms, severe, Alarm(20.0, Severity.ERROR, "x", "was", cleared=True)], 3)
    assert [alarm.text for alarm in standing] == ["warning 8", "warning 7", "falls"]
    assert (standing[-1].level, others) == (Severity.CRITICAL, "7 more, 1 cleared")


def test_reports_that_differ_by_their_numbers_are_one_alarm():
    told = EventMemory()
    for count in (27, 100):
        told.note(Event(Severity.WARNING, "left", f"refused: {count} x setpoint older than 100 ms"), count)
    assert [(alarm.text[:12], alarm.times) for alarm in told.alarms.open] == [("refused: 100", 2)]


def test_alarms_of_a_ground_that_is_gone_stay_until_they_are_acknowledged():
    shown, told = ShownAlarms(), EventMemory()
    told.note(OUTSIDE, 2_000_000)
    shown.receive_ground(published(told))
    shown.receive_ground(published(EventMemory(), session=8))  # a ground that was started anew
    assert [(one.text, one.goes_on) for one in shown.open] == [("right: outside", False)]
    shown.acknowledge()
    assert shown.open == ()


def test_a_false_state_hides_no_real_alarm():
    shown, told, false = ShownAlarms(), EventMemory(), EventMemory()
    told.note(OUTSIDE, 2_000_000)
    real = published(told)
    other = replace(published(false), events=(PublishedEvent(2**62, 1.0, Severity.NOTICE, "x", "false"),))
    for state in (other, real, other, real):
        shown.receive_ground(state)
    assert [(one.text, one.times) for one in shown.open] == [("right: outside", 1)]
    for k in range(5000):
        false.note(Event(Severity.WARNING, f"{k}", "x"), 1)
    false.note(OUTSIDE, 20_000)
    assert len(false.alarms.open) <= 100
    assert false.alarms.open[0].text == "right: outside"


def test_one_viewer_has_the_control_until_another_takes_it():
    control = Control()
    control.come("viewer 1")
    control.come("viewer 2")
    assert control.status_text("viewer 2") == "Read-only: viewer 1 has the control"
    control.take_control("viewer 2")
    assert control.status_text("viewer 1").startswith("viewer 2 has taken the control over from viewer 1")
    control.leave("viewer 2")
    assert control.holder is None
    assert control.status_text("viewer 1").startswith("Nobody has the control")


def test_a_drone_is_drawn_with_its_true_size_and_heading(flight):
    fence = triangle().limits.fence
    top = above(fence, 6400.0, 4800.0)
    shown = scene(flight[Phase.FORMATION], triangle(), Trails())
    for slot, follower in zip(shown.slots_lab_m, shown.bodies[1:], strict=True):
        assert np.allclose(slot, follower.pos_lab_m, atol=0.05)
    lead = shown.bodies[0]
    drawn = drawing.moving(top, shown)
    assert drawn.count('class="drone"') == 3
    d = 0.5 * lead.size_m / np.sqrt(2.0)
    w, x, y, z = lead.q_lab_from_flu
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    px, py, _ = lead.pos_lab_m
    motor = top.project(px + d * (np.cos(yaw) - np.sin(yaw)), py + d * (np.sin(yaw) + np.cos(yaw)), 0.0)
    circles = [part.split('"') for part in drawn.split("<circle ") if part.startswith("cx")]
    places = np.array([[float(words[1]), float(words[3])] for words in circles])
    assert np.linalg.norm(places - np.array(motor[:2]), axis=1).min() < 2.0
    from_x = perspective(fence, Stand(azimuth_rad=0.0, elevation_rad=0.3), 640.0, 480.0)
    assert from_x.project(0.0, 1.0, 1.0)[0] > from_x.project(0.0, -1.0, 1.0)[0]  # who looks along -x has y at the right
    assert from_x.project(2.0, 0.0, 1.0)[2] > from_x.project(-2.0, 0.0, 1.0)[2]  # what is nearer is larger


def test_no_text_in_the_room_covers_another(flight):
    """Names of drones that fly close to each other, the distances between them, and the axes' letters."""
    config = triangle()
    shown = scene(flight[Phase.FORMATION], config, Trails())
    close = tuple(replace(body, pos_lab_m=(0.5 + 0.01 * k, 0.0, 0.0)) for k, body in enumerate(shown.bodies))
    shown = replace(shown, bodies=close, pairs=((0, 1, 0.01), (1, 2, 0.01), (0, 2, 0.02)))
    for camera in (above(config.limits.fence, 600.0, 400.0), perspective(config.limits.fence, Stand(), 600.0, 400.0)):
        drawn = drawing.still(camera, config.limits.fence) + drawing.moving(camera, shown)
        found = re.findall(r'<text[^>]* x="([-\d.]+)" y="([-\d.]+)">([^<]+)<', drawn)
        assert len(found) == 2 + 3 + 3
        texts = [(float(x), float(y), 4.0 * len(text)) for x, y, text in found]
        for (x, y, half), (other_x, other_y, other_half) in combinations(texts, 2):
            assert abs(x - other_x) >= half + other_half - 0.1 or abs(y - other_y) >= 14.9


@pytest.mark.parametrize("size", [(640.0, 540.0), (1200.0, 300.0), (260.0, 700.0)])
def test_the_room_fills_its_panel(size):
    """Of one direction nearly all, of the other as much as its shape allows; nothing lies outside."""
    fence = triangle().limits.fence
    camera = perspective(fence, Stand(azimuth_rad=0.8), *size)
    corners = product(*zip(fence.low_m[:2], fence.high_m[:2], strict=True), (0.0, fence.high_m[2]))
    at = np.array([camera.project(*corner)[:2] for corner in corners])
    assert np.all((at > 0.0) & (at < size))
    assert np.max(np.ptp(at, axis=0) / size) > 0.9


def test_lateness_is_red_where_frames_are_missed_not_where_no_cycle_is_late(flight):
    state = flight[Phase.FORMATION]
    state = replace(state, counters=replace(state.counters, late_share=0.5))
    vital = dict(show(state, None, 0.0).vital)
    assert vital["late cycles"].text.startswith("0 of")
    assert (vital["late cycles"].level, vital["frames missed"].level) == (Level.CALM, Level.BAD)


def test_a_trajectory_can_be_chosen_until_it_has_begun():
    ways = {"eight": {"kind": "figure8", "length_m": 0.8, "period_s": 8.0}}
    lab = FakeLab(triangle(leader={"body": "lead", "sysid": 1, "trajectories": ways}))
    lab.run(2.0)
    model = Model(lab.config)
    model.receive_state(encode(lab.state), lab.now_ns)
    assert model.may_choose
    assert lab.reply(lab.ask(Verb.TRAJECTORY, "eight")).accepted
    lab.fly()
    while not lab.state.trajectory_started:
        lab.step()
    model.receive_state(encode(lab.state), lab.now_ns)
    assert not model.may_choose
    assert countdowns(lab.state)[0].startswith("leader's trajectory eight: ")


@pytest.mark.parametrize("text", ["[" * 5000, '{"drones": 3}', '{"phase": []}', "[]", '{"phase": "GROUND"}', "NaN"])
def test_a_state_that_is_none_is_rejected_and_the_last_one_stays(flight, text):
    model = Model(triangle())
    model.receive_state(encode(flight[Phase.HOLD]), 10_000_000_000)
    with pytest.raises(ValueError, match=r"JSON|version 1"):
        model.receive_state(text, 11_000_000_000)
    assert model.show(11_000_000_000, 0.0).phase is Phase.HOLD
