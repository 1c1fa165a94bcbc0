"""What `gcs mocap` does around the daemon: the terminal and exit codes."""

import sys

import uvloop

from formation.config import LabConfig
from gcs.cli.common import NOT_RIGHT, REFUSED, fail, tell, tell_json
from gcs.mocap.daemon import run
from gcs.mocap.service import ServiceError
from gcs.mocap.sources.csv_file import MocapFileError
from gcs.mocap.warm_up import warm_up
from wire.clock import Clock
from wire.process.progress import compile_all


def serve(config: LabConfig, linger_s: float | None, as_json: bool, clock: Clock) -> None:
    """Be the mocap process until told to end; ends the program with its exit code."""
    if config.mocap.source == "mavlink":
        fail('source "mavlink" has no cameras: the ground hears the poses from the drones themselves', NOT_RIGHT)
    compile_all("gcs", lambda: warm_up(config), sys.stderr)
    try:
        uvloop.run(run(config, linger_s, tell_json if as_json else tell, clock))
    except MocapFileError as error:
        fail(str(error), NOT_RIGHT)
    except ServiceError as error:
        fail(str(error), error.code)
    except OSError as error:
        fail(str(error), REFUSED)
