"""The README's tables are the tables the ground runs on, and its configurations load."""

import asyncio
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2

from drone_agent import stages
from formation.config import LabConfig
from formation.messages import RawFrame
from formation.safety import phases, rules_table
from gcs.mocap.gate.checks import gate_markdown
from sim import lockstep
from sim.scenario import load
from wire import clock
from wire.config_file import parse
from wire.schema import schema_of
from wire.transport.frame_check import raw_fault
from wire.transport.zenoh_bus import ZenohBus

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("rules", rules_table.rules_markdown()),
        ("phases", phases.table_markdown()),
        ("gate", gate_markdown()),
        ("stages", stages.table_markdown()),
    ],
)
def test_readme_shows_the_table_in_force(name: str, table: str) -> None:
    shown = README.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0].strip()
    assert shown == table, (
        f"the README's table of {name} is out of date: paste what `gcs rules` or `drone-agent --stages` prints"
    )


def test_the_raw_frame_is_the_message_shown() -> None:
    """Field numbers and types, as a program in another language would compile them."""
    (shown,) = re.findall(r"message RawFrame \{(.*?)\}", README, re.DOTALL)
    fields = re.findall(r"(repeated )?(\w+) (\w+) = (\d+);", shown)
    written = descriptor_pb2.FileDescriptorSet.FromString(schema_of(RawFrame).descriptor_set).file[0].message_type[0]
    names = {"sfixed64": 16, "string": 9, "double": 1, "bool": 8}
    assert [(bool(repeated), names[kind], name, int(number)) for repeated, kind, name, number in fields] == [
        (field.label == field.LABEL_REPEATED, field.type, field.name, field.number) for field in written.field
    ]


def test_the_publisher_shown_publishes_frames_that_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs as it stands, on a bus that keeps what it is given."""
    (program,) = [text for text in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "publish_raw" in text]
    kept: list[RawFrame] = []

    class Cameras:
        async def next_frame(self) -> object:
            if len(kept) == 3:
                raise EOFError
            return ("leader", "right"), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2, bool)

    class Bus:
        def put(self, key: str, payload: bytes) -> None:
            assert key == "mocap/raw"
            kept.append(schema_of(RawFrame).decode(payload))

    async def opened(*_: object) -> Bus:
        return Bus()

    monkeypatch.setattr(ZenohBus, "open", opened)
    names: dict[str, Any] = {}
    exec(program, names)
    with pytest.raises(EOFError):
        asyncio.run(names["publish"](Cameras()))
    assert [frame.seq for frame in kept] == [0, 1, 2]
    assert all(raw_fault(frame, clock.monotonic_ns()) is None for frame in kept)


def toml_shown() -> tuple[list[str], list[str]]:
    """The lab files, and the scenarios that name one."""
    shown = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    return [text for text in shown if "lab" not in tomllib.loads(text)], [t for t in shown if "lab" in tomllib.loads(t)]


def test_a_lab_shown_can_be_flown() -> None:
    """A snippet without bodies of its own belongs to the first lab."""
    first, *others = map(tomllib.loads, toml_shown()[0])
    for snippet in (first, *others):
        parse(snippet if "leader" in snippet else {**first, **snippet}, LabConfig, source="README.md")
    assert others


def test_the_scenario_shown_flies_the_lab_shown(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(toml_shown()[0][0])
    (scenario,) = toml_shown()[1]
    file = tmp_path / "scenario.toml"
    file.write_text(scenario)
    flown, _ = lockstep.run_in_memory(load(str(file)), 7)
    assert flown.outcome.result == "landed", flown.outcome
