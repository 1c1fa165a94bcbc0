"""What `gcs mocap` shows on a terminal, from the state that its process publishes."""

from typing import Any

import pytest
from rich.console import Console

from formation.messages import Event, Severity
from mocap.daemon import LiveTable, mocap_view

STATE: dict[str, Any] = {
    "source": "natnet", "server": "Motive 3.1 at 10.0.0.2", "connected": True, "lost": 3, "frames": 1200, "refused": 0,
    "rejected": {"left": {"FREEZE": 7}}, "latency_ms": 4.2, "uncertainty_ms": 0.31, "latency_measured": True,
    "timing": {"rate_hz": 119.98, "jitter_s": 0.0002, "lost_share": 0.0025, "delay_s": 0.0052, "gap_s": 0.0167,
               "arrival_stamps": False},
    "retimed_scatter_s": None,
    "body_figures": [
        {"body": "left", "seen_share": 0.995, "gap_s": 0.025, "noise_m": 0.00012, "pos_lab_m": (1.0, -0.5, 0.25),
         "yaw_rad": 1.5707963267948966},
        {"body": "right", "seen_share": 0.0, "gap_s": 2.0, "noise_m": None, "pos_lab_m": None, "yaw_rad": None},
    ],
}  # fmt: skip


def shown(state: dict[str, Any]) -> str:
    console = Console(width=120, force_terminal=False)
    with console.capture() as captured:
        console.print(mocap_view(state))
    return captured.get()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"latency_measured": False}, "apart from the constant"),
        ({"latency_ms": None}, "delay_s is used"),
        ({"timing": STATE["timing"] | {"arrival_stamps": True}}, "stamps are arrival times"),
        ({"retimed_scatter_s": 0.00021}, "re-timed, with a scatter of 0.21 ms"),
        ({"timing": None}, "no frames"),
    ],
)
def test_what_is_out_of_the_ordinary_is_named(change: dict[str, Any], words: str) -> None:
    assert words in shown(STATE | change)
    assert words not in shown(STATE)


def test_every_figure_is_there_with_its_unit() -> None:
    text = shown(STATE)
    for part in ("natnet Motive 3.1 at 10.0.0.2: 120.0 Hz", "jitter 0.20 ms", "longest gap 17 ms",
                 "lost 0.2% (3 in all)",
                 "latency 4.2 ms, uncertain by 0.31 ms", "exposure to receipt 5.2 ms", "99.5%", "0.12 mm", "90.0 deg",
                 "not seen"):  # fmt: skip
        assert part in text, part
    left = next(line for line in text.splitlines() if line.startswith("left"))
    assert left.split()[-1] == "7"
    assert max(map(len, text.splitlines())) <= 120


def test_words_from_outside_are_never_markup() -> None:
    console = Console(width=120, force_terminal=False)
    with console.capture() as captured, LiveTable(console) as table:
        table.print_event(Event(Severity.WARNING, "vrpn", "a body called [/] or [red]x"))
        table.show(STATE)
    assert "a body called [/] or [red]x" in captured.get()
