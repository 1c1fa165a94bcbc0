"""QTM's packets as it writes them, in either byte order. Source: QTM RT protocol documentation. Pure."""

import struct
from collections.abc import Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.messages import RawFrame
from sim.cameras.servers.matrices import matrices

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT, DISCOVER = 0, 1, 2, 3, 4, 6, 7
CONNECTED, SETTINGS_CHANGED, SHUTTING_DOWN = 1, 11, 12
COMPONENTS = {"6d": 5, "6deuler": 6, "6dres": 11, "6deulerres": 12}
"""The component's type by what StreamFrames calls it, in small letters."""
RESIDUAL_MM = 0.4
EULER_FROM, ATTRIBUTES_FROM = 16, 21
"""Minor versions from which on the 6D parameters name the angles, and from which on most of them are attributes."""


def packet(order: str, kind: int, data: bytes = b"") -> bytes:
    """Header and data; order: "<" or ">"."""
    return struct.pack(order + "II", 8 + len(data), kind) + data


def text(order: str, kind: int, words: str) -> bytes:
    """A command's answer, an error or XML."""
    return packet(order, kind, words.encode() + b"\0")


def data_packet(order: str, stamp_us: int, number: int, components: Sequence[bytes]) -> bytes:
    """One exposure."""
    head = struct.pack(order + "qII", stamp_us, number & 0xFFFFFFFF, len(components))
    return packet(order, DATA, head + b"".join(components))


def six_d(order: str, kind: int, frame: RawFrame) -> bytes:
    """A 6DOF component of `kind`: millimetres, matrices column by column or Euler angles; NaN for a lost body."""
    matrix = matrices(frame.q_mocap_from_marker)
    turn = euler_deg(matrix) if kind in (6, 12) else np.swapaxes(matrix, 1, 2).reshape(-1, 9)
    columns = [1000.0 * frame.pos_mocap_m, turn]
    if kind in (11, 12):
        columns.append(np.full((len(frame.bodies), 1), RESIDUAL_MM))
    rows: NDArray[np.float64] = np.concatenate(columns, axis=1)
    rows[~frame.seen] = np.nan
    body = rows.astype(order + "f4").tobytes()
    return struct.pack(order + "IIihh", 16 + len(body), kind, len(frame.bodies), 0, 0) + body


def euler_deg(matrix: Float) -> Float:
    """Roll, pitch and yaw of Rx Ry Rz, QTM's standard, degrees; (n, 3, 3) to (n, 3)."""
    pitch = np.arcsin(np.clip(matrix[:, 0, 2], -1.0, 1.0))
    roll = np.arctan2(-matrix[:, 1, 2], matrix[:, 2, 2])
    yaw = np.arctan2(-matrix[:, 0, 1], matrix[:, 0, 0])
    angles: Float = np.degrees(np.stack([roll, pitch, yaw], axis=1))
    return angles


def parameters_6d(minor: int, bodies: Sequence[str]) -> str:
    """The 6D parameters as the protocol's version 1.`minor` writes them."""
    body = _body_of_attributes if minor >= ATTRIBUTES_FROM else _body_of_elements
    head = "" if minor >= ATTRIBUTES_FROM else f"<Bodies>{len(bodies)}</Bodies>"
    euler = "<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>"
    inside = head + "".join(body(name) for name in bodies) + (euler if EULER_FROM <= minor < ATTRIBUTES_FROM else "")
    name = f"QTM_Parameters_Ver_1.{minor}"
    return f"<{name}><The_6D>{inside}</The_6D></{name}>"


def parameters_general(minor: int, rate_hz: float) -> str:
    """The general parameters, as far as clients of bodies look at them."""
    name = f"QTM_Parameters_Ver_1.{minor}"
    return f"<{name}><General><Frequency>{rate_hz:g}</Frequency></General></{name}>"


def _body_of_elements(name: str) -> str:
    points = "".join(f"<Point><X>{x}</X><Y>{y}</Y><Z>0</Z></Point>" for x, y in ((0, 0), (60, 0), (0, 90)))
    return f"<Body><Name>{escape(name)}</Name><RGBColor>16711680</RGBColor>{points}</Body>"


def _body_of_attributes(name: str) -> str:
    points = "".join(
        f'<Point X="{x}" Y="{y}" Z="0" Virtual="0" PhysicalId="0" Name={quoteattr(f"{name} - {k}")}/>'
        for k, (x, y) in enumerate(((0, 0), (60, 0), (0, 90)), 1)
    )
    cells = " ".join(f'R{i}{j}="{int(i == j)}"' for i in (1, 2, 3) for j in (1, 2, 3))
    return (
        f'<Body><Name>{escape(name)}</Name><Enabled>true</Enabled><Color R="0" G="0" B="255"/>'
        "<MaximumResidual>10</MaximumResidual><MinimumMarkersInBody>3</MinimumMarkersInBody>"
        '<BoneLengthTolerance>5</BoneLengthTolerance><Filter Preset="No filter"/>'
        f"<Points>{points}</Points>"
        '<Data_origin X="0" Y="0" Z="0" Relative_body="1">0</Data_origin>'
        f'<Data_orientation {cells} Relative_body="1">0</Data_orientation></Body>'
    )
