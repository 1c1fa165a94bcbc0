"""What `gcs-log whatif` shows: lines for a terminal, and a page with both flights and how far to trust the other."""

from collections.abc import Iterator

import numpy as np
from matplotlib.ticker import FuncFormatter, NullFormatter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis import compare, page
from analysis.page import Section
from analysis.plots import style
from analysis.plots.style import Drawing
from analysis.quantity import FLIGHT, Quantity
from formation.codes import FlightResult
from formation.messages import Phase
from sim.research.recorded import GUST_S
from sim.research.whatif import COMES_BACK, Trust, WhatIf, disturbance, spectrum

QUANTITIES = (*FLIGHT, Quantity("settle_s", "beyond 1 cm, mean", "s"))
COMMANDED = (
    Quantity("tilt_deg", "tilt, largest", "°"),
    Quantity("thrust_norm", "thrust, largest", "0..1"),
    Quantity("speed_m_s", "speed, largest", "m/s"),
    Quantity("chatter_deg", "chatter", "° a frame"),
)
LEAST_HZ, MOST_HZ = 0.1, 50.0


def print_what_if(of: WhatIf, console: Console) -> None:
    """Print numbers and trust."""
    table = Table(box=None, pad_edge=False)
    for name in ("", *(side.name for side in of.sides)):
        table.add_column(Text(name), justify="left" if name == "" else "right")
    for row in _rows(of):
        table.add_row(*row)
    console.print(table)
    for line in lines(of):
        console.print(Text(line))


def lines(of: WhatIf) -> Iterator[str]:
    """How far to trust it, in sentences."""
    share = f"{100 * of.back_share:+.1f} %" if np.isfinite(of.back_share) else "not at all"
    if of.comes_back:
        yield f"The recorded flight comes back under its own law: RMS {share}."
    else:
        most = f"{100 * COMES_BACK:.0f} %"
        yield f"The recorded flight does NOT come back under its own law: RMS {share}, {most} at most. Trust nothing."
    if of.result is FlightResult.ABORTED:
        yield f"The other flight ended after {of.other.flight.duration_s:.1f} s: {of.result}, by a rule of safety."
    for failure in of.other.flight.law_failures.messages:
        yield failure.text
    if of.parts.cut:
        yield f"Flown only up to {of.parts.cut}."
    for trust in of.trust:
        known = ", ".join(f"{hz:.1f}" for hz in trust.known_hz)
        model = "identified in this flight" if trust.identified else "the lab's profile: this flight says too little"
        yield f"{trust.body}: disturbance known up to {known} Hz (x, y, z); vehicle: {model}."
        yield from (f"{trust.body}: {text}." for text in trust.leaves)


def html(of: WhatIf) -> str:
    """The page: the flight flown again beside the other, as any two are compared, and how far to trust the other."""
    with style.styled():
        recorded, again = (compare.flown(side.name, side.flight, k == 0) for k, side in enumerate(of.sides[:2]))
        back, spectra = compare.draw_errors(recorded, again), [_draw_known(of, trust) for trust in of.trust]
    back_text, *others = lines(of)
    figures = page.table(("", *(f"#{side.name}" for side in of.sides)), _rows(of))
    known = page.table(("",), [(line,) for line in others])
    trusted = Section("trust", "How far to trust it", back_text, (back,), parts=(figures, known, _commands(of)))
    lead = (
        "What acted on each follower beside its model, by frequency. Up to the line it is known: what is found above "
        "is mostly the cameras' noise."
    )
    further = (trusted, Section("disturbance", "Disturbance", lead, spectra))
    return compare.html(of.again, of.other, f"{of.name}, flown again: {of.other.name}", further)


def _rows(of: WhatIf) -> Iterator[tuple[str, ...]]:
    for quantity in QUANTITIES:
        yield (
            quantity.heading,
            *(
                "law failed" if side.summary.law_failures else quantity.text(each[quantity.field])
                for side, each in zip(of.sides, of.figures, strict=True)
            ),
        )


def _commands(of: WhatIf) -> page.Table | None:
    rows = [
        (trust.body, quantity.heading, quantity.of(trust.recorded), quantity.of(trust.other))
        for trust in of.trust
        for quantity in COMMANDED
    ]
    return page.table(("follower", "", f"#{of.recorded.name}", f"#{of.other.name}"), rows)


def _draw_known(of: WhatIf, trust: Trust) -> Drawing:
    """The spectrum of one follower's disturbance along each axis, and up to where it is known."""
    drone = of.parts.lab.commanded.index([v.body for v in of.parts.lab.vehicles].index(trust.body))
    values = disturbance(of.parts, drone)
    fig, axes = style.Sheet(2.4, widths=(1.0, 1.0, 1.0), gap_in=(0.14, 0.3), share_y=True).axes()
    t_s = np.linspace(0.0, GUST_S * (len(values) - 1), len(values))
    for axis, (ax, name, known_hz) in enumerate(zip(axes[0], "xyz", trust.known_hz, strict=True)):
        hz, power = spectrum(t_s, values[:, axis : axis + 1])
        shown = (hz >= LEAST_HZ) & (hz <= MOST_HZ)
        ax.loglog(hz[shown], np.sqrt(power[shown] / len(values)), color=style.FOLLOWERS[1], lw=0.8)
        ax.axvspan(LEAST_HZ, min(known_hz, MOST_HZ), color=style.PHASES[Phase.FORMATION], alpha=0.45, lw=0)
        ax.axvline(known_hz, color=style.INK, lw=1.0)
        ax.set(title=f"{trust.body}, {name}", xlabel="Hz", xlim=(LEAST_HZ, MOST_HZ))
        for along in (ax.xaxis, ax.yaxis):
            along.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            along.set_minor_formatter(NullFormatter())
    axes[0][0].set_ylabel("amplitude, m/s²")
    return fig
