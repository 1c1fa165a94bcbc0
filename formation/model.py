"""What every configuration model is made of: frozen pydantic, unknown keys refused; types of its texts and numbers."""

import re
from math import hypot
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from formation.requests import SYSID_MOST

LARGEST, SMALLEST = 1e6, 1e-9
"""No length, time, angle or mass of a lab is larger, and none that has to be there is smaller."""


class WrongKeyError(ValueError):
    """A rule of a whole table, and which of its keys breaks it: `key`, from the table on; value: as the file has it."""

    def __init__(self, key: str, text: str, value: object = None) -> None:
        super().__init__(text)
        self.key, self.value = key, value


def _no_flag(value: object) -> object:
    """`true` is no number, though Python takes it for 1, nor is "1", though pydantic does."""
    if isinstance(value, bool | str):
        raise ValueError("a number is wanted" + (", without quotes" if isinstance(value, str) else ""))
    return value


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"too small: {SMALLEST:g} at least")
    return value


NoFlag = BeforeValidator(_no_flag)
Flag = Annotated[bool, Field(strict=True)]
"""True or false, and neither "no" nor 0."""
Number = Annotated[float, NoFlag, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, NoFlag, Field(gt=0.0, le=LARGEST), AfterValidator(_not_tiny)]
Vec3Tuple = tuple[Number, Number, Number]
QuatTuple = tuple[Number, Number, Number, Number]
LONGEST_NAME = 64


def _name(text: str) -> str:
    if re.fullmatch(r"[A-Za-z0-9_.-]+", text) is None or not text.strip(".") or len(text) > LONGEST_NAME:
        raise ValueError(f"not a name: at most {LONGEST_NAME} letters, digits and . _ -")
    return text


Name = Annotated[str, AfterValidator(_name)]
"""What may stand in a file's name, a key on the bus, a terminal and a page as it is."""
SysId = Annotated[int, NoFlag, Field(ge=1, le=SYSID_MOST)]
NO_ROTATION: QuatTuple = (1.0, 0.0, 0.0, 0.0)


class Model(BaseModel):
    """Frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


UNIT_WITHIN = 0.01
"""How far a quaternion's length may be off 1: what is written with three decimals is near enough."""
TILT_MOST_RAD = 1.2  # safety cuts a drone's motors at 1.3 rad
PORT_MOST = 65_535


def _unit(q: QuatTuple) -> QuatTuple:
    length = hypot(*q)
    if abs(length - 1.0) > UNIT_WITHIN:
        raise ValueError(f"not a rotation: its length is {length:.3f}, not 1 (within {UNIT_WITHIN:g})")
    return q


def _tilt(angle_rad: float) -> float:
    if angle_rad > TILT_MOST_RAD:
        raise ValueError(f"radians are meant, {TILT_MOST_RAD:g} at most")
    return angle_rad


def _globe(origin: Vec3Tuple) -> Vec3Tuple:
    latitude, longitude, altitude_m = origin
    if abs(latitude) > 90.0 or abs(longitude) > 180.0 or not -500.0 <= altitude_m <= 9000.0:
        raise ValueError("not a place on the globe: latitude and longitude in degrees, altitude in metres")
    return origin


def _own_link(text: str) -> str:
    found = re.fullmatch(r"(udp|udpin|udpout):[^:\s]+:(\d{1,5})", text)
    if found is None:
        raise ValueError("not udp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT")
    _demand_port(found[2], least=1)
    _host(text.split(":")[1])
    return text


def _endpoint(text: str) -> str:
    if re.fullmatch(r"[a-z-]+/\S+", text) is None:
        raise ValueError("not an endpoint such as tcp/127.0.0.1:7447")
    protocol, _, address = text.partition("/")
    if protocol not in _WITH_PORT:
        return text
    found = re.fullmatch(r"(\[[0-9a-fA-F:.%]+\]|[^:/\s]+):(\d{1,5})([?#]\S*)?", address)
    if found is None:
        raise ValueError("not an endpoint such as tcp/127.0.0.1:7447")
    _demand_port(found[2], least=0)
    if not found[1].startswith("["):
        _host(found[1])
    return text


def _host(text: str) -> str:
    if re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?", text) is None:
        raise ValueError("not the name or the IPv4 address of a host")
    numbers = text.split(".")
    is_meant = all(number.isdecimal() for number in numbers) or (len(numbers) == 4 and numbers[0].isdecimal())
    if is_meant and (len(numbers) != 4 or any(not n.isdecimal() or int(n) > 255 for n in numbers)):
        raise ValueError("not an IPv4 address: four numbers up to 255, no letters")
    return text


def _demand_port(text: str, least: int) -> None:
    if not least <= int(text) <= PORT_MOST:
        raise ValueError(f"port {text} is not within {least} to {PORT_MOST}")


_WITH_PORT = ("tcp", "udp", "tls", "quic", "ws")

UnitQuat = Annotated[QuatTuple, AfterValidator(_unit)]
Tilt = Annotated[Positive, AfterValidator(_tilt)]
GlobePoint = Annotated[Vec3Tuple, AfterValidator(_globe)]
OwnLink = Annotated[str, AfterValidator(_own_link)]
Endpoint = Annotated[str, AfterValidator(_endpoint)]
Host = Annotated[str, AfterValidator(_host)]
PortBase = Annotated[int, NoFlag, Field(ge=1024, le=PORT_MOST - SYSID_MOST)]
