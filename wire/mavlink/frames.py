"""The MAVLink of many datagrams at once: all frames in one table, and the fields of one message as columns."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.maths.frames import IDENTITY
from wire.columns import Index, windows
from wire.link_messages import BROADCAST, DRONE_COMPONENT, Ignore, MessageId
from wire.mavlink.framing import FrameCutter, Layout, field_codes
from wire.mavlink.messages import READERS, SET_ATTITUDE_TARGET

_TABLE = np.dtype(
    [
        ("datagram", "i8"), ("start", "i8"), ("stop", "i8"), ("payload", "i8"), ("size", "i8"), ("number", "u4"),
        ("system", "u1"), ("component", "u1"), ("seq", "u1"),
    ]
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames (F,) in the order of their datagrams.

    table: of each frame `datagram`, which one holds it; `start` and `stop`, where in `data` it is, and `payload` and
    `size`, where its payload is; `number`, its message's id; `system`, `component` and `seq`, its sender and number.
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
        data, bounds = self.data, zip(self["start"].tolist(), self["stop"].tolist(), strict=True)
        return (data[start:stop] for start, stop in bounds)

    def fields(self, layout: Layout) -> list[NDArray[Any]]:
        """Every field (F,) of what are frames of one message, in the order of its documentation."""
        codes = [each for code in field_codes(layout.payload.format) for each in _single(code)]
        dtype = np.dtype([(str(k), f"<{code}") for k, code in enumerate(codes)])
        rows = np.zeros((len(self), dtype.itemsize), np.uint8)
        data, starts, sizes = np.frombuffer(self.data, np.uint8), self["payload"], self["size"]
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


def frames_in(datagrams: Iterable[bytes]) -> Frames:
    """All frames of datagrams, as a codec finds them."""
    cut, frames, rows, start = FrameCutter().cut, list[bytes](), list[tuple[int, ...]](), 0
    for k, datagram in enumerate(datagrams):
        for frame in cut(datagram):
            stop, size = start + len(frame.data), len(frame.payload)
            rows.append((k, start, stop, start + frame.head, size, frame.number, *frame.source, frame.seq))
            frames.append(frame.data)
            start = stop
    return Frames(b"".join(frames), np.array(rows, _TABLE))


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


def named_values(frames: Frames, name: str) -> Float:
    """Every NAMED_VALUE_FLOAT of that name."""
    _, names, values = frames.of(MessageId.NAMED_VALUE_FLOAT).fields(READERS[MessageId.NAMED_VALUE_FLOAT][0])
    return np.asarray(values[names == name.encode()], np.float64)
