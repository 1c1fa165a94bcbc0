"""Flights of strangers, made here: a drone that circles, its recorders' columns, in the units and axes of each."""

import csv
import json
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from formation.maths import frames
from formation.maths.arrays import Float
from wire.columns import Index

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


def neural_fly(folder: Path, duration_s: float = 8.0) -> Path:
    """Its columns of lists."""
    t_s = times(duration_s)
    q, lists = attitude(t_s)[:, [1, 2, 3, 0]], lambda rows: [json.dumps(row) for row in rows.tolist()]
    return write_csv(
        folder / "fly.csv",
        {"": range(len(t_s)), "t": t_s, "p": lists(position(t_s)), "p_d": lists(position(t_s) + 0.03), "q": lists(q),
         "T_sp": lists(0.5 + 0.01 * np.sin(t_s)[:, None]), "q_sp": lists(q), "fa": lists(position(t_s)),
         "hover_throttle": lists(np.full((len(t_s), 1), 0.5)),
         "pwm": lists(1500.0 + np.sin(t_s)[:, None] * np.ones(4))},
    )  # fmt: skip


Columns = Mapping[str, Float]


def px4_tables(duration_s: float = 8.0) -> dict[str, Columns]:
    """What PX4 logs, in NED and FRD: topic, field, values. Arrays are named `q[0]`."""
    t_s = times(duration_s)
    turn = np.array([1.0, -1.0, -1.0])
    pos, q, cmd = position(t_s) * turn, attitude(t_s) * [1.0, *turn], attitude(t_s + LAG_S) * [1.0, *turn]
    nan = np.full(len(t_s), np.nan)
    return {
        "vehicle_local_position": dict(zip("xyz", pos.T, strict=True)),
        "vehicle_attitude": {f"q[{k}]": part for k, part in enumerate(q.T)},
        "vehicle_attitude_setpoint": {f"q_d[{k}]": part for k, part in enumerate(cmd.T)}
        | {"thrust_body[0]": 0.0 * t_s, "thrust_body[1]": 0.0 * t_s, "thrust_body[2]": -0.48 - 0.02 * np.sin(t_s)},
        "trajectory_setpoint": {f"position[{k}]": nan if k else part for k, part in enumerate(pos.T)},
        "cpuload": {"load": 0.3 + 0.1 * np.sin(t_s)},
    }


def ulog(tables: Mapping[str, Columns], begin_us: int = 5_000_000, stamps_us: Index | None = None) -> bytes:
    """A ULog of these topics: its header and flags, formats of floats, subscriptions, rows by their stamps, a text.

    https://docs.px4.io/main/en/dev_log/ulog_file_format.html
    """

    def message(kind: bytes, data: bytes) -> bytes:
        return struct.pack("<Hc", len(data), kind) + data

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", begin_us) + message(b"B", bytes(40))
    out += message(b"P", b"\x12int32_t MAV_SYS_ID" + struct.pack("<i", 7))
    rows = list[tuple[int, bytes]]()
    for number, (topic, columns) in enumerate(tables.items()):
        fields = dict.fromkeys(name.partition("[")[0] for name in columns)
        counts = {name: sum(each.startswith(f"{name}[") for each in columns) for name in fields}
        text = "".join(f"float[{count}] {name};" if count else f"float {name};" for name, count in counts.items())
        out += message(b"F", f"{topic}:uint64_t timestamp;{text}".encode())
        data = np.stack(list(columns.values()), axis=1).astype("<f4")
        t_us = (
            begin_us + np.rint(1e6 / RATE_HZ * np.arange(len(data))).astype(np.int64)
            if stamps_us is None
            else stamps_us
        )
        rows += [
            (t, message(b"D", struct.pack("<HQ", number, t) + row.tobytes()))
            for t, row in zip(t_us.tolist(), data, strict=True)
        ]
    out += b"".join(message(b"A", struct.pack("<BH", 0, k) + topic.encode()) for k, topic in enumerate(tables))
    out += message(b"L", b"4" + struct.pack("<Q", begin_us) + b"low battery")
    return out + b"".join(row for _, row in sorted(rows))


def ardupilot_tables(duration_s: float = 8.0) -> dict[str, Columns]:
    """What ArduPilot logs, in NED, FRD and degrees, pulses in us; the second battery is an instance."""
    t_s = times(duration_s)
    turn = np.array([1.0, -1.0, -1.0])

    def angles(q: Float) -> Float:
        return Rotation.from_quat((q * [1.0, *turn])[:, [1, 2, 3, 0]]).as_euler("ZYX", degrees=True).T[::-1]

    names = ("Roll", "Pitch", "Yaw")
    return {
        "XKF1": dict(zip(("PN", "PE", "PD"), (position(t_s) * turn).T, strict=True)),
        "ATT": dict(zip(names, angles(attitude(t_s)), strict=True))
        | {f"Des{name}": part for name, part in zip(names, angles(attitude(t_s + LAG_S)), strict=True)},
        "CTUN": {"ThO": 0.48 + 0.02 * np.sin(t_s)},
        "RCOU": {f"C{k}": 1500.0 + 10.0 * np.sin(t_s) for k in (1, 2, 3, 4)},
        "BAT": {"Inst": np.arange(len(t_s)) % 2.0, "Volt": 12.0 + 0.01 * t_s},
    }


def dataflash(tables: Mapping[str, Columns], begin_us: int = 5_000_000) -> bytes:
    """A DataFlash log of these messages: FMT of each, units that name BAT's instance, rows by their stamps, texts.

    https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
    """

    def fmt(kind: int, size: int, name: str, formats: str, columns: str) -> bytes:
        return struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, kind, size, *map(str.encode, (name, formats, columns)))

    def packed(kind: int, layout: str, *values: Any) -> bytes:
        return struct.pack(f"<BBB{layout}", 0xA3, 0x95, kind, *values)

    out = fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    out += fmt(129, 44, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    out += fmt(130, 75, "MSG", "QZ", "TimeUS,Message") + fmt(131, 31, "PARM", "QNf", "TimeUS,Name,Value")
    rows = list[tuple[int, bytes]]()
    for kind, (name, columns) in enumerate(tables.items(), 140):
        formats = "".join("B" if column == "Inst" else "f" for column in columns)
        size = 3 + 8 + struct.calcsize(f"<{formats}")
        out += fmt(kind, size, name, f"Q{formats}", ",".join(("TimeUS", *columns)))
        if "Inst" in columns:
            out += packed(129, "QB16s16s", 0, kind, b"s#v", b"F--")
        for k, values in enumerate(zip(*columns.values(), strict=True)):
            cells = [int(v) if f == "B" else float(v) for v, f in zip(values, formats, strict=True)]
            t_us = begin_us + round(1e6 * k / RATE_HZ)
            rows.append((t_us, packed(kind, f"Q{formats}", t_us, *cells)))
    out += packed(131, "Q16sf", begin_us, b"SYSID_THISMAV", 7.0) + packed(130, "Q64s", begin_us, b"low battery")
    return out + b"".join(row for _, row in sorted(rows, key=lambda row: row[0]))


def crazyflie_tables(duration_s: float = 8.0) -> dict[str, Columns]:
    """What a Crazyflie logs on its card: metres, degrees with pitch the other way round, thrust of 65535."""
    t_s = times(duration_s)
    cmd = Rotation.from_quat(attitude(t_s + LAG_S)[:, [1, 2, 3, 0]]).as_euler("ZYX", degrees=True).T[::-1]
    signed = zip(("roll", "pitch", "yaw"), (1.0, -1.0, 1.0), cmd, strict=True)
    return {
        "fixedFrequency": {f"stateEstimate.{a}": part for a, part in zip("xyz", position(t_s).T, strict=True)}
        | {f"stateEstimate.q{a}": part for a, part in zip("wxyz", attitude(t_s).T, strict=True)}
        | {f"controller.{name}": sign * part for name, sign, part in signed}
        | {"controller.cmd_thrust": 65535.0 * (0.48 + 0.02 * np.sin(t_s))},
        "estTDOA": {"distanceDiff": np.sin(t_s)},
    }


def crazyflie(tables: Mapping[str, Columns], begin_us: int = 5_000_000, version: int = 2) -> bytes:
    """A log of its SD card deck, as Bitcraze's `usddeck.c` writes one."""
    out = b"\xbc" + struct.pack("<HH", version, len(tables))
    rows = list[tuple[int, bytes]]()
    for number, (event, columns) in enumerate(tables.items()):
        out += struct.pack("<H", number) + event.encode() + b"\0" + struct.pack("<H", len(columns))
        out += b"".join(f"{name}(f)".encode() + b"\0" for name in columns)
        for k, values in enumerate(zip(*columns.values(), strict=True)):
            t_us = begin_us + round(1e6 * k / RATE_HZ)
            stamp = struct.pack("<HQ", number, t_us) if version == 2 else struct.pack("<HI", number, t_us // 1000)
            rows.append((t_us, stamp + np.array(values, "<f4").tobytes()))
    out += b"".join(row for _, row in sorted(rows, key=lambda row: row[0]))
    return out + struct.pack("<I", zlib.crc32(out))


FORMATS: Mapping[str, tuple[str, Callable[[float], bytes]]] = {
    "ULog": ("ulg", lambda duration_s: ulog(px4_tables(duration_s))),
    "DataFlash": ("bin", lambda duration_s: dataflash(ardupilot_tables(duration_s))),
    "Crazyflie": ("log", lambda duration_s: crazyflie(crazyflie_tables(duration_s))),
}
"""By the format's name: a file's ending, and the flight in it."""
