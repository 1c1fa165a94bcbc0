"""The MAVLink of many datagrams at once: all frames in one table, and the fields of one message as columns."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.maths.frames import IDENTITY
from wire.columns import Bytes, Index, windows
from wire.link_messages import BROADCAST, DRONE_COMPONENT, Ignore, MessageId
from wire.mavlink.framing import (
    CRC_EXTRA,
    FRAMES_MOST,
    LARGEST_DATAGRAM,
    MAGIC_2,
    SIGNATURE_BYTES,
    SIGNED,
    FrameCutter,
    Layout,
    field_codes,
)
from wire.mavlink.messages import READERS, SET_ATTITUDE_TARGET

_TABLE = np.dtype(
    [
        ("datagram", "u4"), ("number", "u4"), ("start", "i8"), ("length", "u2"), ("head", "u1"), ("size", "u1"),
        ("system", "u1"), ("component", "u1"), ("seq", "u1"),
    ]
)  # fmt: skip


_HEAD = np.dtype(
    [
        ("magic", "u1"), ("size", "u1"), ("flags", "u1"), ("compatible", "u1"), ("seq", "u1"), ("system", "u1"),
        ("component", "u1"), ("low", "<u2"), ("high", "u1"),
    ]
)  # fmt: skip
_LEAST = _HEAD.itemsize + 2
"""Bytes of a frame without payload."""
_BYTE = np.arange(256) ^ np.arange(256) << 4 & 0xFF
_CRC = (_BYTE << 8 ^ _BYTE << 3 ^ _BYTE >> 4).astype(np.uint16)
"""CRC-16/MCRF4XX of one byte."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames (F,) in the order of their datagrams.

    table: of each frame `datagram`, which one holds it; `start`, where in `data` it is, and its `length`, of which
    `head` come before the `size` of its payload; `number`, its message's id; `system`, `component` and `seq`.
    """

    data: bytes
    table: NDArray[Any]

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, name: str) -> Index:
        return np.asarray(self.table[name], np.int64)

    def where(self, chosen: Bool) -> "Frames":
        """Some of them; chosen (F,)."""
        return Frames(self.data, self.table[chosen])

    def of(self, *numbers: int) -> "Frames":
        """Those of some messages."""
        return self.where(np.isin(self["number"], numbers))

    def each(self) -> Iterator[bytes]:
        """One by one."""
        data, starts = self.data, self["start"]
        bounds = zip(starts.tolist(), (starts + self["length"]).tolist(), strict=True)
        return (data[start:stop] for start, stop in bounds)

    def fields(self, layout: Layout) -> list[NDArray[Any]]:
        """Every field (F,) of what are frames of one message, in the order of its documentation."""
        codes = [each for code in field_codes(layout.payload.format) for each in _single(code)]
        dtype = np.dtype([(str(k), f"<{code}") for k, code in enumerate(codes)])
        rows = np.zeros((len(self), dtype.itemsize), np.uint8)
        data, starts, sizes = np.frombuffer(self.data, np.uint8), self["start"] + self["head"], self["size"]
        for size in np.unique(sizes[sizes > 0]).tolist():
            at, width = np.flatnonzero(sizes == size), min(size, dtype.itemsize)
            rows[at, :width] = windows(data, width)[starts[at]].view(np.uint8).reshape(-1, width)
        table = rows.view(dtype)[:, 0]
        return list(layout.from_wire(tuple(_wide(table[name]) for name in dtype.names or ())))


def _single(code: str) -> list[str]:
    """ "4f" -> "f", "f", "f", "f"; "10s" -> "S10"."""
    kind, count = code[-1], int(code[:-1] or 1)
    return [f"S{count}"] if kind == "s" else [kind] * count


def _wide(column: NDArray[Any]) -> NDArray[Any]:
    """Numbers as Python has them."""
    return column if column.dtype.kind == "S" else column.astype(np.float64 if column.dtype.kind == "f" else np.int64)


def frames_in(data: Bytes, lengths: Index) -> Frames:
    """All frames of datagrams (D,), as a codec finds them. data: theirs, end to end; lengths: of each.

    Datagrams of nothing but MAVLink 2, nearly all, are cut together, the others one by one.
    """
    whole, stops = data.tobytes(), np.cumsum(lengths)
    at, is_regular, parts = stops - lengths, np.ones(len(lengths), np.bool_), list[NDArray[Any]]()
    left = np.flatnonzero((lengths > 0) & (lengths <= LARGEST_DATAGRAM))
    for _ in range(FRAMES_MOST):
        is_sound, part = _next_frames(data, left, at[left], stops[left])
        is_regular[left[~is_sound]] = False
        parts.append(part)
        left = left[is_sound]
        at[left] += part["length"]
        left = left[at[left] < stops[left]]
    frames, rows, start = [whole], list[tuple[int, ...]](), len(whole)
    for k in np.flatnonzero(~is_regular).tolist():
        for frame in FrameCutter().cut(whole[stops[k] - lengths[k] : stops[k]]):
            length, size = len(frame.data), len(frame.payload)
            rows.append((k, frame.number, start, length, frame.head, size, *frame.source, frame.seq))
            frames.append(frame.data)
            start += length
    table = np.concatenate([*(part[is_regular[part["datagram"]]] for part in parts), np.array(rows, _TABLE)])
    return Frames(b"".join(frames), table[np.argsort(table["datagram"], kind="stable")])


def _next_frames(data: Bytes, datagrams: Index, at: Index, stops: Index) -> tuple[Bool, NDArray[Any]]:
    """Of each datagram whether a sound frame of MAVLink 2 starts at `at`; and those frames."""
    index = np.flatnonzero(stops - at >= _LEAST)
    heads = windows(data, _HEAD.itemsize)[at[index]].view(_HEAD)
    lengths = _LEAST + heads["size"].astype(np.int64) + SIGNATURE_BYTES * (heads["flags"] == SIGNED)
    whole = (heads["magic"] == MAGIC_2) & (heads["flags"] <= SIGNED) & (at[index] + lengths <= stops[index])
    index, heads = index[whole], heads[whole]
    table = np.empty(len(index), _TABLE)
    table["datagram"], table["start"], table["length"], table["head"] = (
        datagrams[index],
        at[index],
        lengths[whole],
        _HEAD.itemsize,
    )
    table["number"] = heads["low"] | heads["high"].astype(np.int64) << 16
    for name in ("size", "system", "component", "seq"):
        table[name] = heads[name]
    is_sealed = _are_sealed(data, table)
    is_sound = np.zeros(len(datagrams), np.bool_)
    is_sound[index[is_sealed]] = True
    return is_sound, table[is_sealed]


def _are_sealed(data: Bytes, table: NDArray[Any]) -> Bool:
    """Whose checksum, CRC-16/MCRF4XX, is right; False of a message that is in no dialect of ours."""
    seeds = np.array([CRC_EXTRA.get(number, -1) for number in table["number"].tolist()], np.int64)
    crc, sealed = np.full(len(table), 0xFFFF, np.uint16), np.zeros(len(table), np.uint16)
    for size in np.unique(table["size"]).tolist():
        of_size = table["size"] == size
        columns = windows(data, _LEAST + size)[table["start"][of_size]].view(np.uint8).reshape(-1, _LEAST + size).T
        found = crc[of_size]
        for byte in (*columns[1:-2], seeds[of_size].astype(np.uint8)):
            found = found >> 8 ^ _CRC[(found ^ byte) & 0xFF]
        crc[of_size], sealed[of_size] = found, columns[-2] | columns[-1].astype(np.uint16) << 8
    is_sealed: Bool = (crc == sealed) & (seeds >= 0)
    return is_sealed


@dataclass(frozen=True, slots=True, eq=False)
class Setpoints:
    """SET_ATTITUDE_TARGET (S,), as AttitudeSetpoint has each. datagram: which one holds it."""

    datagram: Index
    t_boot_ms: Index
    ignore: Index
    q_lab_from_flu: Float
    rate_flu_rad_s: Float
    thrust_norm: Float


def setpoints(frames: Frames, sysids: Index) -> Setpoints:
    """Those that their drones read. sysids: of the datagrams, for whom each is."""
    frames = frames.of(SET_ATTITUDE_TARGET.id)
    t_boot_ms, system, component, mask, w, x, y, z, p, q, r, thrust = frames.fields(SET_ATTITUDE_TARGET)
    without = (mask & Ignore.ATTITUDE) != 0
    attitude, is_rotation = _attitudes(w, x, y, z)
    attitude[without] = IDENTITY
    p, q, r = (np.where(mask & bit, 0.0, rate) for bit, rate in ((1, p), (2, q), (4, r)))
    thrust = np.where(mask & Ignore.THRUST, 0.0, thrust)
    read: Bool = (without | is_rotation) & np.isfinite([p, q, r, thrust]).all(axis=0)
    read &= np.isin(system, BROADCAST) | (system == sysids[frames["datagram"]])
    read &= np.isin(component, (BROADCAST, DRONE_COMPONENT))
    rate = np.stack([p, 0.0 - q, 0.0 - r], axis=-1)
    return Setpoints(frames["datagram"][read], t_boot_ms[read], mask[read], attitude[read], rate[read], thrust[read])


def _attitudes(w: Float, x: Float, y: Float, z: Float) -> tuple[Float, Bool]:
    """q_lab_from_flu (F, 4), unit and w >= 0, of q_ned_from_frd; and whose are rotations."""
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    is_rotation: Bool = (norm > 1e-3) & (norm < 1e3)
    scale = np.where(w < 0.0, -1.0, 1.0) / np.where(is_rotation, norm, 1.0)
    return np.stack([w * scale, x * scale, 0.0 - y * scale, 0.0 - z * scale], axis=-1), is_rotation


def stamps(frames: Frames) -> tuple[Frames, Index]:
    """The attitudes and positions that drones report, ATTITUDE_QUATERNION and LOCAL_POSITION_NED, and the time of each,
    ms since the drone booted."""
    read, t_boot_ms = np.zeros(len(frames), np.bool_), np.zeros(len(frames), np.int64)
    reported = frames["number"] == MessageId.ATTITUDE_QUATERNION
    t_boot_ms[reported], w, x, y, z, *_ = frames.where(reported).fields(READERS[MessageId.ATTITUDE_QUATERNION][0])
    read[reported] = _attitudes(w, x, y, z)[1]
    reported = frames["number"] == MessageId.LOCAL_POSITION_NED
    t_boot_ms[reported], x, y, z, *_ = frames.where(reported).fields(READERS[MessageId.LOCAL_POSITION_NED][0])
    read[reported] = np.isfinite([x, y, z]).all(axis=0)
    return frames.where(read), t_boot_ms[read]


def named_values(frames: Frames, name: str) -> tuple[Frames, Float]:
    """Every NAMED_VALUE_FLOAT of that name, and its value."""
    frames = frames.of(MessageId.NAMED_VALUE_FLOAT)
    _, names, values = frames.fields(READERS[MessageId.NAMED_VALUE_FLOAT][0])
    named: Bool = names == name.encode()
    return frames.where(named), values[named]
