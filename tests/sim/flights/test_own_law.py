"""A lab's own control law, by the example package, in lockstep: it flies the followers, ours stands behind it."""

import re
import sys
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest

from analysis.load import load as load_flight
from analysis.metrics import parse_requirement, summarise, unmet
from formation import topics
from formation.config import ControlLawConfig
from formation.messages import Event, Severity
from gcs.replay import ReplayError, replay
from sim import ground_host, lockstep
from sim.scenario import Scenario, load
from tests.wire.own_package import installed_in
from wire.logs.mcap_read import Log, read_log


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[None]:
    with installed_in(tmp_path):
        yield


def lap() -> Scenario:
    """One lap of a small fast circle, the followers flown by the example's law."""
    scenario = load("triangle_circle")
    trajectory = scenario.lab.leader.trajectory.model_copy(update={"period_s": 6.0, "duration_s": 6.0})
    leader = scenario.lab.leader.model_copy(update={"trajectory": trajectory})
    lab = scenario.lab.model_copy(update={"leader": leader, "control_law": ControlLawConfig(name="cascade")})
    return scenario.model_copy(update={"lab": lab, "formation_s": 6.0})


def alarms(log: Log) -> list[Event]:
    events = [entry.message for entry in log.entries if entry.topic is topics.EVENT]
    return [event for event in events if event.severity <= Severity.ERROR]


def test_the_followers_fly_by_it_and_the_flight_replays_where_it_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, seen = tmp_path / "flight.mcap", []
    with installed_in(tmp_path):
        from own_formation.cascade import Cascade

        flies = Cascade.__call__
        monkeypatch.setattr(Cascade, "__call__", lambda self, at: (seen.append(at), flies(self, at))[1])
        assert lockstep.run_to_file(lap(), 1, path).outcome.result == "landed"
        log = read_log(path)
        assert log.metadata["control_law"] == "cascade, of own-formation 1.0"
        assert_agrees_with_itself(list(seen))
        assert replay(log).identical
    summary = summarise(load_flight(path))
    assert summary.formation_rms_m is not None
    assert summary.formation_rms_m < 0.004
    commands = [entry.message for entry in log.entries if entry.topic is topics.COMMAND]
    # The sliding variable is the built-in law's: the followers' is nothing while theirs flies, the leader's is not.
    alone = [bool((c.s_lead_m_s[1:] == 0.0).all() and (c.s_lead_m_s[0] != 0.0).any()) for c in commands]
    assert 0.3 < np.mean(alone) < 0.9
    with pytest.raises(ReplayError, match=r"cascade, of own-formation 1\.0.*no package here registers 'cascade'"):
        replay(read_log(path))


def assert_agrees_with_itself(seen: list[Any]) -> None:
    """What the law is called with."""
    moving = [at for at in seen if np.linalg.norm(at.leader.vel_lab_m_s) > 0.2]
    assert len(moving) > 100
    for at in moving[::10]:
        c, s = np.cos(at.heading_rad), np.sin(at.heading_rad)
        to_lead = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        off = to_lead @ (at.own.pos_lab_m - at.slot.pos_lab_m)
        np.testing.assert_allclose(at.error_lead_m, off, atol=1e-9)
        rate = to_lead @ (at.own.vel_lab_m_s - at.slot.vel_lab_m_s) - np.cross([0.0, 0.0, at.heading_rate_rad_s], off)
        np.testing.assert_allclose(at.error_rate_lead_m_s, rate, atol=1e-9)
        assert at.lag_s[0] > at.lag_s[1] > 0.0
    # A leader on a circle of 0.3 m is accelerated towards its middle, and every slot with it.
    inwards = [np.dot(at.leader.acc_lab_m_s2, at.leader.pos_lab_m * [1.0, 1.0, 0.0]) < 0.0 for at in moving]
    assert np.mean(inwards) > 0.95
    # A commanded leader is taken to accelerate as its reference says: known, and free of the estimate's noise.
    acc_lab_m_s2 = np.array([at.slot.acc_lab_m_s2 for at in seen if at.body == "left"])
    assert np.sqrt(np.mean(np.diff(acc_lab_m_s2, n=2, axis=0) ** 2)) < 3e-3
    first = {at.body: at for at in reversed(seen)}
    assert [first[body].dt_s for body in ("left", "right")] == [0.0, 0.0]
    assert np.median([at.dt_s for at in moving]) == pytest.approx(0.01, abs=0.001)


def test_where_it_fails_the_built_in_law_takes_over_and_everybody_is_told(
    tmp_path: Path, installed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from own_formation.cascade import Cascade

    flies, path = Cascade.__call__, tmp_path / "flight.mcap"

    def fails_on_the_way(self: Cascade, at):  # past a quarter of the lap
        return flies(self, at) / (0.0 if at.leader.pos_lab_m[1] > 0.29 and at.body == "left" else 1.0)

    monkeypatch.setattr(Cascade, "__call__", fails_on_the_way)
    with np.errstate(all="ignore"):
        assert lockstep.run_to_file(lap(), 1, path).outcome.result == "landed"
    (alarm,) = alarms(read_log(path))
    assert alarm.text.startswith("control law cascade, left: ValueError: it demands [")
    assert alarm.text.endswith("; the built-in law flies on")
    summary = summarise(load_flight(path))
    assert summary.formation_max_m is None  # two laws flew: the figure would be nobody's
    assert summary.law_failures == 1
    assert str(summary.outcome).startswith("law failed: control law cascade, left: ValueError: it demands [")
    assert "law_failures<1 is required, it is 1" in unmet([parse_requirement("law_failures<1")], summary)


@pytest.mark.parametrize("does", ["loops", "exits", pytest.param("sleeps", marks=pytest.mark.nightly)])
def test_a_law_that_never_answers_or_ends_the_process_does_not(
    does: str, tmp_path: Path, installed: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from own_formation.cascade import Cascade

    flies, path = Cascade.__call__, tmp_path / "flight.mcap"

    def goes_wrong(self: Cascade, at):
        if at.leader.pos_lab_m[1] > 0.29:
            if does == "exits":
                sys.exit(3)
            while does == "loops":
                with suppress(Exception):
                    flies(self, at)
            sleep(60.0)
        return flies(self, at)

    monkeypatch.setattr(Cascade, "__call__", goes_wrong)
    monkeypatch.setattr(ground_host, "LAW_S", 0.5)
    assert lockstep.run_to_file(lap().model_copy(update={"formation_s": 3.0}), 1, path).outcome.result == "landed"
    log, summary = read_log(path), summarise(load_flight(path))
    assert summary.law_failures == 1
    said = "right: SystemExit: 3" if does == "exits" else "cascade: no answer within 500 ms"
    assert said in summary.outcome.reason
    if does == "loops":  # a replay does not wait for it: the decision is in the log
        monkeypatch.setattr(ground_host, "LAW_S", 1e6)
        assert replay(log).identical


@pytest.mark.nightly
def test_the_manual_s_figures_are_those_of_its_options(tmp_path: Path, installed: None) -> None:
    page = Path(__file__).parents[3] / "docs" / "manual" / "tutorials" / "own-law.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    options = re.search(r'control_law = \{ name = "cascade", options = (\{.*?\}) \}', text)
    told = re.search(r"within ([\d.]+) mm RMS\. The built-in law holds it within ([\d.]+) mm", text)
    assert options is not None
    assert told is not None
    scenario = load("triangle_circle")
    law = ControlLawConfig(name="cascade", options=tomllib.loads(f"options = {options[1]}")["options"])
    for control_law, figure in zip((law, None), told.groups(), strict=True):
        lab = scenario.lab.model_copy(update={"control_law": control_law})
        log = tmp_path / f"{figure}.mcap"
        lockstep.run_to_file(scenario.model_copy(update={"lab": lab}), 7, log)
        assert f"{1e3 * (summarise(load_flight(log)).formation_rms_m or 0.0):.2f}" == figure
