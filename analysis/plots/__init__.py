"""Pictures of a flight: each function draws one figure from a flight, or says what the log lacks for it."""

from analysis.load import Flight
from analysis.plots import bands, control, link, paths, slots, style, timing
from analysis.plots.style import Drawing
from analysis.tracking import Tracking, track_leader


def drawings(flight: Flight, tracking: Tracking) -> dict[str, tuple[Drawing, ...]]:
    """Every picture of the report, by section."""
    leader = track_leader(flight)
    with style.styled():
        return {
            "timeline": (bands.timeline(flight),),
            "paths": (paths.where(flight), paths.heights(flight)),
            "leader": (slots.leader_error(flight, leader), slots.leader_positions(flight)),
            "error": (slots.errors(flight, tracking),),
            "clouds": (slots.clouds(flight, tracking),),
            "positions": (slots.positions(flight, tracking),),
            "sliding": (control.sliding(flight), control.disturbance(flight)),
            "output": (control.output(flight),),
            "attitude": (control.attitude(flight, tracking),),
            "link": (link.link(flight),),
            "timing": (timing.histograms(flight), timing.cycles(flight)),
        }
