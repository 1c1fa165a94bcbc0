"""How often a poor link would be taken for a dead drone: the rules of silence and of late setpoints over hours.

    python -m tools.figures.link_silence --hours 10 --loss 0.05 --jitter-ms 20

A drone's packets at the rates the ground asks for are lost and delayed, in order; prints the longest silence, what
the heartbeat alone would have shown, and for how long at most every setpoint came late.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from formation.safety.rules_table import LATE_SETPOINT_S, SILENT_S, STALE_SETPOINT_S

PERSIST_S = 1.0
CHUNK_S = 600.0


@dataclass(frozen=True, slots=True)
class Heard:
    """Of some hours: silences over the rule's limit, of any packet and of heartbeats; late setpoints, in a row, s."""

    longest_s: float
    silences: int
    heartbeat_silences: int
    late_s: float
    stale_s: float


def heard(hours: float, loss: float, jitter_s: float, rng: np.random.Generator) -> Heard:
    """A 50 Hz attitude and a 1 Hz heartbeat as they arrive; the ages of 100 Hz setpoints, told ten times a second."""
    seconds = hours * 3600.0
    attitude = _arrivals(seconds, 50.0, loss, jitter_s, rng)
    beats = _arrivals(seconds, 1.0, loss, jitter_s, rng)
    together = np.sort(np.concatenate([attitude, beats]))
    gaps, beat_gaps = np.diff(together), np.diff(beats)
    camera_s, link_s = 0.015, 0.005
    sent = np.arange(0.0, seconds, 0.01)
    sent = sent[rng.random(len(sent)) >= loss]
    age = _in_order(sent + link_s + jitter_s * rng.standard_exponential(len(sent))) - sent + camera_s
    told = age[::10]
    return Heard(
        float(gaps.max()), int((gaps > SILENT_S).sum()), int((beat_gaps > SILENT_S).sum()),
        _longest(told > LATE_SETPOINT_S) * 0.1, _longest(told > STALE_SETPOINT_S) * 0.1,
    )  # fmt: skip


def _arrivals(seconds: float, rate_hz: float, loss: float, jitter_s: float, rng: np.random.Generator) -> np.ndarray:
    sent = np.arange(0.0, seconds, 1.0 / rate_hz)
    sent = sent[rng.random(len(sent)) >= loss]
    return _in_order(sent + jitter_s * rng.standard_exponential(len(sent)))


def _in_order(arrival_s: np.ndarray) -> np.ndarray:
    return np.maximum.accumulate(arrival_s)


def _longest(late: np.ndarray) -> int:
    """The most in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], late.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def main() -> None:
    """Listen for as long as the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--jitter-ms", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    got = heard(asked.hours, asked.loss, asked.jitter_ms * 1e-3, np.random.default_rng(asked.seed))
    print(
        f"{asked.hours:g} h: longest silence {got.longest_s:.2f} s, {got.silences} over {SILENT_S:g} s; of heartbeats ",
        end="",
    )
    print(
        f"alone {got.heartbeat_silences}; setpoints late for {got.late_s:.1f} s, stale for {got.stale_s:.1f} s at most"
    )


if __name__ == "__main__":
    main()
