"""Pictures of a flight: each function draws one figure from a flight, or says what the log lacks for it."""

from analysis.load import Flight
from analysis.plots import control, motion, style
from analysis.plots.style import Drawing
from analysis.tracking import Tracking, track_leader


def drawings(flight: Flight, tracking: Tracking) -> dict[str, tuple[Drawing, ...]]:
    """Every picture of the report, by section."""
    leader = track_leader(flight)
    with style.styled():
        return {
            "timeline": (style.timeline(flight),),
            "paths": (motion.where(flight), motion.heights(flight)),
            "leader": (motion.leader_error(flight, leader), motion.leader_positions(flight)),
            "error": (motion.errors(flight, tracking),),
            "clouds": (motion.clouds(flight, tracking),),
            "positions": (motion.positions(flight, tracking),),
            "sliding": (control.sliding(flight), control.disturbance(flight)),
            "output": (control.output(flight),),
            "attitude": (control.attitude(flight, tracking),),
            "link": (control.link(flight),),
            "timing": (control.histograms(flight), control.cycles(flight)),
        }
