"""Maps: which column of a file is which of our quantities, in which unit and axes. TOML, the shipped ones too."""

import itertools
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from formation.model import Model, Name, WrongKeyError
from formation.names import unknown
from wire.config_file import load
from wire.errors import ConfigError

SHIPPED = Path(__file__).parent / "maps"


class Kind(Enum):
    """What a quantity's numbers are, and so how axes turn them."""

    WORLD = auto()
    BODY = auto()
    ATTITUDE = auto()
    HEADING = auto()
    SCALAR = auto()


@dataclass(frozen=True, slots=True)
class Quantity:
    """One of ours. name: as tables have it, with frame and unit; units: what a map may call one of the file's, and how
    many of ours that is; any: of any number of columns."""

    name: str
    kind: Kind
    units: Mapping[str, float]
    any: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of its numbers in tables."""
        parts = {Kind.WORLD: "xyz", Kind.BODY: "xyz", Kind.ATTITUDE: "wxyz"}.get(self.kind)
        return tuple(f"{self.name}_{part}" for part in parts) if parts else (self.name,)


GRAVITY = 9.80665
_DEG = math.pi / 180.0
LENGTH = {"m": 1.0, "cm": 0.01, "mm": 0.001}
SPEED = {f"{unit}/s": size for unit, size in LENGTH.items()}
ACCELERATION = {"m/s2": 1.0, "mm/s2": 0.001, "g": GRAVITY, "mg": 0.001 * GRAVITY}
ANGLE = {"rad": 1.0, "mrad": 0.001, "deg": _DEG}
RATE = {f"{unit}/s": size for unit, size in ANGLE.items()}
SHARE = {"1": 1.0, "%": 0.01, "per_mille": 0.001, "u16": 1.0 / 65535.0, "us": 0.001}
"""`us`: pulses from 1000 us, none, to 2000 us, full."""
PULSE_NONE = -1.0
VOLTAGE, CURRENT = {"V": 1.0, "mV": 0.001}, {"A": 1.0, "mA": 0.001}
QUANTITIES: Mapping[str, Quantity] = MappingProxyType({
    "position": Quantity("pos_lab_m", Kind.WORLD, LENGTH),
    "attitude": Quantity("q_lab_from_flu", Kind.ATTITUDE, ANGLE),
    "velocity": Quantity("vel_lab_m_s", Kind.WORLD, SPEED),
    "rates": Quantity("rate_flu_rad_s", Kind.BODY, RATE),
    "acceleration": Quantity("specific_force_flu_m_s2", Kind.BODY, ACCELERATION),
    "commanded_attitude": Quantity("commanded_q_lab_from_flu", Kind.ATTITUDE, ANGLE),
    "commanded_rates": Quantity("commanded_rate_flu_rad_s", Kind.BODY, RATE),
    "commanded_thrust": Quantity("commanded_thrust_norm", Kind.SCALAR, SHARE),
    "motors": Quantity("motor_norm", Kind.SCALAR, SHARE, any=True),
    "battery_voltage": Quantity("battery_v", Kind.SCALAR, VOLTAGE),
    "battery_current": Quantity("battery_a", Kind.SCALAR, CURRENT),
    "estimated_position": Quantity("estimated_pos_lab_m", Kind.WORLD, LENGTH),
    "estimated_velocity": Quantity("estimated_vel_lab_m_s", Kind.WORLD, SPEED),
    "estimated_attitude": Quantity("estimated_q_lab_from_flu", Kind.ATTITUDE, ANGLE),
    "innovation_position": Quantity("innovation_pos_lab_m", Kind.WORLD, LENGTH),
    "innovation_velocity": Quantity("innovation_vel_lab_m_s", Kind.WORLD, SPEED),
    "innovation_heading": Quantity("innovation_heading_rad", Kind.HEADING, ANGLE),
    "reference_position": Quantity("reference_pos_lab_m", Kind.WORLD, LENGTH),
    "reference_velocity": Quantity("reference_vel_lab_m_s", Kind.WORLD, SPEED),
    "reference_heading": Quantity("reference_heading_rad", Kind.HEADING, ANGLE),
})  # fmt: skip
"""By the name that a map gives them."""
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def _expanded(names: tuple[str, ...]) -> tuple[str, ...]:
    """`a_{x,y}` is `a_x` and `a_y`."""
    found = list[str]()
    for name in names:
        parts = re.split(r"\{([^{}]*)\}", name)
        choices = [part.split(",") if k % 2 else [part] for k, part in enumerate(parts)]
        found += ["".join(each) for each in itertools.product(*choices)]
    return tuple(found)


Columns = Annotated[tuple[str, ...], AfterValidator(_expanded), Field(min_length=1, max_length=64)]


class Signal(Model):
    """One quantity of the file: its columns in order, `-name` for one of the other sign, `name_{x,y,z}` for several.

    Of several entries for a quantity the first whose columns are there, and hold numbers, is taken.
    """

    quantity: str
    columns: Columns
    unit: str = ""
    """Of the columns; without it ours."""
    axes: Literal["lab", "ned"] | None = None
    order: Literal["wxyz", "xyzw"] = "wxyz"
    """Of a quaternion's columns."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.quantity not in QUANTITIES:
            raise WrongKeyError("quantity", f"is none of {', '.join(QUANTITIES)}", self.quantity)
        of, count = QUANTITIES[self.quantity], len(self.columns)
        if self.unit and self.unit not in of.units:
            raise WrongKeyError("unit", f"{unknown(self.unit, of.units)}", self.unit)
        wanted = (3, 4) if of.kind is Kind.ATTITUDE else (len(of.names),)
        if not of.any and count not in wanted:
            text = "roll, pitch, yaw or a quaternion" if of.kind is Kind.ATTITUDE else f"{wanted[0]} columns"
            raise WrongKeyError("columns", f"{self.quantity} has {text}, here are {count}")
        return self


class Clock(Model):
    """The column of a CSV that has the stamps."""

    column: str
    unit: Literal["s", "ms", "us", "ns"] = "s"


class ImportMap(Model):
    """One layout of files. kind, known_by: the format and the columns by which a shipped one is recognised.

    axes: of every signal that says no other. `lab` is z up with bodies forward, left, up (ROS and most cameras); `ned`
    is down with forward, right, down.
    """

    title: Annotated[str, Field(max_length=80)] = "your map"
    kind: str = "CSV"
    known_by: Annotated[tuple[str, ...], AfterValidator(_expanded)] = ()
    clock: Clock | None = None
    axes: Literal["lab", "ned"] = "lab"
    body: Name | None = None
    """Name of the vehicle; without it the file's."""
    signals: tuple[Signal, ...] = ()


def read_map(path: Path) -> ImportMap:
    """The map in a file; ConfigError."""
    return load(path, ImportMap)


def map_of(path: Path, kind: str, columns: Collection[str]) -> ImportMap:
    """The shipped map that knows these columns of a file; ConfigError that names what there is."""
    for shipped in sorted(SHIPPED.glob("*.toml")):
        found = read_map(shipped)
        if found.kind == kind and set(found.known_by) <= set(columns):
            return found
    shown = ", ".join(itertools.islice(columns, 8))
    raise ConfigError([f"{path}: no shipped map knows its columns ({shown}, ...): write one, see --map"])
