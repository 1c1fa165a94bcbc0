"""A stop beside everything hostile that loopback can carry."""

from pathlib import Path

import pytest

from sim.studies.hostile.lab import keyed_lab
from sim.studies.hostile.stop_flood import Flood, stop_beside
from tests.free_ports import free_port

pytestmark = pytest.mark.processes
COUNT = 30


def test_every_stop_reaches_the_true_ground_beside_theft_and_floods(tmp_path: Path) -> None:
    """300 half-open connections, 1,000 requests a second, a thief.

    How soon is measured by `gcs-sim benchmark security`; a machine that has other work makes no stop wait for good.
    """
    stops = stop_beside(Flood(), COUNT, keyed_lab(tmp_path, free_port()))
    assert stops.answered == COUNT
    assert stops.requests_hz > 20.0  # there was a flood
    assert stops.worst_s < 20.0  # the lock-out after half-open connections lasts 30 s
