"""Nothing compiles in flight: in a fresh process, a flight after the warm-up adds no signature to any kernel."""

import subprocess
import sys
from pathlib import Path

import pytest

FLIGHT = """
import sys
from numba.core.dispatcher import Dispatcher
from tests.gcs.fakes import FakeLab, triangle
from formation.messages import Phase
from gcs.warm_up import warm_up

def signatures():
    modules = [m for name, m in sys.modules.items() if name.split(".")[0] in ("formation", "gcs")]
    kernels = {v for m in modules for v in vars(m).values() if isinstance(v, Dispatcher)}
    return {(k.py_func.__module__, k.py_func.__name__, s) for k in kernels for s in k.signatures}

warm_up(triangle())
warm = signatures()
lab = FakeLab(triangle())
lab.fly()
lab.run(4.0)
lab.core.state(lab.now_ns)
lab.hidden.add("left")
lab.run(0.3)
lab.hidden.clear()
lab.run(0.2)
lab.drones[3].sends_nothing = True
lab.run(4.0)
lab.run_until(Phase.GROUND)
print(len(warm), sorted(signatures() - warm, key=str))
"""


@pytest.mark.processes
def test_after_the_warm_up_a_whole_flight_loads_no_kernel():
    command = [sys.executable, "-c", FLIGHT]
    folder = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stderr
    count, _, added = done.stdout.partition(" ")
    assert int(count) > 10
    assert added.strip() == "[]"
