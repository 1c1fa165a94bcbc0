"""What every test run needs first: the kernels compiled, outside of any test's time limit; properties that repeat.

A run draws the same examples every time and judges no example by the clock: a red run is the code's doing.
`--hypothesis-profile=default` searches further.
"""

import pytest
from hypothesis import settings

from sim import lockstep

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Fill the cache of compiled kernels; after the first run on a machine this loads in a second."""
    if not session.config.option.collectonly:
        lockstep.warm_up_all()
