"""What `gcs run` prints at its end."""

import json
from pathlib import Path

import pytest

from formation.messages import Phase
from gcs.cli.ground import _report
from gcs.daemon import Ended, Timing

ENDED = Ended(Phase.GROUND, "landed", Timing(500, 2, 0.0042), 0, ())


@pytest.mark.parametrize("as_json", [True, False])
def test_the_end_of_a_run_says_what_priority_was_in_force(as_json: bool, capsys: pytest.CaptureFixture[str]) -> None:
    _report(ENDED, Path("a.mcap"), as_json, "SCHED_FIFO 10, memory locked")
    shown = capsys.readouterr().out
    if as_json:
        assert json.loads(shown)["priority"] == "SCHED_FIFO 10, memory locked"
        assert json.loads(shown)["late_ticks"] == 2
    else:
        assert shown == "500 ticks, 2 late, worst 4.2 ms; priority SCHED_FIFO 10, memory locked; log a.mcap\n"
