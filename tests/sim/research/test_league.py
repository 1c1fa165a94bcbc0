"""A league: flown, written, and checked to the bit; what is another law's win is not hidden."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.metrics import summarise
from analysis.tracking import Tracking
from formation.vehicle.profile import PROFILES
from sim.cli.app import app
from sim.research import host, league, league_page, neural_fly, tune
from sim.research.experiments import Experiment
from sim.research.laws import chosen, followed_by
from sim.research.league import LeagueError, Result, Row, commands_hash, true
from wire.files import read_toml
from wire.lab_surroundings import law_in_file

LAWS = Path(__file__).parents[3] / "examples" / "laws"


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A law's file and the default preset on the line."""
    folder = tmp_path_factory.mktemp("league")
    (folder / "law.py").write_text((LAWS / "geometric.py").read_text())
    words = ["league", str(folder / "law.py"), "default", "--scene", "line", "--vehicle", "paper_40g"]
    done = CliRunner().invoke(app, [*words, "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return folder


def test_the_table_has_every_law_and_the_best_is_marked(played: Path) -> None:
    told = json.loads((played / "league.json").read_text())
    assert [(row["law"], row["outcome"]) for row in told["rows"]] == [("law.py", "held"), ("default", "held")]
    assert told["laws"]["law.py"]["sha256"]
    assert {"python", "numpy", "numba", "mavlink-formation"} <= told["versions"].keys()
    page = (played / "league.html").read_text()
    assert page.count("★") >= 1


def test_a_law_that_fails_has_no_figures_in_a_league_and_none_when_it_is_tuned(tmp_path: Path) -> None:
    law = tmp_path / "law.py"
    law.write_text(
        "class Law:\n    def __init__(self, k=1.0): ...\n    def __call__(self, at):\n        return 1 / 0\n"
    )
    words = ["league", str(law), "default", "--scene", "line", "--vehicle", "paper_40g", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    failed, built_in = json.loads((tmp_path / "league.json").read_text())["rows"]
    assert (failed["outcome"], built_in["outcome"]) == ("law failed", "held")
    assert [failed[key] for key in ("rms_m", "max_m", "settle_s", "chatter_deg")] == [None] * 4
    task = tune.Task(PROFILES["paper_40g"], 100.0, 0.008, host.Host.STUDY)
    assert tune.fly(tune.Flight(task, None, Experiment.CIRCLE, False, chosen(str(law)))) == np.inf


def test_a_result_file_is_reproduced_to_the_bit(played: Path) -> None:
    done = CliRunner().invoke(app, ["league", "--check", str(played / "league.json")])
    assert done.exit_code == 0, done.output
    assert "2 of 2 flights are the same to the bit" in done.output


def test_a_hash_that_differs_is_named(played: Path, tmp_path: Path) -> None:
    told = json.loads((played / "league.json").read_text())
    told["rows"] = told["rows"][1:]
    told["rows"][0]["commands"] = "0" * 64
    (tmp_path / "league.json").write_text(json.dumps(told))
    done = CliRunner().invoke(app, ["league", "--check", str(tmp_path / "league.json")])
    assert done.exit_code == 1
    assert "default, line, paper_40g: commands" in done.output


def test_another_law_under_the_same_name_is_refused(played: Path) -> None:
    text = (played / "league.json").read_text()
    law = played / "law.py"
    before = law.read_text()
    law.write_text(before + "\n")
    with pytest.raises(LeagueError, match=r"law\.py is another file: its SHA-256 is"):
        league.known_rows(text, "league.json")
    law.write_text(before)
    with pytest.raises(LeagueError, match="no result file of a league"):
        league.known_rows("{}", "other.json")


@pytest.mark.parametrize("path", sorted(set(LAWS.glob("*.py")) - {LAWS / "policy.py"}), ids=lambda path: path.stem)
def test_every_shipped_law_holds_the_line(path: Path) -> None:
    result = league.fly(Row(chosen(str(path)), "line", "paper_40g"))
    assert result.outcome == "held"
    assert result.rms_m is not None
    assert result.rms_m < 0.15


def test_errors_are_the_true_ones_whatever_the_cameras_show() -> None:
    scenario = league.SCENES["2 mm of noise"](league.profile("paper_40g"))
    _, flight = host.fly(scenario, 1, followed_by(chosen("default"), scenario.lab))
    seen_m, true_m = (summarise(each).formation_rms_m or np.nan for each in (flight, true(flight)))
    assert true_m < 0.6 * seen_m
    assert len(commands_hash(flight)) == 64


def test_who_did_not_fly_to_the_end_is_not_the_best() -> None:
    well = Result("held", 0.01, 0.02, 0.1, 0.5, 0.1, 0.01, "", 1.0)
    lost = Result("aborted", 0.001, 0.002, 0.0, None, 0.1, 0.01, "", 1.0)
    rows = [(Row(chosen(name), "line", "paper_40g"), result) for name, result in (("default", lost), ("pid", well))]
    text = league_page.html(rows)
    assert "aborted" in text
    assert text.index("10.00 ★") > 0


def test_the_shipped_laws_fly_with_the_gains_beside_them(tmp_path: Path) -> None:
    tuned = league.gains_beside([chosen(str(LAWS / "indi.py")), chosen("pid"), chosen(str(tmp_path / "mine.py"))])
    assert list(tuned) == ["indi.py"]
    assert tuned["indi.py"].keys() == {"paper_40g", "px4_quad"}
    for name, by_vehicle in read_toml(LAWS / league.GAINS).items():
        for options in by_vehicle.values():
            assert options.keys() == chosen(str(LAWS / name)).options().keys()


def test_a_payload_is_followed_by_settling_within_a_second() -> None:
    result = league.fly(Row(chosen("default"), "payload on, off", "paper_40g"))
    assert result.settle_s == pytest.approx(0.78, abs=0.05)
    off_m = np.array([[0.0], [0.02], [0.005], [0.02], [0.0], [0.0]])
    error_m = np.concatenate([off_m, np.zeros((6, 1)), np.zeros((6, 1))], axis=1)[:, None]
    tracking = Tracking(np.arange(6.0), error_m, np.ones((6, 1), np.bool_), np.ones((6, 1), np.bool_))
    assert league._settle_s(tracking, [(1.0, 6.0)]) == 3.0
    assert league._settle_s(tracking, [(1.0, 3.0), (4.0, 6.0)]) == 0.5
    assert league._settle_s(tracking, []) is None


def test_neural_flys_winds_are_scenes_where_their_recordings_are(tmp_path: Path) -> None:
    """Two recordings of a point held in a push of 2 m/s^2, written here."""
    line = '{k},{t},"[0.0, 0.0, 1.0]","[0.0, 0.0, 1.0]","[5.288, 0.0, 0.0]",""'
    text = "\n".join([",t,p,p_d,fa,pwm", *(line.format(k=k, t=2.0 * k) for k in range(4))])
    scenes = list(neural_fly.SCENES)[:2]
    for scene in scenes:
        neural_fly.path_of(tmp_path, "baseline", neural_fly.SCENES[scene]).write_text(text)
    rows = league.rows([chosen("default")], ["line", *scenes], ["paper_40g"], recordings=tmp_path)
    assert [row.vehicle for row in rows] == ["paper_40g", "neural_fly_2644g", "neural_fly_2644g"]
    result = league.fly(rows[1])
    assert result.outcome == "held"
    assert result.max_m is not None
    assert 0.003 < result.max_m < 0.1  # in still air it keeps within 1 mm
    written = league.to_json([(rows[1], result)])
    assert league.known_rows(written, "league.json", tmp_path) == [(rows[1], result)]
    with pytest.raises(LeagueError, match="yours to fetch; --neural-fly DIR"):
        league.known_rows(written, "league.json")
    Path(rows[1].recording).write_text(text + "\n")
    with pytest.raises(LeagueError, match="is another file"):
        league.known_rows(written, "league.json", tmp_path)


def test_each_vehicle_has_the_options_that_it_was_tuned_with() -> None:
    laws = [chosen("smc.py"), chosen("default")]
    flown = league.rows(laws, ["line"], ["paper_40g", "px4_quad"], {"smc.py": {"px4_quad": {"c_1_s": 2.0}}})
    assert [dict(row.law.law) for row in flown] == [{}, {}, {"c_1_s": 2.0}, {}]


def test_what_cannot_be_flown_is_named() -> None:
    with pytest.raises(ValueError, match="unknown scene 'moon'; known: line, circle"):
        league.rows([chosen("default")], ["moon"], ["paper_40g"])
    with pytest.raises(ValueError, match="two laws are called smc"):
        league.rows([chosen("a/smc.py"), chosen("b/smc.py")], ["line"], ["paper_40g"])
    with pytest.raises(ValueError, match=r"which law\? smc\.py:NAME, of SMC"):
        law_in_file(f"{LAWS / 'smc.py'}:Name", {})
