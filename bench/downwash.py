"""`python -m bench.downwash FOLDER`: the two numbers of `formation.vehicle.downwash`, fitted to flights and judged.

FOLDER: `data/training` of https://github.com/aerorobotics/neural-swarm (Shi et al., Neural-Swarm, ICRA 2020), which has
no licence file: fetch it yourself. Measured is its authors' force: mass times accelerometer less the thrust that they
identified by PWM and voltage, behind their lag; here less its median in that flight while nobody is above, which is the
thrust map's error of that battery. Flights with CF100, whose accelerometer they warn of, are left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from formation.maths.arrays import Bool, Float
from formation.vehicle.body import rotor_reach_m
from formation.vehicle.downwash import FIRST_WIDTH, jet_force_n

G_M_S2, FULL_V, STEP_S = 9.81, 4.2, 0.01
THRUST_SHARE = 0.16  # of the authors' lag, a sample
FLYING_M, FREE_M, FREE_SAMPLES = 0.25, 0.25, 100
BELOW_M, FIT_ASIDE_M, JUDGED_ASIDE_M = (0.1, 1.0), 0.3, 0.1
FIT = [f"datacollection21_06_16_2020/swap_{pair}" for pair in ("ss", "sl", "ll")]
"""Of these runs of even number are fitted; all other `swap` flights, and these of odd number, are judged."""
WIDTHS = np.arange(0.8, 1.6, 0.01)


@dataclass(frozen=True, slots=True)
class Kind:
    """A vehicle of these flights. thrust_g: by PWM share p and battery share v of each motor, 1, p, v, p^2, p v."""

    mass_kg: float
    wheelbase_m: float
    rotor_m: float
    thrust_g: tuple[float, float, float, float, float]


SMALL = Kind(0.034, 0.092, 0.0225, (11.093358, -39.081042, -9.525648, 20.573302, 38.428851))
LARGE = Kind(0.067, 0.1248, 0.033, (44.103866, -122.511518, -36.184843, 53.107726, 107.681926))
"""On the frame and motors of a Parrot Mambo: arms of 62.4 mm, rotors of 33 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Below:
    """A vehicle's samples: force (T,), and those above it: kind, aside, below, thrust, each (T,)."""

    kind: Kind
    lost_n: Float
    above: list[tuple[Kind, Float, Float, Float]]

    def modelled_n(self, first_width: float = FIRST_WIDTH) -> Float:
        """The model's force with that first width, N."""
        jets = [
            np.vectorize(jet_force_n)(
                aside, below, thrust_n, first_width / FIRST_WIDTH * rotor_reach_m(upper.wheelbase_m),
                rotor_reach_m(self.kind.wheelbase_m), self.kind.rotor_m,
            )
            for upper, aside, below, thrust_n in self.above
        ]  # fmt: skip
        total: Float = np.sum(jets, axis=0)
        return total

    def near(self, aside_m: float) -> Bool:
        """At which samples somebody is above, so far aside at most (T,)."""
        low, high = BELOW_M
        is_near: Bool = np.any([(aside < aside_m) & (low < z) & (z < high) for _, aside, z, _ in self.above], axis=0)
        return is_near


def read(path: Path) -> tuple[Kind, Float, Float]:
    """A vehicle's own log: kind, times, s, (T,), and x, y, z, m, force by the air along z and thrust, N, (T, 5)."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    kind, pwm, share = LARGE if path.name.startswith("cf1") else SMALL, table[:, 18:22], table[:, 22:23] / FULL_V
    c = kind.thrust_g
    thrust_n = 1e-3 * G_M_S2 * (c[0] + c[1] * pwm + c[2] * share + c[3] * pwm**2 + c[4] * share * pwm).sum(axis=1)
    for k in range(1, len(thrust_n)):
        thrust_n[k] = thrust_n[k - 1] + THRUST_SHARE * (thrust_n[k] - thrust_n[k - 1])
    upright = 1.0 - 2.0 * (table[:, 10] ** 2 + table[:, 11] ** 2)
    force_n = kind.mass_kg * table[:, 9] - thrust_n * upright
    return kind, 1e-6 * (table[:, 0] - table[0, 0]), np.column_stack([table[:, 1:4], force_n, thrust_n])


def flight(files: Sequence[Path]) -> Iterator[Below]:
    """One flight's vehicles, each with what was above it."""
    logs = [read(path) for path in files]
    t_s = np.arange(0.0, min(times[-1] for _, times, _ in logs), STEP_S)
    grid = [np.column_stack([np.interp(t_s, times, column) for column in each.T]) for _, times, each in logs]
    for (kind, _, _), own in zip(logs, grid, strict=True):
        others = [
            # What a vehicle gives the air is the thrust that it has, not what its motors would have given in still air.
            (upper, np.hypot(*(other - own)[:, :2].T), other[:, 2] - own[:, 2], other[:, 3] + other[:, 4])
            for (upper, _, _), other in zip(logs, grid, strict=True) if other is not own
        ]  # fmt: skip
        flies = own[:, 2] > FLYING_M
        free = flies & np.all([(z < 0.0) | (aside > FREE_M) for _, aside, z, _ in others], axis=0)
        if np.count_nonzero(free) >= FREE_SAMPLES:
            lost_n = np.median(own[free, 3]) - own[flies, 3]
            yield Below(kind, lost_n, [(k, a[flies], z[flies], lift_n[flies]) for k, a, z, lift_n in others])


def flights(folder: Path, odd: bool | None = None) -> list[Below]:
    """All flights of a folder, or those of odd or even number."""
    runs: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("cf*_*.csv")):
        runs.setdefault(path.stem.partition("_")[2], []).append(path)
    return [
        below
        for run, files in runs.items()
        if len(files) > 1 and odd in (None, bool(int(run) % 2)) and not any("cf100" in f.name for f in files)
        for below in flight(files)
    ]


def fit(fitted: Sequence[Below]) -> tuple[float, float]:
    """The first width, and the factor on the force, that fit best; pairs of each kind count alike."""
    near = [below.near(FIT_ASIDE_M) for below in fitted]
    pairs = [(below.kind.mass_kg, below.above[0][0].mass_kg) for below in fitted]
    share = [1.0 / (b.kind.mass_kg**2 * sum(n.sum() for n, p in zip(near, pairs, strict=True) if p == pair))
             for b, pair in zip(fitted, pairs, strict=True)]  # fmt: skip
    best = (np.inf, 0.0, 0.0)
    for width in WIDTHS:
        model = [below.modelled_n(width)[n] for below, n in zip(fitted, near, strict=True)]
        lost = [below.lost_n[n] for below, n in zip(fitted, near, strict=True)]
        cross = sum(s * float(m @ y) for s, m, y in zip(share, model, lost, strict=True))
        square = sum(s * float(m @ m) for s, m in zip(share, model, strict=True))
        missed = -cross * cross / square
        best = min(best, (missed, float(width), cross / square))
    return best[1], best[2]


def judge(name: str, judged: Sequence[Below]) -> Iterator[str]:
    """A line for each kind of lower vehicle: mean force measured and modelled, where somebody is right above."""
    for kind, what in ((SMALL, "34 g"), (LARGE, "67 g")):
        each = [(below.lost_n[n], below.modelled_n()[n]) for below in judged if below.kind is kind
                if (n := below.near(JUDGED_ASIDE_M)).any()]  # fmt: skip
        if each:
            lost, model = (1e3 * np.concatenate(values) for values in zip(*each, strict=True))
            weight, r = 1e3 * G_M_S2 * kind.mass_kg, np.corrcoef(lost, model)[0, 1]
            yield (
                f"{name:42s} {what}: {STEP_S * len(lost):6.1f} s, measured {lost.mean():6.1f} mN "
                f"({lost.mean() / weight:4.0%}), modelled {model.mean():6.1f}, {model.mean() / lost.mean():.2f} of it, "
                f"correlation {r:.2f}"
            )


def main(folder: Annotated[Path, typer.Argument(help="`data/training` of aerorobotics/neural-swarm.")]) -> None:
    """Fit to the even runs of three folders; judge all other swap flights there are."""
    fitted = [(name, flights(folder / name, odd=False)) for name in FIT]
    width, factor = fit([below for _, each in fitted for below in each])
    typer.echo(f"first width {width:.2f} reaches, force times {factor:.3f}")
    for name, each in fitted:
        typer.echo("\n".join(judge(f"fit    {name}", each)))
    for path in sorted(folder.glob("*/swap_*")):
        name = f"{path.parent.name}/{path.name}"
        typer.echo("\n".join(judge(f"judged {name}", flights(path, odd=True if name in FIT else None))))


if __name__ == "__main__":
    typer.run(main)
