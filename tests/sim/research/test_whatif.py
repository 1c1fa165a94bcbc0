"""A flight asked what another law would have done: against the same flight, and against the flight of that law."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.load import Flight
from analysis.metrics import summarise
from formation.maths.arrays import Float
from sim import lockstep
from sim.cli.log import app
from sim.research import host
from sim.research.laws import chosen
from sim.research.recorded import GUST_S, Recorded, RecordedError, reconstruct
from sim.research.reflight import Change, refly
from sim.research.whatif import disturbance, what_if
from sim.scenario import Scenario, flown_by, load
from sim.world import T0_NS

SPRING = '''
class Spring:
    """A spring and a damper."""

    def __init__(self, k_1_s2=9.0, d_1_s=6.0):
        self.k, self.d = k_1_s2, d_1_s

    def __call__(self, at):
        off, fast = at.own.pos_lab_m - at.slot.pos_lab_m, at.own.vel_lab_m_s - at.slot.vel_lab_m_s
        return at.slot.acc_lab_m_s2 - self.k * off - self.d * fast - at.disturbance_lab_m_s2
'''


def gust(law: str = "default") -> Scenario:
    scenario = load("hover_gust")
    lab = flown_by(scenario.lab, scenario.lab.profile_of(scenario.lab.followers[0]), law)
    return scenario.model_copy(update={"lab": lab, "formation_s": 16.0})


@pytest.fixture(scope="module")
def flight() -> Flight:
    return host.fly(gust(), 1)[1]


@pytest.fixture(scope="module")
def recorded(flight: Flight) -> Recorded:
    return reconstruct(replace(flight, truth={}))


def rms_m(flight: Flight) -> float:
    found = summarise(flight).formation_rms_m
    assert found is not None
    return found


def test_the_gust_is_found_in_the_log_of_a_flight_in_it(flight: Flight, recorded: Recorded) -> None:
    """The fan's push along x, which only the simulator knows, within the band in which it is known."""
    found = disturbance(recorded, 0)[:, 0]
    begin_s = (recorded.begin_ns - 1_000_000_000) * 1e-9
    t_s = begin_s + GUST_S * (np.arange(len(found)) + 0.5)
    truth = flight.truth[2]
    true = np.interp(t_s, truth.t_s, truth["dist_lab_m_s2"][:, 0])
    assert recorded.identified == (True,)
    assert recorded.known_hz[0, 0] > 4.0
    assert low_passed(found - true, 2.0).std() < 0.15 * low_passed(true, 2.0).std()


def low_passed(values: Float, hz: float) -> Float:
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(len(values), GUST_S) > hz] = 0.0
    return np.fft.irfft(spectrum, len(values))


def test_a_flight_under_its_own_law_comes_back(flight: Flight, recorded: Recorded) -> None:
    _, again = refly(recorded, Change())
    assert rms_m(again) == pytest.approx(rms_m(flight), rel=0.03)


def test_another_law_is_foretold(flight: Flight) -> None:
    """PID, 1.25 times the RMS of the shipped law, flown with other cameras' noise."""
    foretold = what_if(flight, Change(chosen("pid")), "a")
    flown = host.fly(gust("pid"), 2)[1]
    assert rms_m(flown) > 1.15 * rms_m(flight)
    assert foretold.comes_back
    assert foretold.other.summary.formation_rms_m == pytest.approx(rms_m(flown), rel=0.1)
    told = json.loads(foretold.to_json())
    assert told["configuration"]["lab.control_preset"] == ["default", "pid"]


def test_a_law_that_leaves_what_was_excited_is_named(flight: Flight) -> None:
    far = what_if(flight, Change(chosen("paper_istsmc")), "a")
    assert any("off the recorded path" in text for text in far.trust[0].leaves)


def test_later_frames_and_fewer_of_them_cost_what_they_cost(flight: Flight, recorded: Recorded) -> None:
    _, late = refly(recorded, Change(delay_s=0.02))
    _, thin = refly(recorded, Change(rate_hz=50.0))
    assert rms_m(late) > 1.1 * rms_m(flight)
    assert np.median(np.diff(thin.poses.t_s)) == pytest.approx(0.02, abs=0.001)
    assert np.median(late.poses.received_s - late.poses.t_s) == pytest.approx(
        0.02 + float(np.median(flight.poses.received_s - flight.poses.t_s)), abs=1e-6
    )


def test_the_last_follower_cannot_be_left_out(recorded: Recorded) -> None:
    with pytest.raises(RecordedError, match="--without hover: one of several followers is wanted; there are hover"):
        refly(recorded, Change(without="hover"))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two followers on a line, with links and all."""
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    lockstep.run_to_file(load("triangle_line").model_copy(update={"formation_s": 8.0}), 3, path)
    return path


def test_a_log_is_asked_from_the_command_line(log: Path, tmp_path: Path) -> None:
    law, gains = tmp_path / "spring.py", tmp_path / "gains.toml"
    law.write_text(SPRING)
    gains.write_text("[law]\nk_1_s2 = 12.0\n")
    page = tmp_path / "page.html"
    words = ["whatif", str(log), "--law", str(law), "--gains", str(gains), "--without", "left", "--delay", "+5ms"]
    done = CliRunner().invoke(app, [*words, "--out", str(page)])
    assert done.exit_code == 0, done.output
    assert "comes back under its own law" in done.output
    assert "spring" in done.output
    assert "right: disturbance known up to" in done.output
    assert "left: disturbance" not in done.output
    assert "by a rule of safety" not in done.output
    text = page.read_text()
    assert [f'id="{name}"' in text for name in ("numbers", "error", "paths", "trust", "disturbance")] == [True] * 5
    assert "Not shown" not in text


@pytest.mark.parametrize("answer", ["1 / 0", "[float('nan')] * 3"])
def test_a_law_that_fails_has_no_figures(answer: str, log: Path, tmp_path: Path) -> None:
    law = tmp_path / "law.py"
    law.write_text(f"class Law:\n    def __call__(self, at):\n        return {answer}\n")
    done = CliRunner().invoke(app, ["whatif", str(log), "--law", str(law), "--out", str(tmp_path / "page.html")])
    assert done.exit_code == 1
    assert "comes back under its own law" in done.stdout
    assert all(line.endswith("law failed") for line in done.stdout.splitlines()[1:7])
    assert "<h1>flight.mcap, flown again: law.py" in (tmp_path / "page.html").read_text()
    assert (tmp_path / "page.html").read_text().count("law failed") >= 6


def test_a_frame_that_a_newer_one_overtook_is_not_flown(flight: Flight) -> None:
    poses = flight.poses
    received_s = poses.received_s.copy()
    received_s[700] = received_s[702] + 1e-3
    late = reconstruct(replace(flight, truth={}, poses=replace(poses, received_s=received_s)))
    assert round(poses.t_s[700] * 1e9) + T0_NS not in late.capture_ns
    assert (np.diff(late.receive_ns) >= 0).all()
    assert set(late.receive_ns) <= set(np.rint(received_s * 1e9).astype(np.int64) + T0_NS)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--law", "nothing"), "no package here registers 'nothing'"),
        (("--law", "none.py"), "none.py: no such file"),
        (("--without", "middle"), "there are right, left"),
        (("--delay", "soon"), "a time such as +20ms"),
    ],
)
def test_what_cannot_be_asked_is_named(log: Path, words: tuple[str, ...], error: str) -> None:
    done = CliRunner().invoke(app, ["whatif", str(log), *words, "--json"])
    assert done.exit_code == 2
    assert error in done.output


def test_a_law_that_is_none_is_named_before_the_log_is_read(tmp_path: Path) -> None:
    """It was named after ten seconds of finding what acted on the drones."""
    law, log = tmp_path / "law.py", tmp_path / "flight.mcap"
    law.write_text("x = 1\n")
    log.touch()
    done = CliRunner().invoke(app, ["whatif", str(log), "--law", str(law)])
    assert done.exit_code == 2
    assert "which law? law.py:NAME, of none" in done.output
