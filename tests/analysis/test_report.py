"""The page, the picture and the command line on whole, truncated, damaged and poor logs."""

import io
import json
import re
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops
from rich.console import Console
from typer.testing import CliRunner

from analysis.animation import FRAMES
from analysis.check import check
from analysis.cli import app
from analysis.compare import _flown_with
from analysis.console import print_summary
from analysis.load import Flight, from_records, load
from analysis.metrics import summarise
from analysis.picture import picture
from analysis.plots.style import Missing
from analysis.report import downloads, drawings, folded, html, rejections, report, setup
from analysis.tracking import track
from formation import topics
from formation.messages import Datagram, Event, LabFrame, OperatorRequest, Phase, PhaseChange, Rejection, Severity, Verb
from formation.topics import Topic
from tests.analysis.synthetic_flight import METADATA, T0_NS, Recipe, Record, records, written
from wire.link_messages import GROUND, Address, AttitudeSetpoint, Ignore, NamedValue
from wire.logs.mcap_write import LogWriter
from wire.mavlink.codec import Codec

SECTIONS = [
    "paths", "error", "timeline", "leader", "clouds", "positions", "sliding", "output", "attitude", "timing", "link",
    "setup", "metrics",
]  # fmt: skip
LACKING = (
    ((topics.MOCAP,), {"paths", "error", "leader", "clouds", "positions", "attitude"}),
    ((topics.REFERENCE,), {"error", "leader", "clouds", "positions"}),
    (
        (topics.COMMAND, topics.TARGET, topics.TIMING, topics.LINK_UP, topics.EVENT, topics.REQUEST),
        {"sliding", "output", "attitude", "timing", "link"},
    ),
    ((topics.PHASE,), set()),
)


def shake(t_s: float):
    return np.array([[0.002 * np.sin(9.0 * t_s), 0.001, 0.0], [0.0, 0.003 * np.cos(5.0 * t_s), 0.001]])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    down = [Record(topics.LINK_DOWN, T0_NS + 20_000_000_000, setpoint(k)) for k in range(10)]
    up = [Record(topics.LINK_UP, T0_NS + 20_000_000_000, age(10.0 + k)) for k in range(10)]
    written(path, Recipe(error_lead=shake), METADATA, [*down, *up])
    return path


def setpoint(k: int) -> Datagram:
    level, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    message = AttitudeSetpoint(Address(2, 1), k, level, still, 0.5, Ignore.NONE)
    return Datagram(2, Codec(GROUND).encode(message))


def age(ms: float) -> Datagram:
    return Datagram(2, Codec(Address(2, 1)).encode(NamedValue(0, "age_ms", ms)))


@pytest.fixture(scope="module")
def cut(log: Path) -> Path:
    """The first half of the log's bytes, as kill -9 leaves them."""
    path = log.with_name("cut.mcap")
    path.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    return path


@pytest.fixture(scope="module")
def reported(log: Path) -> Path:
    """The report of the whole log."""
    return report(log)


@pytest.fixture(scope="module")
def page(reported: Path) -> str:
    return reported.read_text(encoding="utf-8")


def rejected(record: Record) -> Record:
    """The record, or the frame with the poses that were not believed: of `left` twice, of `right` once."""
    frame, t_s = record.message, (record.t_ns - T0_NS) * 1e-9
    if not isinstance(frame, LabFrame):
        return record
    codes = np.zeros(len(frame.bodies), np.uint8)
    if 7.0 <= t_s < 7.5 or 9.0 <= t_s < 9.1:
        codes[frame.bodies.index("left")] = Rejection.JUMP
    if 8.0 <= t_s < 8.2:
        codes[frame.bodies.index("right")] = 250
    return replace(record, message=replace(frame, rejected=codes, seen=codes == 0))


def told(t_s: float, text: str, severity: Severity = Severity.WARNING) -> Record:
    return Record(topics.EVENT, T0_NS + round(t_s * 1e9), Event(severity, "left", text))


@pytest.fixture(scope="module")
def eventful() -> Flight:
    """A leader that wanders, poses that are not believed, one warning again and again; flown with known gains."""
    flown_with = {
        "date": "2026-09-21T14:13:20Z", "machine": "bench, Linux", "lab_file": "labs/bench.toml",
        "gains": json.dumps({"paper_40g": {"follower": {"c": 4.0625}}}), "profiles": "no JSON",
    }  # fmt: skip
    recipe = Recipe(error_lead=shake, leader_error=lambda t_s: np.array([0.2 * np.sin(t_s), 0.0, 0.0]))
    stale = [told(20.95 + 0.52 * k / 22.0, f"setpoints stale: {k} ms") for k in range(23)]
    other = [told(21.0, "setpoints stale: 0 ms", Severity.ERROR), told(60.0, "setpoints stale: 7 ms")]
    every = [*map(rejected, records(recipe)), told(0.0, "first", Severity.INFO), *stale, *other]
    return from_records({**METADATA, **flown_with}, sorted(every, key=lambda record: record.t_ns))


@pytest.fixture(scope="module")
def eventful_page(eventful: Flight) -> str:
    return html(eventful, summarise(eventful))


def test_a_log_read_back_gives_the_numbers_of_its_records(log: Path):
    direct = summarise(from_records(METADATA, records(Recipe(error_lead=shake))))
    read = summarise(load(log))
    # To 0.1 micrometres, the single precision of a log's places.
    assert read.formation_rms_m == pytest.approx(direct.formation_rms_m, abs=1e-7)
    assert read.vibration_m == pytest.approx(direct.vibration_m, abs=1e-7)
    assert read.age_ms is not None
    assert read.age_ms.p50 == pytest.approx(14.5)  # as the drone itself says


def test_the_command_hash_is_of_the_commands_alone():
    def summary(commands: list[Datagram], others: list[Datagram]):
        return summarise(from_records({}, [Record(topics.LINK_DOWN, k, d) for k, d in enumerate(commands + others)]))

    a, b = setpoint(1), setpoint(2)
    assert summary([a, b], []).command_hash == summary([a, b], [age(3.0)]).command_hash
    assert summary([a, b], []).command_hash != summary([b, a], []).command_hash
    assert summary([a], []).command_hash != summary([a, a], []).command_hash


def test_the_report_is_one_light_page_that_fetches_nothing(log: Path, reported: Path, page: str):
    assert reported == log.with_name("report.html")
    assert len(page.encode()) < 3_000_000
    assert re.findall(r'<section id="(\w+)"', page) == SECTIONS
    assert not re.search(r'src="(?!data:)|href="(?!data:)\w+:|<link|@import', page)
    assert "Not shown" not in page
    for words in ("Two followers", "landed", "vibration", "lab x, m", "right unseen for"):
        assert words in page


def test_a_leader_that_wanders_under_a_tight_formation_is_shown_said_and_pointed_to(
    eventful: Flight, eventful_page: str
):
    assert "leader tracking error, RMS" in eventful_page
    assert "itself tracked its reference to" in eventful_page
    assert re.search(r"lead is 1\d\d\smm RMS off its own reference", eventful_page)
    console = Console(width=200, record=True, file=io.StringIO())
    print_summary(summarise(eventful), console)
    assert re.search(r"leader tracking error +1\d\d mm RMS, 200 mm largest", console.export_text())


@pytest.mark.parametrize(("missing", "lacking"), LACKING)
def test_a_flight_without_some_topics_is_still_drawn(missing: tuple[Topic, ...], lacking: set[str]):
    kept = [r for r in records(Recipe(error_lead=shake)) if r.topic not in missing and r.t_ns < T0_NS + 9_000_000_000]
    up = [] if topics.LINK_UP in missing else [Record(topics.LINK_UP, T0_NS + 8_000_000_000, age(10.0))]
    flight = from_records(METADATA, [*kept, *up])
    drawn = drawings(flight, track(flight))
    assert set(drawn) == set(SECTIONS) - {"metrics", "setup"}
    assert {name for name, pictures in drawn.items() for p in pictures if isinstance(p, Missing)} == lacking


def test_poses_that_were_not_believed_are_listed_by_body_and_reason_with_their_times(
    eventful: Flight, eventful_page: str, page: str, log: Path
):
    jumped, unknown = rejections(eventful)
    assert (jumped.body, jumped.reason, jumped.stretches) == ("left", "jumped farther than it can move", 2)
    assert (jumped.frames, unknown.frames) == (30, 10)
    assert jumped.first_s == pytest.approx(7.0, abs=0.05)
    assert jumped.last_s == pytest.approx(9.1, abs=0.05)
    assert (unknown.body, unknown.reason) == ("right", "reason 250, of a later version")
    assert "jumped farther than it can move" in eventful_page
    assert rejections(load(log)) == ()
    assert "not believed" not in page


def test_a_log_of_nothing_makes_a_page_that_says_what_is_missing():
    flight = from_records({}, [])
    text = html(flight, summarise(flight))
    assert text.count("Not shown") >= 8


def test_what_is_told_again_and_again_is_one_line(eventful: Flight, eventful_page: str):
    lines = [(line.time, line.text) for line in folded(eventful.events, Severity.NOTICE)]
    assert lines[-3:] == [
        ("20.95-21.47 s", "23 x setpoints stale: 0 ms"),
        ("21.00 s", "setpoints stale: 0 ms"),
        ("60.00 s", "setpoints stale: 7 ms"),
    ]
    assert "23 x setpoints stale" in eventful_page
    assert "All 28 events" in eventful_page


def test_the_report_says_what_it_was_flown_with(eventful_page: str):
    for words in ("2026-09-21 14:13:20 UTC", "bench, Linux", "labs/bench.toml", "Gains and observers: paper_40g"):
        assert words in eventful_page
    assert "follower.c" in eventful_page
    assert "4.0625" in eventful_page


def test_gains_nested_without_end_are_left_out(log: Path):
    deep = '{"a": ' * 5000 + "1" + "}" * 5000
    for text in (deep, "[" * 100_000, '{"a": {"b": ' + "[" * 50 + "]" * 50 + "}}"):
        flight = load(log)
        flown = replace(flight, run=replace(flight.run, metadata={"gains": text, "profiles": text}))
        assert "Gains and observers" not in str(setup(flown))
        assert dict(_flown_with(flown))["gains"] == text


def test_every_picture_says_in_words_what_it_shows(page: str):
    spoken = re.findall(r'<svg role="img" aria-label="([^"]+)"', page)
    assert len(spoken) == page.count("<svg") > 10
    assert any("Formation error: length, mm" in words and "left" in words for words in spoken)


def test_check_counts_what_is_left_and_tells_damage_by_its_exit_code(log: Path, cut: Path):
    assert CliRunner().invoke(app, ["check", str(log)]).exit_code == 0
    assert json.loads(CliRunner().invoke(app, ["check", str(cut), "--json"]).output)["complete"] is False
    whole, half = check(log), check(cut)
    assert (whole.complete, whole.damage) == (True, "")
    assert whole.entries["mocap/frame"] == 1000
    assert not half.complete
    assert half.damage
    assert 0 < half.entries["mocap/frame"] < 1000
    assert 0.0 < half.duration_s < whole.duration_s


def test_a_truncated_log_is_reported_and_says_so(cut: Path, tmp_path: Path):
    page = tmp_path / "r.html"
    done = CliRunner().invoke(app, ["report", str(cut), "--out", str(page)])
    assert done.exit_code == 1, done.output
    assert "formation error" in done.output
    assert f"open it in a browser: file://{page}" in done.stderr
    assert "The log is damaged" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["report", "check", "picture", "audit", "identify", "compare", "export --csv"])
def test_what_is_no_log_of_a_flight_is_refused_in_one_line(command: str, tmp_path: Path):
    (tmp_path / "no.mcap").write_text("this is no log")
    LogWriter(tmp_path / "empty.mcap", METADATA, threaded=False).close()
    for name in ("absent.mcap", "no.mcap", "empty.mcap"):
        logs = [str(tmp_path / name)] * (2 if command == "compare" else 1)
        refused = CliRunner().invoke(app, [*command.split(), *logs])
        assert refused.exit_code == 2
        assert refused.stderr.startswith("gcs-log: ")
        assert len(refused.stderr.splitlines()) == 1


WORDS = ("[/]", "$x$ $\\frac{$", "<script>alert(1)</script>", "a & b")


def test_words_of_drones_and_people_are_shown_not_read(tmp_path: Path):
    """Neither as rich's markup, nor as HTML, nor as mathematics in a picture."""
    path = tmp_path / "flight.mcap"
    names = {"scenario": f"{WORDS[0]} {WORDS[1]}", "link": f"{WORDS[2]} {WORDS[3]}"}
    said = []
    for k, words in enumerate(WORDS):
        said_ns = T0_NS + (5 + k) * 1_000_000_000
        said.append(Record(topics.EVENT, said_ns, Event(Severity.ERROR, "left", words)))
        said.append(Record(topics.REQUEST, said_ns, OperatorRequest(1, Verb.SHAPE, words)))
        said.append(Record(topics.PHASE, said_ns + 25_000_000_000, PhaseChange(Phase.LAND, words)))
    written(path, Recipe(), {**METADATA, **names}, said)
    run = CliRunner().invoke(app, ["report", str(path)])
    assert run.exit_code == 1  # the flight was cut short
    page = (tmp_path / "report.html").read_text()
    for words in WORDS:
        assert words in run.output
        assert page.count(escape(words)) >= 3
    assert "<script>" not in page
    picture(path, tmp_path / "flight.png")


def test_the_report_links_to_its_data_and_tells_mean_altitudes(log: Path, page: str, tmp_path: Path):
    assert f'<a href="{log.name}">' in page
    assert f'<a href="{log.stem}-csv">CSV</a> after <code>gcs-log export {log.name} --csv</code>' in page
    assert f'<a href="{log.stem}-parquet">Parquet</a>' in page
    assert "mean altitude, m" in page
    elsewhere = downloads(str(log), str(tmp_path / "elsewhere" / "report.html"))
    assert elsewhere is not None
    assert elsewhere.log.endswith(f"{log.parent.name}/{log.name}")


def test_the_picture_is_written_beside_the_log(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["picture", str(log)])
    assert done.exit_code == 0, done.output
    assert log.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.iterdir())


def test_the_animation_shows_the_flight_from_take_off_to_landing_in_3_mb(log: Path):
    done = CliRunner().invoke(app, ["picture", str(log), "--gif"])
    assert done.exit_code == 0, done.output
    gif = log.with_suffix(".gif")
    assert gif.stat().st_size < 3e6
    with Image.open(gif) as shown:
        assert (shown.n_frames, shown.info["loop"]) == (FRAMES, 0)
        first, last = shown.convert("RGB"), (shown.seek(FRAMES - 1), shown.convert("RGB"))[1]
    changed = np.asarray(ImageChops.difference(first, last)).any(axis=-1)
    upper, lower = np.split(changed, [int(0.73 * len(changed))])
    assert upper.any()  # the drones
    assert lower.any()  # their error


def test_a_log_without_a_pose_has_no_animation(tmp_path: Path):
    path = tmp_path / "flight.mcap"
    with LogWriter(path, METADATA, threaded=False) as writer:
        for record in records(Recipe()):
            if record.topic != topics.MOCAP:
                writer.write(record.topic, record.message, record.t_ns)
    refused = CliRunner().invoke(app, ["picture", str(path), "--gif"])
    assert (refused.exit_code, refused.stderr) == (2, f"gcs-log: {path}: holds no pose to draw\n")
