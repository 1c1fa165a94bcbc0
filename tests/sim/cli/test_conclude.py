"""What the host saw and what the log tells, in one outcome."""

import pytest

from sim.cli.conclude import _joined
from sim.script import Outcome


@pytest.mark.parametrize(
    ("host", "log", "told"),
    [
        (Outcome("landed"), "landed", "landed"),
        (Outcome("landed"), "lost: F fell", "lost: F fell"),
        (Outcome("aborted", "agent-3 ended"), "landed", "aborted: agent-3 ended"),
        (Outcome("aborted", "agent-3 ended"), "lost: F unheard", "lost: agent-3 ended; F unheard"),
        (Outcome("aborted", "back on the ground"), "aborted: mocap lost", "aborted: mocap lost"),
        (Outcome("starved", "too slow"), "landed", "starved: too slow"),
    ],
)
def test_the_worse_of_both_is_told_with_both_reasons(host: Outcome, log: str, told: str) -> None:
    assert _joined(host, log) == told
