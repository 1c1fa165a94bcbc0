"""The page on publishing poses: its message is the program's, and its Python publishes frames that are accepted."""

import asyncio
import re
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2

from formation.messages import RawFrame
from tests.docs.manual_pages import MANUAL
from wire import clock
from wire.schema import schema_of
from wire.transport.frame_check import raw_fault
from wire.transport.zenoh_bus import ZenohBus

PAGE = (MANUAL / "howto" / "own-publisher.md").read_text(encoding="utf-8")


def test_the_message_shown_is_the_raw_frame() -> None:
    """Field numbers and types, as a program in another language would compile them."""
    (shown,) = re.findall(r"message RawFrame \{(.*?)\}", PAGE, re.DOTALL)
    fields = re.findall(r"(repeated )?(\w+) (\w+) = (\d+);", shown)
    written = descriptor_pb2.FileDescriptorSet.FromString(schema_of(RawFrame).descriptor_set).file[0].message_type[0]
    names = {"sfixed64": 16, "string": 9, "double": 1, "bool": 8}
    assert [(bool(repeated), names[kind], name, int(number)) for repeated, kind, name, number in fields] == [
        (field.label == field.LABEL_REPEATED, field.type, field.name, field.number) for field in written.field
    ]


def test_the_publisher_shown_publishes_frames_that_are_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs as it stands, on a bus that keeps what it is given."""
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    kept: list[RawFrame] = []

    class Cameras:
        async def next_frame(self) -> object:
            if len(kept) == 3:
                raise EOFError
            return ("leader", "right"), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2, bool)

    class Bus:
        def publish(self, key: str, payload: bytes) -> None:
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
