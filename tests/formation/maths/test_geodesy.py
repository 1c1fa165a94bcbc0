"""The lab on the globe, against the arc that a degree is."""

from math import pi

import pytest

from formation.maths.geodesy import EARTH_RADIUS_M, from_globe, to_globe

ORIGIN = (60.0, 8.0, 400.0)


def test_north_is_x_and_west_is_y() -> None:
    quarter_m = 0.5 * pi * EARTH_RADIUS_M  # of a meridian: ninety degrees
    lat_deg, lon_deg, alt_m = to_globe(ORIGIN, (quarter_m / 90.0, 0.5 * quarter_m / 90.0, 2.0))
    assert lat_deg == pytest.approx(61.0, abs=1e-12)
    assert lon_deg == pytest.approx(7.0, abs=1e-9)  # cos 60 is a half
    assert alt_m == 402.0


def test_there_and_back() -> None:
    lat_deg, lon_deg, _ = to_globe(ORIGIN, (3.0, -4.0, 1.0))
    assert from_globe(ORIGIN, lat_deg, lon_deg) == pytest.approx((3.0, -4.0), abs=1e-7)
