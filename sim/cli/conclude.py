"""The end of every run: its log becomes numbers and a page."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis import metrics, report
from analysis.load import Flight, load_checked
from analysis.metrics import Summary
from formation.codes import FlightResult, Outcome
from formation.messages import Phase
from wire.files import new_file, recorded
from wire.logs.views import AGE_NAME
from wire.mavlink.frames import named_values
from wire.process.daemon import LATE_NS

LATELY_S = 2.0
"""A flight that ended this soon after the machine was late ended for that."""


def conclude(
    mcap: Path,
    outcome: Outcome,
    realtime_factor: float | None = None,
    speed: float | None = None,
    overwrite: bool = False,
) -> tuple[Flight, Summary]:
    """Write the report beside the log; the flight and its numbers.

    The outcome has the failures that the host saw beside those in the log. speed: of a flight by real processes, which
    is `starved` where the machine was too late for it. overwrite: a page that is there.
    """
    mcap = recorded(mcap)
    flight, checked = load_checked(mcap)
    with new_file(mcap.with_name("report.html"), overwrite) as page:
        summary = metrics.summarise(flight, mcap=mcap, report=page, realtime_factor=realtime_factor)
        joined = _joined(outcome, summary.outcome)
        summary = replace(summary, outcome=joined if speed is None else _starved(joined, flight, speed))
        report.write(flight, summary, page, "" if checked.complete else checked.damage)
    return flight, summary


def _starved(outcome: Outcome, flight: Flight, speed: float) -> Outcome:
    """The outcome, `starved` where a simulator was later than it may be just before the flight was aborted; with the
    speed at which it would not have been."""
    result, reason = outcome.result, outcome.reason
    ends_s = [span.start_s for span in flight.spans(Phase.LAND)] or [flight.duration_s]
    late_s = _latest_s(flight, ends_s[0])
    aborted = result is FlightResult.ABORTED
    if result is not FlightResult.STARVED and (not aborted or late_s <= LATE_NS * 1e-9):
        return outcome
    if aborted:
        reason = (
            f"poses, control cycles or setpoints were {1e3 * late_s:.0f} ms late, the machine is too slow ({reason})"
        )
    fitting = min(0.35, 0.5 * LATE_NS * 1e-9 / max(late_s, 1e-3)) * speed
    return Outcome(FlightResult.STARVED, f"{reason}; fly with --speed {max(fitting, 0.01):.2g}")


def _latest_s(flight: Flight, end_s: float) -> float:
    """How late, beyond what is usual, poses, cycles and setpoints were about end_s; these by the drones' own report.

    A drone's process that is late shows its pose too seldom for the cameras: it looks like a body that is not seen.
    """
    delays_s = flight.poses.received_s - flight.poses.t_s
    lately = (flight.poses.received_s > end_s - LATELY_S) & (flight.poses.received_s <= end_s + LATELY_S)
    cycles = flight.timing.where(np.abs(flight.timing.t_s - end_s) < LATELY_S)
    pose_s = float((delays_s[lately] - np.median(delays_s)).max()) if lately.any() else 0.0
    reported, ages_ms = named_values(flight.up.frames, AGE_NAME)
    old_ms = ages_ms[np.abs(flight.up.t_s[reported["datagram"]] - end_s) < LATELY_S]
    setpoint_s = 1e-3 * float(old_ms.max() - np.median(ages_ms)) if old_ms.size else 0.0
    return max(pose_s, setpoint_s, float(cycles["latency_s"].max(initial=0.0)))


def _joined(host: Outcome, log: Outcome) -> Outcome:
    """The outcome by the host and by the log: the worse of the two, with both reasons."""
    if host.result is FlightResult.STARVED or (not host.is_good and log.is_good):
        return host
    if host.result is FlightResult.ABORTED and log.result in (FlightResult.LOST, FlightResult.CUT):
        return Outcome(log.result, f"{host.reason}; {log.reason}")
    return log
