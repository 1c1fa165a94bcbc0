"""The speed of a flight by real processes: what the user writes, else that with which the machine keeps up."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from formation.codes import FlightResult, Outcome
from sim.cli import flights
from sim.cli.app import app
from sim.lockstep import Flown
from sim.scenario import load


@dataclass
class Machine:
    """Flies in lockstep at a speed of its own, its clock with it, and pauses once."""

    factor: float
    pause_s: float
    now_ns: int = 0

    def fly(self, scenario: Any, _seed: int, _record: Any, progress: Any) -> Flown:
        for k in range(round(scenario.longest_s / 0.1)):
            self.now_ns += round(1e9 * (0.1 / self.factor + (self.pause_s if k == 7 else 0.0)))
            progress(0.1 * k, "GROUND")
        return Flown(Outcome(FlightResult.ABORTED, ""), scenario.longest_s, self.factor)


def of_machine(monkeypatch: pytest.MonkeyPatch, factor: float, pause_s: float) -> None:
    machine = Machine(factor, pause_s)
    monkeypatch.setattr(flights.lockstep, "fly", machine.fly)
    monkeypatch.setattr(flights.clock, "monotonic_ns", lambda: machine.now_ns)


@pytest.mark.parametrize(
    ("factor", "pause_s", "speed"),
    [(10.0, 0.0, 1.0), (2.5, 0.0, 0.5), (10.0, 0.19, 0.25), (2.5, 0.16, 0.25), (0.1, 0.0, 0.1), (10.0, 5.0, 0.1)],
)
def test_a_flight_is_as_slow_as_the_share_and_the_pauses_of_the_cpu_ask_for(
    factor: float, pause_s: float, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_machine(monkeypatch, factor, pause_s)
    assert flights.fitting_speed(load("triangle_line")) == speed


@pytest.mark.parametrize(
    ("options", "speed", "said"),
    [((), 0.5, "flying at 0.5 of real time"), (("--speed", "1"), 1.0, ""), (("--speed", "0.7"), 0.7, "")],
)
def test_what_the_user_writes_is_flown(
    options: tuple[str, ...], speed: float, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    of_machine(monkeypatch, 2.5, 0.0)
    monkeypatch.setattr(flights, "compile_for", lambda _scenario: None)
    flown = []

    async def fly(*given: Any) -> Outcome:
        flown.append(given[5].speed)
        return Outcome(FlightResult.ABORTED, "nothing flew")

    monkeypatch.setattr(flights, "fly_processes", fly)
    result = CliRunner().invoke(app, ["fly", "--out", str(tmp_path), *options])
    assert (result.exit_code, flown) == (1, [speed])
    assert ("of real time" in result.stderr) == bool(said)
    assert said in result.stderr


def test_this_machine_flies() -> None:
    assert 0.1 <= flights.fitting_speed(load("triangle_line")) <= 1.0
