"""An autopilot's clock on a flight's axis: known offsets and drifts, by TIMESYNC and by motion; what cannot tell."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gcs_log
from analysis.chain import stages
from analysis.identify.signals import sent
from analysis.imports.align import by_exchanges, by_motion
from analysis.load import load
from analysis.series import Sampled
from formation.maths import frames
from formation.maths.arrays import Float
from formation.topics import TRUTH
from gcs.replay import replay
from sim import lockstep, scenario
from tests.analysis.imports.stranger import ulog
from tests.analysis.imports.test_import import run
from wire import config_file
from wire.logs.mcap_read import read_columns, read_log

WITHIN_S, WITHIN = 2e-3, 5e-6
"""What is asked of a joined log."""
CLOCKS = [(1234.56789, 40e-6), (-3.21, -60e-6), (0.0, 0.0)]


def own_time(t_s: Float, offset_s: float, drift: float) -> Float:
    """The autopilot's clock at the flight's times."""
    return t_s + offset_s + drift * (t_s - float(np.mean(t_s)))


@pytest.mark.parametrize(("offset_s", "drift"), CLOCKS)
def test_timesync_tells_offset_and_drift(offset_s: float, drift: float) -> None:
    rng = np.random.default_rng(1)
    t_s = np.arange(0.0, 120.0, 1.0)
    there, back = (0.001 + rng.gamma(1.0, 0.001, len(t_s)) for _ in range(2))
    found = by_exchanges(t_s - there, own_time(t_s, offset_s, drift), t_s + back)
    assert found is not None
    assert found.drift.value == pytest.approx(drift, abs=WITHIN)
    np.testing.assert_allclose(found.flight_s(own_time(t_s, offset_s, drift)), t_s, atol=WITHIN_S)
    assert found.offset_s.half_width == pytest.approx(0.001, rel=0.5)  # half of the quickest round trip


def test_timesync_of_a_clock_that_was_set_is_none() -> None:
    t_s = np.arange(0.0, 60.0, 1.0)
    assert by_exchanges(t_s - 0.001, t_s + np.where(t_s > 30.0, 5.0, 0.0), t_s + 0.001) is None
    assert by_exchanges(t_s[:5] - 0.001, t_s[:5], t_s[:5] + 0.001) is None


def lively(t_s: Float, seed: int = 3, lean_rad: float = 0.15) -> Float:
    """Attitudes of a flight that never repeats itself."""
    rng = np.random.default_rng(seed)
    waves = [(lean_rad * rng.uniform(0.2, 0.5), rng.uniform(0.3, 5.0), rng.uniform(0.0, 6.0)) for _ in range(24)]
    roll, pitch, yaw = (sum(a * np.sin(w * t_s + p) for a, w, p in waves[k::3]) for k in range(3))
    return frames.from_euler(roll, pitch, yaw)


def cameras_and_gyros(
    duration_s: float, offset_s: float, drift: float, motion: Callable[[Float], Float]
) -> tuple[Float, Float, Sampled]:
    """100 Hz of attitudes with 1 mrad of noise, markers that lean by 20 mrad; 250 Hz of gyros with noise and bias."""
    rng = np.random.default_rng(5)
    t_s, gyro_s = np.arange(5.0, duration_s, 0.01), np.arange(0.0, duration_s + 5.0, 0.004)
    tilted = frames.multiply(motion(t_s), frames.from_rotation_vector(np.array([0.02, -0.01, 0.02])))
    q = frames.multiply(tilted, frames.from_rotation_vector(rng.normal(0.0, 1e-3, (len(t_s), 3))))
    before, after = (motion(gyro_s + dt) for dt in (-5e-4, 5e-4))
    rates = frames.rotation_vector(frames.multiply(frames.inverse(before), after)) / 1e-3
    rates += rng.normal([0.01, -0.02, 0.005], 3e-3, rates.shape)
    return t_s, q, Sampled(gyro_s + offset_s + drift * (gyro_s - float(np.mean(t_s))), rates)


@pytest.mark.parametrize(("offset_s", "drift"), CLOCKS)
def test_motion_tells_offset_and_drift(offset_s: float, drift: float) -> None:
    t_s, q, gyro = cameras_and_gyros(90.0, offset_s, drift, lively)
    found = by_motion(t_s, q, gyro)
    assert found.drift.value == pytest.approx(drift, abs=WITHIN)
    np.testing.assert_allclose(found.flight_s(own_time(t_s, offset_s, drift)), t_s, atol=WITHIN_S)
    assert abs(found.drift.value - drift) < 2.0 * found.drift.half_width
    assert found.offset_s.half_width < 1e-4


def circling(t_s: Float) -> Float:
    return frames.from_euler(0.1 * np.sin(2.0 * t_s), 0.1 * np.cos(2.0 * t_s), 0.02 * np.sin(4.0 * t_s))


@pytest.mark.parametrize(
    ("duration_s", "motion", "flown", "words"),
    [
        (60.0, lambda t_s: lively(t_s, lean_rad=0.0), None, "says"),
        (60.0, circling, None, "says nothing"),
        (60.0, lively, lambda t_s: lively(t_s, seed=99), "says"),
        (12.0, lively, None, "less than 10 s"),
    ],
)
def test_refused_where_the_motion_cannot_tell(
    duration_s: float, motion: Callable[[Float], Float], flown: Callable[[Float], Float] | None, words: str
) -> None:
    t_s, q, gyro = cameras_and_gyros(duration_s, 7.0, 0.0, motion)
    with pytest.raises(ValueError, match=words):
        by_motion(t_s, q if flown is None else flown(t_s), gyro)


SYSID = 2
RECEIVED_S = 0.03
"""Later than sent: by the log of the autopilot."""
CIRCLE = """
name = "joined"
formation_s = 8.0
[lab.leader]
body = "leader"
sysid = 1
trajectory = { kind = "circle", radius_m = 0.6, period_s = 4.0 }
[[lab.followers]]
body = "left"
sysid = 2
offset_m = [-0.5, 0.0, 0.0]
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated flight, and beside it what the follower's autopilot might have logged: a ULog of its true rates."""
    path = tmp_path_factory.mktemp("join") / "flight.mcap"
    plan = config_file.parse(tomllib.loads(CIRCLE), scenario.Scenario, source="test")
    lockstep.run_to_file(plan, 4, path)
    truth = read_columns(path, {TRUTH: ("t_ns", "sysid", "rate_flu_rad_s", "q_lab_from_flu")})
    rows = truth.topics[TRUTH]
    mine = rows.fields["sysid"].values == SYSID
    turn = np.array([1.0, -1.0, -1.0])
    rates = rows.fields["rate_flu_rad_s"].stack()[mine] * turn
    q = rows.fields["q_lab_from_flu"].stack()[mine] * [1.0, *turn]
    tables = {
        "vehicle_angular_velocity": {f"xyz[{k}]": part for k, part in enumerate(rates.T)},
        "vehicle_attitude": {f"q[{k}]": part for k, part in enumerate(q.T)},
    }
    targets = sent(load(path))[SYSID]
    own_s = 1e-9 * (rows.fields["t_ns"].values[mine] - lockstep.T0_NS)
    last = np.maximum(np.searchsorted(targets.t_s, own_s - RECEIVED_S, side="right") - 1, 0)
    tables["vehicle_attitude_setpoint"] = {
        f"q_d[{k}]": part for k, part in enumerate((targets.q_lab_from_flu[last] * [1.0, *turn]).T)
    }
    t_us = (rows.fields["t_ns"].values[mine] - lockstep.T0_NS) // 1000  # the drone boots then, and its clock begins
    (path.parent / "log.ulg").write_bytes(ulog(tables, stamps_us=t_us))
    return path


def test_joined_log_is_the_flight_with_the_autopilots_signals_in_it(flown: Path) -> None:
    out = flown.with_name("joined.mcap")
    result = run("join", flown, flown.with_name("log.ulg"), "--out", out, "--sysid", str(SYSID), "--json")
    assert result.exit_code == 0, result.output
    (joined,) = json.loads(result.stdout)["joined"]
    assert joined["body"] == "left"
    assert joined["alignment"]["by"] == "TIMESYNC"
    before, flight = load(flown), load(out)
    true_s = 1e-9 * (before.t0_ns - lockstep.T0_NS)
    assert joined["alignment"]["offset_s"]["value"] == pytest.approx(true_s, abs=WITHIN_S)
    assert replay(read_log(out)).identical
    assert flight.duration_s == before.duration_s
    rates, truth = flight.signals["left", "rates"], gcs_log.load(flown)["sim/truth"]
    mine = truth["sysid"] == SYSID
    true_s = 1e-9 * (truth["t_ns"][mine] - before.t0_ns)
    inside = (true_s > rates.t_s[0]) & (true_s < rates.t_s[-1])
    assert inside.sum() > 1000
    for axis, part in zip("xyz", rates.values.T, strict=True):
        there = np.interp(true_s, rates.t_s, part)
        assert np.abs(there - truth[f"rate_flu_rad_s_{axis}"][mine])[inside].max() < 0.02
    found = {stage.name: stage for stage in stages(flight)}
    assert found["sent → received"].delay_s == pytest.approx(RECEIVED_S, abs=0.002)
    assert found["sent → received"].alike > 0.99
    assert 0.0 < found["received → flown"].delay_s < 0.15
    report = run("report", out)
    assert report.exit_code == 0
    assert "sent → received" in out.with_name("report.html").read_text()
    assert "gyros: join by the motion" in json.loads(run("check", out, "--json").stdout)["usable"]
    assert len(gcs_log.load(out)["import/signal/rates"]["t_s"]) == len(rates.t_s)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ((), "is of drone 7; --sysid names one of 1 (leader), 2 (left)"),
        (("--sysid", "9"), "is of drone 9"),
        (("--out", "flight.mcap"), "it is there already"),
    ],
)
def test_join_rejects_in_one_line(words: tuple[str, ...], text: str, flown: Path) -> None:
    places = [str(flown.with_name(word)) if word.endswith(".mcap") else word for word in words]
    out = () if "--out" in words else ("--out", flown.with_name("x.mcap"))
    result = run("join", flown, flown.with_name("log.ulg"), *out, *places)
    assert result.exit_code == 2
    assert text in result.output
    assert len(result.output.strip().splitlines()) == 1
