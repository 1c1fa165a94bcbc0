"""What every test run needs first: the kernels compiled, outside of any test's time limit."""

import pytest

from sim import lockstep
from sim.scenario import load


def pytest_sessionstart(session: pytest.Session) -> None:
    """Fill the cache of compiled kernels; after the first run on a machine this loads in a second."""
    if not session.config.option.collectonly:
        lockstep.warm_up(load("triangle_line"))
