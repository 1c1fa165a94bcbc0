"""The lab on the globe: a flat patch around its origin, for peers that think in latitude and longitude."""

from math import cos, pi, radians

from formation.model import Vec3Tuple

EARTH_RADIUS_M = 6_378_137.0
"""Of the sphere that the Earth is taken for: WGS84's equatorial radius."""
_M_PER_DEG = EARTH_RADIUS_M * pi / 180.0


def to_globe(origin: Vec3Tuple, pos_lab_m: Vec3Tuple) -> Vec3Tuple:
    """Latitude and longitude, degrees, and altitude, m, of a place in `lab` (x north, y west)."""
    lat, lon, alt = origin
    x, y, z = pos_lab_m
    return lat + x / _M_PER_DEG, lon - y / (_M_PER_DEG * cos(radians(lat))), alt + z


def from_globe(origin: Vec3Tuple, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """x and y in `lab` of a latitude and longitude, degrees."""
    lat, lon, _ = origin
    return (lat_deg - lat) * _M_PER_DEG, (lon - lon_deg) * _M_PER_DEG * cos(radians(lat))
