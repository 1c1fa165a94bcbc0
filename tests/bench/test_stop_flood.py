"""A stop beside everything hostile that loopback can carry."""

from pathlib import Path

import pytest

from bench.security.lab import keyed_lab
from bench.security.stop_flood import Flood, stop_beside
from tests.free_ports import free_port

pytestmark = pytest.mark.processes


@pytest.mark.parametrize(("from_elsewhere", "count"), [(False, 30), pytest.param(True, 75, marks=pytest.mark.nightly)])
def test_every_stop_reaches_the_true_ground_beside_theft_and_floods(
    from_elsewhere: bool, count: int, tmp_path: Path
) -> None:
    """300 half-open connections, 1,000 requests a second, a thief, 20,000 forged datagrams a second.

    From another computer so many that connections which never greet have ended: after 10 s the bus lets nobody in.
    How soon is measured by `python -m bench.security`; a machine that has other work makes no stop wait for good.
    """
    stops = stop_beside(Flood(), count, keyed_lab(tmp_path, free_port()), from_elsewhere=from_elsewhere)
    assert stops.answered == count
    assert stops.requests_hz > 20.0  # there was a flood
    assert stops.worst_s < 20.0  # the lock-out after half-open connections lasts 30 s
