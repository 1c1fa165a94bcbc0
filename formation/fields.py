"""Field types of the configuration: texts and numbers that are judged by themselves, wherever they are written."""

import re
from math import hypot
from typing import Annotated

from pydantic import AfterValidator, Field

from formation.model import NoFlag, Positive, QuatTuple, Vec3Tuple

UNIT_WITHIN = 0.01
"""How far a quaternion's length may be off 1: what is written with three decimals is near enough."""
TILT_MOST_RAD = 1.2  # safety cuts a drone's motors at 1.3 rad
PORT_MOST, SYSID_MOST = 65_535, 250


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
