"""`gcs check`: judges a lab file, prints its numbers and draws it, without starting anything."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path

import typer
from rich.console import Console

from formation.config import LabConfig, VehicleBody
from formation.guidance.preview import Preview
from gcs.finding import Finding, Grade, as_dicts, failed
from gcs.lab.drawing import drawn, text_plan
from gcs.lab.feasibility import peaks, trajectory_text
from gcs.lab.findings import findings_of, judge_margins, line, of_grade, print_line
from gcs.lab.judge import foreseen
from wire.config_file import ConfigError, lines_of, load
from wire.files import new_file, read_toml
from wire.process.program import fail
from wire.process.system import NOT_RIGHT, REJECTED, python_command

INDENT = " " * 8


def check(lab: Path, svg: Path | None, as_json: bool, overwrite: bool = False) -> None:
    """Judge and draw a lab file, or a scenario and the lab that it flies; ends the program with its exit code."""
    if _is_scenario(lab):
        # Scenarios are the simulator's; what they are is known there alone.
        if svg is not None:
            fail(f"--svg: {lab} is a scenario: what is drawn is a lab file", NOT_RIGHT)
        words = [str(lab), *(["--json"] if as_json else [])]
        raise typer.Exit(subprocess.run(python_command("sim", "check", *words), check=False).returncode)
    try:
        config = load(lab, LabConfig)
    except ConfigError as error:
        not_right(lab, error, as_json)
    else:
        if svg is not None:
            draw(config, svg, overwrite)
        judge_lab(lab, config, as_json)


def not_right(file: Path, error: ConfigError, as_json: bool) -> None:
    """Say what keeps the file from being read, and end the program."""
    if not error.faults:
        fail(str(error), NOT_RIGHT)
    wrong = [Finding(f.key, "value", Grade.FAIL, f.value, why=f.reason) for f in error.faults]
    conclude(file, wrong, None, as_json)


def draw(config: LabConfig, svg: Path, overwrite: bool = False) -> None:
    """Draw the lab from above into a file; ends the program where it cannot be written."""
    from gcs.lab.plan_svg import write_plan  # loads matplotlib

    ahead = foreseen(config)
    try:
        with new_file(svg, overwrite) as path:
            write_plan(path, drawn(config, ahead), f"{_fence_text(config)}\n{_trajectory_text(config, ahead)}")
    except OSError as error:
        fail(f"{svg}: {error.strerror}", NOT_RIGHT)


def judge_lab(file: Path, config: LabConfig, as_json: bool, further: Sequence[Finding] = ()) -> None:
    """Judge and draw a lab that could be read; ends the program with its exit code. further: what else was found."""
    ahead = foreseen(config)
    if not as_json:
        print(text_plan(drawn(config, ahead)), *summary(config, ahead), "", sep="\n")
    findings = (*findings_of(config), *further)
    if not failed(findings):
        findings = (*findings, *judge_margins(config))
    conclude(file, findings, numbers(config, ahead), as_json)


def _is_scenario(file: Path) -> bool:
    """Whether the file is a scenario of the simulator's, which has a lab or names one."""
    try:
        return "lab" in read_toml(file)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def numbers(config: LabConfig, ahead: Preview) -> dict[str, object]:
    """The leader's trajectory and the fastest slot, for scripts."""
    leader, *slots = peaks(config, ahead)
    fastest = max(slots, key=lambda peak: peak.speed_m_s)
    return {
        "vehicles": {
            v.body: {
                "profile": v.profile,
                "named": v.names_profile,
                "mass_kg": config.profile_of(v).mass_kg,
            }
            for v in (config.vehicles[i] for i in config.commanded)
        },
        "leader_observed": config.leader.sysid is None,
        "trajectory": config.leader.trajectory.kind,
        "length_m": round(ahead.length_m, 4),
        "duration_s": round(ahead.duration_s, 3),
        "leader_speed_m_s": round(leader.speed_m_s, 4),
        "leader_acc_m_s2": round(leader.acc_m_s2, 4),
        "fastest_slot": fastest.body,
        "fastest_slot_speed_m_s": round(fastest.speed_m_s, 4),
        "fastest_slot_acc_m_s2": round(fastest.acc_m_s2, 4),
    }


def summary(config: LabConfig, ahead: Preview) -> list[str]:
    """The same as text lines, and the fence."""
    lines = [f"{INDENT}{_fence_text(config)}", *(f"{INDENT}{text}" for text in vehicles(config))]
    if config.leader.sysid is None:
        return [*lines, f"{INDENT}{config.leader.body} is only observed: it flies what it flies"]
    leader, *slots = peaks(config, ahead)
    fastest = max(slots, key=lambda peak: peak.speed_m_s)
    lines.append(f"{INDENT}{_trajectory_text(config, ahead)}")
    for role, peak in (("leader", leader), (f"fastest slot, {fastest.body}", fastest)):
        lines.append(f"{INDENT}{role}: up to {peak.speed_m_s:.2f} m/s and {peak.acc_m_s2:.2f} m/s^2")
    for name in config.leader.trajectories:
        lab = config.flying(name)
        lines.append(f"{INDENT}trajectory {name}: {trajectory_text(lab, foreseen(lab))}")
    return lines


def vehicles(config: LabConfig) -> list[str]:
    """The vehicle that each commanded drone is believed to be."""
    return [_vehicle(config, config.vehicles[i]) for i in config.commanded]


def _vehicle(config: LabConfig, vehicle: VehicleBody) -> str:
    kind = config.profile_of(vehicle)
    whence = "" if vehicle.names_profile else " (none named)"
    return (
        f"{vehicle.body} flies as {kind.name}: {kind.mass_kg * 1e3:g} g, {kind.wheelbase_m * 1e3:g} mm, "
        f"hovers at {kind.hover_thrust_norm:.2f}{whence}"
    )


def _fence_text(config: LabConfig) -> str:
    low, high = config.limits.fence.low_m, config.limits.fence.high_m
    size = " x ".join(f"{b - a:g}" for a, b in zip(low, high, strict=True))
    return f"fence {size} m, take-off to {config.flight.altitude_m:g} m"


def _trajectory_text(config: LabConfig, ahead: Preview) -> str:
    if config.leader.sysid is None:
        return "leader observed"
    if config.leader.trajectory.kind == "hold":
        return f"hold: {ahead.duration_s:.1f} s"
    return f"{config.leader.trajectory.kind}: {ahead.length_m:.2f} m in {ahead.duration_s:.1f} s, then it stays there"


def conclude(lab: Path, findings: Sequence[Finding], counted: dict[str, object] | None, as_json: bool) -> None:
    """Print errors, then warnings; end with the exit code."""
    errors, warnings, at = of_grade(findings, Grade.FAIL), of_grade(findings, Grade.WARN), lines_of(lab)
    if as_json:
        print(json.dumps({"file": str(lab), "findings": as_dicts(findings), "numbers": counted}))
    else:
        for words, found in (("error", errors), ("warning", warnings)):
            for finding in found:
                print_line(f"{words}: {line(finding, at)}", finding.grade, Console())
        print(f"{lab}: {_counted(len(errors), 'error')}, {_counted(len(warnings), 'warning')}")
    if failed(findings):
        raise typer.Exit(REJECTED)


def _counted(n: int, word: str) -> str:
    return f"{n or 'no'} {word}{'' if n == 1 else 's'}"
