"""Flights of strangers, made here: a drone that circles, its recorders' columns, in the units and axes of each."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from formation.maths import frames
from formation.maths.arrays import Float

RATE_HZ = 100.0
"""Rows a second of every column."""
LAG_S = 0.05
"""The flown attitude is the commanded one so much later."""
BEGIN_S = 1_772_421_798.75


def attitude(t_s: Float) -> Float:
    """q_lab_from_flu (T, 4): it leans by up to 0.2 rad about two axes that change, and turns a little."""
    roll, pitch = 0.2 * np.sin(1.7 * t_s), 0.15 * np.sin(2.9 * t_s + 0.4)
    return frames.from_euler(roll, pitch, 0.3 * np.sin(0.5 * t_s))


def position(t_s: Float) -> Float:
    """pos_lab_m (T, 3)."""
    return np.stack([np.cos(t_s), np.sin(t_s), 1.0 + 0.3 * np.sin(0.7 * t_s)], axis=1)


def times(duration_s: float = 8.0) -> Float:
    return np.arange(0.0, duration_s, 1.0 / RATE_HZ)


def write_csv(path: Path, columns: Mapping[str, Sequence[Any]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


OWN_MAP = """
title = "our lab"
clock = {column = "time", unit = "ms"}
axes = "ned"
body = "kestrel"
signals = [
    {quantity = "position", columns = ["pos_{n,e,d}"], unit = "mm"},
    {quantity = "attitude", columns = ["roll", "pitch", "yaw"], unit = "deg"},
    {quantity = "commanded_attitude", columns = ["cmd_q{w,x,y,z}"]},
    {quantity = "commanded_thrust", columns = ["cmd_u"], unit = "per_mille"},
    {quantity = "rates", columns = ["missing_{x,y,z}"]},
]
"""


def own_csv(path: Path) -> Path:
    """A CSV of nobody's layout: north, east, down, mm and degrees, ms; some positions are missing."""
    t_s = times()
    pos_ned_mm = 1e3 * position(t_s) * [1.0, -1.0, -1.0]
    q, cmd = attitude(t_s), attitude(t_s + LAG_S) * [1.0, 1.0, -1.0, -1.0]
    roll, pitch, yaw = (
        Rotation.from_quat((q * [1.0, 1.0, -1.0, -1.0])[:, [1, 2, 3, 0]]).as_euler("ZYX", degrees=True).T[::-1]
    )
    texts = [[f"{v:.6f}" for v in column] for column in pos_ned_mm.T]
    texts[0][5:8] = ["", "nan", ""]
    return write_csv(
        path,
        {"time": [f"{1e3 * (BEGIN_S + t):.3f}" for t in t_s], "pos_n": texts[0], "pos_e": texts[1], "pos_d": texts[2],
         "roll": roll, "pitch": pitch, "yaw": yaw, **{f"cmd_q{a}": c for a, c in zip("wxyz", cmd.T, strict=True)},
         "cmd_u": np.full(len(t_s), 480.0) + 20.0 * np.sin(t_s), "esc_temp": 40.0 + t_s, "mode": ["auto"] * len(t_s)},
    )  # fmt: skip
