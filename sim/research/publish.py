"""A paper's figures, table, numbers and facts, made of flight logs: vectors in a column's width, and LaTeX.

Everything stands in files of one folder; nothing in them but what the logs say.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure

from analysis.load import Flight, load
from analysis.metrics import Summary, summarise
from analysis.plots import style
from analysis.plots.motion import paths_m
from analysis.quantity import FLIGHT
from analysis.tracking import track
from formation.messages import Phase
from wire import version
from wire.files import sha256_of
from wire.logs.mcap_scan import LogError

COLUMN_MM, MM_IN = 88.9, 25.4
LOG = "flight.mcap"
DIGITS = ("Zero", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
SPECIAL = re.compile(r"[\\{}$&#^_~%]")


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One flight of the paper: its name, its log, and what that says."""

    name: str
    path: Path
    flight: Flight
    summary: Summary

    @property
    def command(self) -> str:
        """Its name as LaTeX's commands can have it: Latin letters alone, others spelled by their code points."""
        spelled = re.sub(r"[^\W\d_]", lambda found: found[0] if found[0].isascii() else f" u{ord(found[0])}", self.name)
        words = re.findall(r"[A-Za-z]+|[0-9]", spelled)
        return "".join(DIGITS[int(word)] if word.isdigit() else word[0].upper() + word[1:] for word in words)


def shown(source: Path) -> Shown:
    """The flight in a folder or a log's file; OSError, LogError."""
    path = source / LOG if source.is_dir() else source
    name = path.resolve().parent.name if path.name == LOG else path.stem
    flight = load(path)
    if not flight.spans(Phase.FORMATION):
        raise LogError(f"{path}: no flight in formation")
    return Shown(name, path, flight, summarise(flight, mcap=path))


def write(flights: Sequence[Shown], folder: Path, width_mm: float = COLUMN_MM) -> list[Path]:
    """Every file, into a folder that is there; OSError. LogError where two flights would have one name in LaTeX."""
    commands = [each.command for each in flights]
    if twice := {command for command in commands if commands.count(command) > 1}:
        raise LogError(f"two flights are called {min(twice)}: name their folders otherwise")
    texts = {
        "table.tex": table(flights),
        "numbers.tex": numbers(flights),
        "methods.tex": methods(flights),
        "CITATION.cff": citation(flights),
        "hashes.txt": "".join(f"{sha256_of(each.path)}  {each.path}\n" for each in flights),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [*(path for each in flights for path in _draw(each, folder, width_mm)), *(folder / name for name in texts)]


def table(flights: Iterable[Shown]) -> str:
    """A row a flight, for booktabs."""
    head = ("flight", *(quantity.heading for quantity in FLIGHT))
    return tabular(head, [(each.name, *(quantity.of(each.summary) for quantity in FLIGHT)) for each in flights])


def tabular(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of plain texts, numbers behind its first column; it needs booktabs."""
    first, *others = (" & ".join(map(_plain, cells)) + r" \\" for cells in (head, *rows))
    lines = ("\\toprule", first, "\\midrule", *others, "\\bottomrule")
    return "\n".join((f"\\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}", *lines, "\\end{tabular}", ""))


def numbers(flights: Iterable[Shown]) -> str:
    """Each number of each flight as a command, in millimetres."""
    return "".join(
        f"\\newcommand{{\\{each.command}{quantity.name.title().replace(' ', '')}}}{{{quantity.of(each.summary)}}}\n"
        for each in flights
        for quantity in FLIGHT
        if getattr(each.summary, quantity.field) is not None
    )


def methods(flights: Sequence[Shown]) -> str:
    """A paragraph of facts, a sentence or two a flight."""
    return " ".join(sentence for each in flights for sentence in _facts(each)) + "\n"


def citation(flights: Sequence[Shown]) -> str:
    """The software that flew, in the Citation File Format."""
    metadata = [each.flight.run.metadata for each in flights]
    flown_by, commit = min((of.get("version", version.VERSION), of.get("commit", "")) for of in metadata)
    lines = (
        "cff-version: 1.2.0",
        "message: Cite the software that flew.",
        "type: software",
        "title: mavlink-formation",
        f'version: "{flown_by}"',
        *([f'commit: "{commit}"'] if commit else []),
        "license: MIT",
        "authors:",
        "  - name: The mavlink-formation authors",
    )
    return "\n".join(lines) + "\n"


def _facts(each: Shown) -> Iterator[str]:
    flight, lab = each.flight, each.flight.run.lab
    poses = flight.poses
    rate_hz = 1.0 / float(np.median(np.diff(poses.t_s)))
    delay_ms = 1e3 * float(np.median(poses.received_s - poses.t_s))
    how = "simulated in lockstep" if flight.run.lockstep else "flown in real time"
    yield f"The flight \\emph{{{_plain(each.name)}}} had {len(flight.followers)} follower(s) and was {how}."
    yield f"Cameras: {rate_hz:.0f}~Hz, {delay_ms:.1f}~ms from exposure to control."
    if lab is None:
        return
    kinds = {vehicle.profile: lab.profile_of(vehicle) for vehicle in lab.vehicles if vehicle.sysid is not None}
    for name, kind in kinds.items():
        dead_ms, lag_ms = 1e3 * kind.response_dead_time_s, 1e3 * kind.response_lag_s
        yield f"Vehicle \\texttt{{{_plain(name)}}}: {1e3 * kind.mass_kg:.0f}~g."
        yield f"Its attitude answers after {dead_ms:.0f}~ms of dead time with a lag of {lag_ms:.0f}~ms."
    law = lab.control_law.name if lab.control_law is not None else f"preset {lab.control_preset}"
    gains = "; ".join(f"{key} = {value:.4g}" for key, value in _gains(flight, next(iter(kinds), "")).items())
    yield f"Control law: {_plain(law)}" + (f" ({_plain(gains)})." if gains else ".")
    if flight.run.versions:
        yield f"Software: {_plain(flight.run.versions)}."


def _gains(flight: Flight, profile: str) -> Mapping[str, float]:
    """The numbers of the followers' law, as they were used."""
    try:
        law = json.loads(flight.run.metadata.get("gains", "{}"))[profile]["follower"]
    except (KeyError, TypeError, json.JSONDecodeError):
        return {}
    return {key: value for key, value in law.items() if isinstance(value, float) and value != 0.0}


def _plain(text: str) -> str:
    """As LaTeX prints it."""
    return SPECIAL.sub(
        lambda found: {"\\": r"\textbackslash{}", "^": r"\^{}", "~": r"\~{}"}.get(found[0], f"\\{found[0]}"), text
    )


def _draw(each: Shown, folder: Path, width_mm: float) -> Iterator[Path]:
    with style.styled():
        drawn = {"error": _error(each, width_mm), "paths": _paths(each, width_mm)}
    for name, figure in drawn.items():
        yield from save(figure, folder / f"{each.name}-{name}")


def save(figure: Figure, stem: Path) -> tuple[Path, Path]:
    """Write a figure as PDF and SVG, and say where."""
    files = stem.with_name(f"{stem.name}.pdf"), stem.with_name(f"{stem.name}.svg")  # names may have dots
    # TrueType, as journals take fonts; Matplotlib's own choice, Type 3, many reject.
    with style.styled(), mpl.rc_context({"pdf.fonttype": 42}):
        FigureCanvasPdf(figure)
        figure.savefig(files[0], metadata={"CreationDate": None})
        figure.savefig(files[1], metadata={"Date": None})
    return files


def _figure(width_mm: float, tall: float) -> Figure:
    return Figure(figsize=(width_mm / MM_IN, tall * width_mm / MM_IN), layout="constrained")


def _error(each: Shown, width_mm: float) -> Figure:
    """Each follower's distance from its slot against the time in formation."""
    figure, tracking = _figure(width_mm, 0.62), track(each.flight)
    ax = figure.subplots()
    start_s = each.flight.spans(Phase.FORMATION)[0].start_s
    colours = style.colours(len(each.flight.vehicles))[1:]
    for k, (follower, colour) in enumerate(zip(each.flight.followers, colours, strict=True)):
        values = style.broken(1e3 * np.linalg.norm(tracking.error_lead_m[:, k], axis=-1), tracking.formed[:, k])
        style.line(ax, tracking.t_s - start_s, values, color=colour, lw=0.8, label=follower.body)
    ax.set(xlabel="time in formation, s", ylabel="formation error, mm", ylim=(0.0, None), xlim=(0.0, None))
    style.legend(ax)
    return figure


def _paths(each: Shown, width_mm: float) -> Figure:
    """Every vehicle's way in formation, from above."""
    figure, vehicles = _figure(width_mm, 1.0), each.flight.vehicles
    ax = figure.subplots()
    for vehicle, colour, path_m in zip(vehicles, style.colours(len(vehicles)), paths_m(each.flight), strict=True):
        ax.plot(*path_m.T, color=colour, lw=0.8, label=vehicle.body)
    ax.set(xlabel="lab x, m", ylabel="lab y, m")
    ax.set_aspect("equal", adjustable="datalim")
    style.legend(ax)
    return figure
