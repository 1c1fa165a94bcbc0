"""What `gcs mocap` shows while it runs: one line of the whole stream, one line a body, ten times a second at most."""

from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from formation.messages import Event
from wire.process.program import COLOURS

COLUMNS = ("body", "seen", "longest gap", "noise at rest", "x", "y", "z", "yaw", "rejected")
_MS, _MM, _DEGREES = 1e3, 1e3, 57.29577951308232


class LiveTable:
    """A context: `show` the state that the mocap process publishes, `tell` its events above it."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=False)

    def __enter__(self) -> "LiveTable":
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def print_event(self, event: Event) -> None:
        """One line that stays."""
        style = COLOURS.get(event.severity.name, "")
        self._console.print(Text(f"{event.source}: {event.text}", style), highlight=False)

    def show(self, state: dict[str, Any]) -> None:
        """The newest."""
        self._live.update(mocap_view(state), refresh=True)


def mocap_view(state: dict[str, Any]) -> Group:
    """The published state for people."""
    return Group(Text(_stream(state)), Text(_clock(state)), *map(Text, _stamps(state)), _bodies(state))


def _stream(state: dict[str, Any]) -> str:
    where = f"{state['source']} {state['server']}".strip()
    timing = state["timing"]
    if timing is None:
        return f"{where}: no frames"
    return (
        f"{where}: {timing['rate_hz']:.1f} Hz, jitter {_MS * timing['jitter_s']:.2f} ms, "
        f"longest gap {_MS * timing['gap_s']:.0f} ms, lost {timing['lost_share']:.1%} ({state['lost']} in all), "
        f"{state['frames']} frames, {state['refused']} refused"
    )


def _clock(state: dict[str, Any]) -> str:
    timing = state["timing"]
    clock = "no exposure times reported: delay_s is used" if state["latency_ms"] is None else ""
    if not clock:
        constant = "" if state["latency_measured"] else ", apart from the constant that latency_s says"
        clock = f"latency {state['latency_ms']:.1f} ms, uncertain by {state['uncertainty_ms'] or 0.0:.2f} ms{constant}"
    delay = "" if timing is None else f"exposure to receipt {_MS * timing['delay_s']:.1f} ms (median); "
    return delay + clock


def _stamps(state: dict[str, Any]) -> tuple[str, ...]:
    """The line about stamps that are no exposures, if there is one."""
    if state["retimed_scatter_s"] is not None:
        scatter_ms = _MS * state["retimed_scatter_s"]
        return (f"stamps are arrival times: frames are re-timed, with a scatter of {scatter_ms:.2f} ms",)
    timing = state["timing"]
    return () if timing is None or not timing["arrival_stamps"] else ("stamps are arrival times",)


def _bodies(state: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in COLUMNS:
        table.add_column(column, no_wrap=True, justify="left" if column == "body" else "right")
    rejected = state["rejected"]
    for body in state["body_figures"]:
        table.add_row(*map(Text, (*_figures(body), str(sum(rejected.get(body["body"], {}).values())))))
    return table


def _figures(body: dict[str, Any]) -> tuple[str, ...]:
    if body["pos_lab_m"] is None:
        return body["body"], "not seen", *["-"] * 6
    noise = "moves" if body["noise_m"] is None else f"{_MM * body['noise_m']:.2f} mm"
    yaw = "-" if body["yaw_rad"] is None else f"{_DEGREES * body['yaw_rad']:.1f} deg"
    where = (f"{x:.3f}" for x in body["pos_lab_m"])
    return body["body"], f"{body['seen_share']:.1%}", f"{_MS * body['gap_s']:.0f} ms", noise, *where, yaw
