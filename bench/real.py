"""`python -m bench.real FOLDER`: how far the simulator is right about flights that others flew.

FOLDER: `datasets/dataset` of https://github.com/syediu/nanobench-iros2026 (BSD-3-Clause; arXiv 2603.09908): a Crazyflie
2.1 in Vicon under its own PID and Mellinger controllers, three speeds, several repetitions. Fetch it yourself.

What is fitted and what is foretold was written down before the first flight was foretold, and never mixes. A file that
is another's copy under a new number is named once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats import spearmanr

from analysis.identify.response import Response
from analysis.identify.vehicle import KNOWN_WITHIN, Identified, identify
from analysis.imports.cli import import_files
from analysis.load import Flight, load
from formation.vehicle.profile import VehicleProfile, profile
from sim.research.foretell import Foretold, foretell
from sim.research.laws import chosen
from wire.config_file import dump_profile

FITTED = {"B2_circle_fast": (2,), "B3_figure8_medium": (2,), "B8_star_fast": (1,), "B10_lissajous_fast": (1,)}
"""Under PID, by figure and repetition: of these the vehicle is identified."""
FORETOLD_PID = {
    "B2_circle_slow": (1, 2, 3), "B2_circle_medium": (1, 2), "B2_circle_fast": (1, 3),
    "B3_figure8_slow": (1, 2, 3), "B3_figure8_medium": (1,), "B3_figure8_fast": (1, 2),
    "B5_helix": (1,), "B5_helix_slow": (1, 2), "B5_helix_medium": (1, 2, 3), "B5_helix_fast": (1, 2, 3),
    "B6_linear_ramp": (3, 4), "B7_oval_slow": (2, 3), "B7_oval_medium": (1, 2, 3), "B7_oval_fast": (1, 2, 3),
    "B8_star_slow": (1,), "B8_star_medium": (1,), "B9_trefoil_slow": (1, 13, 14, 15, 16, 17, 18),
    "B9_trefoil_medium": (12, 13, 14, 15), "B9_trefoil_fast": (1, 14), "B10_lissajous_slow": (1,),
}  # fmt: skip
FORETOLD_MELLINGER = {
    "B5_helix_fast_mell": (1,), "B8_star_slow": (2, 3), "B8_star_medium": (2, 3), "B8_star_fast": (2, 3),
    "B9_trefoil_slow": (2, 6, 10, 11, 12), "B9_trefoil_medium": (1, 2, 10, 11), "B9_trefoil_fast": (4, 11, 12, 13),
}  # fmt: skip
LEFT_OUT = {
    "A1b_multisine_sysid, B11_random_waypoints, B12_staircase_climb, C4_battery_drain": "not in the copy at hand",
    "B2_circle_medium 3": "falls away at the end, 5.8 m from its reference",
    "B3_figure8_medium 3": "Mellinger; looked at while the identification was written",
    "B6_linear_ramp 1, B7_oval_slow 1": "do not fly",
    "B6_linear_ramp 2": "1.1 m from a reference that hardly moves",
    "B9_trefoil_fast 2": "the cameras' track is lost: 24 m",
    "B9_trefoil_fast 10, 15": "fly away halfway, 8.9 and 2.3 m",
}
"""Seen in the recordings, before any was foretold."""
BASE, WITHIN = "crazyflie_27g", 0.25
LAWS = Path(__file__).parents[1] / "examples" / "laws"


@dataclass(frozen=True, slots=True)
class Row:
    """One flight."""

    name: str
    rep: int
    found: Foretold

    @property
    def text(self) -> str:
        """Flown, foretold, apart, largest, in mm; delays in ms."""
        f, s = self.found.flown, self.found.foretold
        assert s is not None
        assert self.found.path_rms_m is not None
        sides = (
            f"{1e3 * side.rms_m:5.0f} (95 % {1e3 * side.p95_m:4.0f}, largest {1e3 * side.max_m:4.0f}, "
            f"{1e3 * side.delay_s:3.0f} ms)"
            for side in (f, s)
        )
        return (
            f"{self.name:20s} {self.rep:3d} {self.found.seconds:5.1f} s {self.found.speed_m_s:4.1f} m/s: "
            f"flown, foretold {', '.join(sides)}, {self.found.off_share:+4.0%}, "
            f"paths {1e3 * self.found.path_rms_m:4.0f}"
        )


def flight_of(folder: Path, name: str, rep: int, scratch: Path) -> Flight:
    """One recording, imported."""
    out = scratch / f"{name}_{rep}.mcap"
    if not out.exists():
        import_files([folder / f"{name}_rep{rep}.csv"], out, None, lambda _text: None)
    return load(out)


def pooled(found: Sequence[Identified], name: str) -> VehicleProfile:
    """One vehicle of several flights: the median of each figure that is known, and of the hover thrust."""
    base, update = found[0].base, dict[str, Any]({"name": name})
    profiles = [
        (set(VehicleProfile.model_fields) - set(drone.unchanged()), drone.profile(KNOWN_WITHIN)) for drone in found
    ]
    for key in set().union(*(known for known, _ in profiles)) - {"name"}:
        values = np.array([getattr(profile, key) for known, profile in profiles if key in known])
        update[key] = np.median(values, axis=0).tolist()
    mean = base.model_copy(update=update)
    hover = float(np.median([profile.hover_thrust_norm for _, profile in profiles]))  # curve and full thrust make it
    full_n = mean.weight_n * mean.thrust_max_n / mean.thrust_n_of(hover)
    return mean.model_copy(update={"thrust_max_n": full_n})


def foretold(
    folder: Path, flights: Mapping[str, Sequence[int]], vehicle: VehicleProfile, law: str, scratch: Path
) -> list[Row]:
    """Every flight of those, one after the other."""
    rows = list[Row]()
    for name, reps in flights.items():
        for rep in reps:
            flight = flight_of(folder, name, rep, scratch)
            rows.append(Row(name, rep, foretell(flight, vehicle, chosen(str(LAWS / law)))))
    return rows


def judged(title: str, rows: Sequence[Row]) -> Iterator[str]:
    """How many are within WITHIN; the ranks of figures and speeds; how alike the repetitions are."""
    off = np.array([row.found.off_share for row in rows])
    by_name = {row.name: [other for other in rows if other.name == row.name] for row in rows}
    mean = {
        name: [float(np.mean([getattr(row.found, side).rms_m for row in of])) for side in ("flown", "foretold")]
        for name, of in by_name.items()
    }
    rank = float(spearmanr(*np.array(list(mean.values())).T).statistic)
    spread = [
        max(r.found.flown.rms_m for r in of) / min(r.found.flown.rms_m for r in of) - 1.0
        for of in by_name.values()
        if len(of) > 1
    ]
    path_mm = 1e3 * np.median([row.found.path_rms_m for row in rows])
    yield (
        f"{title}: {int((np.abs(off) <= WITHIN).sum())} of {len(rows)} within {WITHIN:.0%}; foretold over flown, "
        f"median {np.median(off):+.0%}, from {off.min():+.0%} to {off.max():+.0%}\n"
        f"  paths {path_mm:.0f} mm from each other; rank correlation of {len(mean)} figures and speeds {rank:.2f}\n"
        f"  the flown repetitions differ by {np.median(spread):.0%} (median), {max(spread):.0%} at most"
    )
    for slow, fast in pairwise(("slow", "medium", "fast")):
        pairs = [
            (mean[name], mean[faster])
            for name in mean
            if name.endswith(slow) and (faster := name.replace(slow, fast)) in mean
        ]
        right = sum((a[0] < b[0]) == (a[1] < b[1]) for a, b in pairs)
        yield f"  {slow} before {fast}: {right} of {len(pairs)} figures in the right order"


def main(folder: Annotated[Path, typer.Argument(help="`datasets/dataset` of syediu/nanobench-iros2026.")]) -> None:
    """Identify the vehicle of the fitted flights; foretell all others."""
    with TemporaryDirectory() as name:
        scratch = Path(name)
        drones = [
            identify(flight_of(folder, figure, rep, scratch), profile(BASE)).drones[0]
            for figure, reps in FITTED.items() for rep in reps
        ]  # fmt: skip
        vehicle = pooled(drones, "nanobench_cf")
        typer.echo(dump_profile(vehicle))
        shares = [drone.response.tilt_share for drone in drones if isinstance(drone.response, Response)]
        typer.echo(f"flown of a commanded tilt: {', '.join(f'{share.value:.3f}' for share in shares)}")
        for title, flights, law in (("PID", FORETOLD_PID, "crazyflie_pid.py"),
                                    ("Mellinger", FORETOLD_MELLINGER, "crazyflie_mellinger.py")):  # fmt: skip
            for of, body in (("identified", vehicle), (BASE, profile(BASE))):
                rows = foretold(folder, flights, body, law, scratch)
                typer.echo("\n".join((*(row.text for row in rows), *judged(f"{title}, {of}", rows))))
        for figure, reps in FITTED.items():
            flight = flight_of(folder, figure, reps[0], scratch)
            for body in (vehicle, profile(BASE)):
                found = foretell(flight, body, chosen("default"))
                typer.echo(f"{figure}, {found.speed_m_s:.1f} m/s, flown {1e3 * found.flown.rms_m:.0f} mm: {found.text}")


if __name__ == "__main__":
    typer.run(main)
