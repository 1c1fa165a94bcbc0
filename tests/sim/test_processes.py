import asyncio
import os
import re
from pathlib import Path

import pytest

from sim.processes import ProcessDied, ProcessGroup

pytestmark = pytest.mark.processes


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_all_are_stopped_on_leaving_even_through_an_error(tmp_path: Path) -> None:
    pids = []

    async def fail_in_the_middle() -> None:
        async with ProcessGroup(tmp_path) as group:
            for name in ("a", "b"):
                child = await group.start(name, "timeit", ["-n", "1", "import time; time.sleep(60)"])
                pids.append(child.process.pid)
            raise ValueError("in the middle")

    with pytest.raises(ValueError, match="in the middle"):
        asyncio.run(fail_in_the_middle())
    assert len(pids) == 2
    assert all(gone(pid) for pid in pids)


def test_the_first_to_die_is_named_with_its_last_words(tmp_path: Path) -> None:
    async def one_dies() -> None:
        async with ProcessGroup(tmp_path) as group:
            await group.start("steady", "timeit", ["-n", "1", "import time; time.sleep(60)"])
            await group.start("mortal", "this", [])
            await asyncio.wait_for(group.watch(), 20.0)

    with pytest.raises(ProcessDied, match=re.compile("mortal ended with exit code 0.*honking great idea")):
        asyncio.run(one_dies())


def test_a_simulator_that_came_too_late_is_told_apart(tmp_path: Path) -> None:
    words = "import os; print('the mocap emulator is starved', flush=True); os._exit(3)"

    async def one_is_starved() -> None:
        async with ProcessGroup(tmp_path) as group:
            await group.start("mocap", "timeit", ["-n", "1", words])
            await asyncio.wait_for(group.watch(), 60.0)

    with pytest.raises(ProcessDied, match="the mocap emulator is starved") as died:
        asyncio.run(one_is_starved())
    assert died.value.starved
