"""What `gcs run` does around the daemon: margins, warm-up, the terminal, exit codes."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import uvloop

from formation.config import LabConfig
from formation.exposure import GROUND
from formation.messages import Event, Severity
from gcs.daemon import Ended, GroundFailure, run
from gcs.lab.findings import judge_margins
from gcs.warm_up import warm_up
from mocap.service import ServiceError
from wire.clock import Clock
from wire.files import make_folder
from wire.process.program import fail, print_event, print_event_json
from wire.process.progress import compile_all
from wire.process.system import NOT_LANDED, NOT_RIGHT, REJECTED, prefer_process, raise_priority
from wire.security.private_keys import keys_folder, read_operations
from wire.security.protection import lab_protection


@dataclass(frozen=True, slots=True)
class Run:
    """How `gcs run` was asked to run. force: fly a preset that the delay margin refuses; insecure: without keys.

    priority: before other processes, in real time, where the machine allows it.
    """

    lab_file: Path
    log: Path
    name: str
    metadata: dict[str, str]
    force: bool
    as_json: bool
    insecure: bool
    priority: bool
    clock: Clock


def serve(config: LabConfig, asked: Run) -> None:
    """Run the ground until SIGINT or SIGTERM, then end the program with its exit code."""
    log, name, as_json = asked.log, asked.name, asked.as_json
    report = print_event_json if as_json else print_event
    report(Event(Severity.INFO, "ground", f"starting for lab {config.name!r}, log {log}"))
    try:
        protection = lab_protection(config.security, asked.lab_file, GROUND, insecure=asked.insecure)
        compile_all("gcs", lambda: warm_up(config), sys.stderr)
        reasons = "; ".join(f"{found.why} ({found.wanted})" for found in judge_margins(config))
        if reasons and not asked.force:
            fail(f"refused: {reasons} (--force, for simulation only)", REJECTED)
        make_folder(log.parent)
        # After the compiler, before the threads that inherit it.
        priority = raise_priority() if asked.priority else prefer_process()
        report(Event(Severity.INFO, "ground", f"priority: {priority}"))
        metadata = asked.metadata | _key_operations(config, asked.lab_file) | {"priority": priority}
        ended = uvloop.run(run(config, asked.lab_file, log, name, metadata, report, asked.clock, protection))
    except ServiceError as error:
        fail(str(error), error.code)
    except ValueError as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REJECTED)
    except GroundFailure as error:
        fail(f"the ground has failed and ends, the drones land by themselves: {error}", REJECTED)
    _report(ended, log, as_json, priority)


def _key_operations(config: LabConfig, lab_file: Path) -> dict[str, str]:
    """For the log: what was done to the lab's keys."""
    if config.security is None:
        return {}
    return {"key_operations": read_operations(keys_folder(config.security.keys, lab_file))}


def _report(ended: Ended, log: Path, as_json: bool, priority: str) -> None:
    timing = ended.timing
    worst_ms = round(timing.worst_s * 1e3, 2)
    if as_json:
        summary = {
            "phase": ended.phase.name, "cause": ended.cause, "not_landed": ended.not_landed,
            "ticks": timing.ticks, "late_ticks": timing.late,
            "worst_latency_ms": worst_ms, "priority": priority, "lost_records": ended.lost_records, "mcap": str(log),
        }  # fmt: skip
        print(json.dumps(summary))
    else:
        print(f"{timing.ticks} ticks, {timing.late} late, worst {worst_ms} ms; priority {priority}; log {log}")
    if ended.not_landed:
        fail(f"ended with {', '.join(ended.not_landed)} not known to have landed ({ended.cause})", NOT_LANDED)
