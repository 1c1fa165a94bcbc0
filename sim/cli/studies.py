"""The command lines of the studies of `gcs-sim`, from `paper` to `bench`."""

from pathlib import Path
from typing import Annotated

import typer

OutFolder = Annotated[Path, typer.Option(help="Where the files go.")]
PAPER_SEEDS = 10


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("paper")(compare)
    app.command("robustness")(robust)
    app.command("steady-push")(steady_push)
    app.command("hummingbird")(hummingbird)
    app.command("false-rejections")(false_rejections)
    app.command("tune")(tune_vehicle)
    app.command("bench")(bench)


def compare(
    out: OutFolder = Path(),
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 1.")] = PAPER_SEEDS,
    vehicle: Annotated[
        str, typer.Option(help="What is flown: a shipped vehicle's name, or a profile's TOML file.")
    ] = "paper_40g",
    only: Annotated[list[str] | None, typer.Option(help="Fly this controller alone; can be given again.")] = None,
    calibrate: Annotated[bool, typer.Option(help="Only find the fan that moves the printed ISTSMC by 0.30 m.")] = False,
    bound: Annotated[
        bool, typer.Option(help="Only print the least deviation in the gust that any controller could reach.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Fly the paper's gust, line and circle, and a steady push, with nine controllers; writes paper.json and .html."""
    from sim.cli import study_commands as studies

    studies.run_paper(out, seeds, vehicle, only or [], calibrate, bound, as_json)


def robust(
    samples: Annotated[int, typer.Option(min=1, help="How many draws, by seeds from --first on.")] = 100,
    first: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1,
    only: Annotated[int | None, typer.Option(help="Fly this one seed again, with log and report.")] = None,
    profile: Annotated[str, typer.Option(help="The vehicle the controller believes in.")] = "paper_40g",
    preset: Annotated[str, typer.Option(help="The controller.")] = "default",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print every sample as JSON, and nothing else there.")
    ] = False,
    out: OutFolder = Path("runs"),
) -> None:
    """Fly vehicles that are not what the controller believes; the worst ten, by seed. Exit code 1 if any failed."""
    from sim.cli import study_commands as studies

    studies.run_robustness(samples, first, only, profile, preset, as_json, out)


def steady_push(
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 1.")] = 1,
    vehicle: Annotated[
        str, typer.Option(help="What is flown: a shipped vehicle's name, or a profile's TOML file.")
    ] = "paper_40g",
    only: Annotated[list[str] | None, typer.Option(help="Fly this controller; can be given again.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Hover in a push that begins at once and stays, with slower motors than believed; exit code 1 if any swings on."""
    from sim.cli import study_commands as studies

    studies.run_steady_push(seeds, vehicle, tuple(only or ["cfc"]), as_json)


def hummingbird(
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 1.")] = 1,
    log: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Keep the logs of the flights here.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON, and nothing else there.")] = False,
) -> None:
    """Fly line, circle and gust on rotorpy's physics, its Hummingbird; some minutes. Exit code 1 if any failed.

    Needs rotorpy: pip install 'mavlink-formation[rotorpy]'.
    """
    from sim.cli import study_commands as studies

    studies.run_hummingbird(seeds, log, as_json)


def false_rejections(
    hours: Annotated[float, typer.Option(min=0.001, help="Hours of flight, over all sources together.")] = 10.0,
    leader_csv: Annotated[Path | None, typer.Option(help="A recorded leader to replay as well (CSV).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Count the pose validator's false rejections: every shipped scenario, and aggressive motion, under ever new noise.

    Exit code 1 if there was any.
    """
    from sim.cli import study_commands as studies

    studies.run_false_rejections(hours, leader_csv, as_json)


def tune_vehicle(
    vehicle: Annotated[
        str, typer.Argument(metavar="PROFILE", help="A shipped vehicle's name, or a profile's TOML file.")
    ],
    gains: Annotated[
        str | None, typer.Option(help="Search this preset's own gains instead: default, pid, geometric.")
    ] = None,
    rate_hz: Annotated[float, typer.Option("--rate", help="Mocap frames a second.")] = 100.0,
    delay_s: Annotated[float, typer.Option("--delay", help="Mocap delay, s.")] = 0.008,
    noise_m: Annotated[float, typer.Option("--noise", help="Mocap noise, m.")] = 0.0001,
    out: Annotated[Path | None, typer.Option(help="Write the tuned profile here, to go under [[profiles]].")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")] = False,
) -> None:
    """Find the gain scales of a vehicle's loops: gains, observer bandwidth and compensation, judged in flight."""
    from sim.cli import study_commands as studies

    studies.run_tune(vehicle, gains, rate_hz, delay_s, noise_m, out, as_json)


def bench(
    followers: Annotated[
        list[int] | None, typer.Option(min=1, max=249, help="How many follow; again for more swarms. 2, 10 and 20.")
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="REV", help="Measure this commit of the checkout, too, and show ratios.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON, and nothing else there.")] = False,
) -> None:
    """Time law, estimate, tick, codec, lockstep and bus on this machine; some seconds. It judges nothing.

    A swarm of 101 drones takes two minutes.
    """
    from sim.cli import study_commands as studies

    studies.run_bench(followers, against, as_json)
