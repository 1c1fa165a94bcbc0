"""Replay: the inputs of a log through a new GcsCore, its outputs compared bit by bit with the recorded ones.

Outputs are compared as a log holds them: those of control's stages in single precision.
"""

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from formation import topics
from formation.config import LabConfig
from formation.own_law.law import Answer, LawOverrunError
from formation.topics import Topic
from gcs.core import GcsCore
from gcs.recording import INPUT_TOPICS, OUTPUT_TOPICS, Thinning
from wire.logs.mcap_read import Log, Stored
from wire.schema import schema_of


class ReplayError(ValueError):
    """A log that does not say enough of its run to be replayed."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first place where replay and recording part. recorded or replayed is "nothing" where one has no message."""

    topic: str
    t_ns: int
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        return f"{self.topic} at {self.t_ns} ns, {self.field}: recorded {self.recorded}, replayed {self.replayed}"


@dataclass(frozen=True, slots=True)
class Replay:
    """How a replay went: what was fed in, how many outputs agreed, and the first that did not, if any."""

    inputs: int
    ticks: int
    agreed: int
    difference: Difference | None

    @property
    def identical(self) -> bool:
        """Whether every recorded output came again, bit by bit."""
        return self.difference is None


Output = tuple[Topic, object]
Array = NDArray[Any]


def replay(log: Log, progress: Callable[[str], None] = lambda _text: None) -> Replay:
    """Feed the log's inputs to a fresh core until an output differs. Raises ReplayError, and LogError while it is read.

    progress: called with how far it is, every second of the flight.
    A log that was cut off may end in the middle of a tick's outputs: what is there must agree.
    """
    core, left_out = _core(log), log.left_out
    thinning = Thinning()
    inputs = ticks = agreed = 0
    expected: Iterator[Output] = iter(())
    t_ns = shown_ns = 0
    for entry in log.only(*INPUT_TOPICS, topics.TICK, *OUTPUT_TOPICS):
        is_output = entry.topic in OUTPUT_TOPICS
        difference = _compare_next(entry, expected) if is_output else _left_over(expected, t_ns)
        if difference is not None:
            return Replay(inputs, ticks, agreed, difference)
        if is_output:
            agreed += 1
            continue
        t_ns = entry.t_ns
        if entry.topic is topics.TICK:
            now_ns = entry.message.now_ns
            if now_ns - shown_ns >= 1_000_000_000:
                progress(f"{ticks} ticks replayed")
                shown_ns = now_ns
            made = thinning.recorded(core.tick(now_ns), now_ns)
            ticks, expected = ticks + 1, _as_written(made, left_out)
        else:
            inputs += 1
            core.receive(entry.message, t_ns)
    if not agreed:
        raise ReplayError(f"{inputs} inputs and {ticks} ticks, but no outputs to compare in this log")
    return Replay(inputs, ticks, agreed, None)


def _as_written(made: Iterable[Output], left_out: Mapping[str, frozenset[str]]) -> Iterator[Output]:
    """The outputs without what the version that wrote the log did not record; left_out: such fields, by topic."""
    for topic, message in made:
        names = left_out.get(topic.name)
        if names and is_dataclass(message) and not isinstance(message, type):
            message = replace(
                message,
                **{f.name: f.default for f in fields(message) if f.name in names and f.default is not MISSING},
            )
        yield topic, message


def _left_over(expected: Iterator[Output], t_ns: int) -> Difference | None:
    """An output of the replayed tick that the recorded one lacks."""
    left_out = next(expected, None)
    if left_out is None:
        return None
    return Difference(left_out[0].name, t_ns, "message", "nothing", _shown(left_out[1]))


class _RecordedOverruns:
    """The lab's own law takes too long where it did in flight, and nowhere else: formation.own_law.law.LawGuard."""

    def __init__(self, log: Log) -> None:
        self._log = log

    @cached_property
    def _reasons(self) -> dict[int, str]:
        """By time; read where the flight had such a law."""
        failures = (entry.message for entry in self._log.only(topics.LAW_FAILURE))
        return {failure.t_ns: failure.reason for failure in failures if failure.overran}

    def __call__(self, now_ns: int, call: Callable[[], Answer]) -> Answer:
        """The result of `call`."""
        if now_ns in self._reasons:
            raise LawOverrunError(self._reasons[now_ns])
        return call()


def _core(log: Log) -> GcsCore:
    metadata = log.metadata
    try:
        session, t0_ns = int(metadata.get("ground_session", "0")), int(metadata["t0_ns"])
        config = LabConfig.model_validate_json(metadata["lab"])
    except (KeyError, ValidationError) as error:
        raise ReplayError(f"the log does not hold its run's configuration: {error}") from error
    try:
        return GcsCore(config, t0_ns, session, law_guard=_RecordedOverruns(log))
    except ValueError as error:
        law = metadata.get("control_law", "")
        raise ReplayError(f"it was flown by the control law {law}, which a replay needs, too: {error}") from error


def _compare_next(entry: Stored, expected: Iterator[Output]) -> Difference | None:
    replayed = next(expected, None)
    if replayed is None:
        return Difference(entry.topic.name, entry.t_ns, "message", _shown(entry.message), "nothing")
    topic, message = replayed
    if topic is not entry.topic:
        return Difference(entry.topic.name, entry.t_ns, "topic", entry.topic.name, topic.name)
    schema = schema_of(topic.type)
    recorded, made = entry.data, schema.encode(message)
    found = None if recorded == made else first_difference(schema.decode(recorded), schema.decode(made))
    return None if found is None else Difference(topic.name, entry.t_ns, *found)


def first_difference(recorded: object, replayed: object, name: str = "") -> tuple[str, str, str] | None:
    """The first field whose bits differ: its name and both values; None if all agree. NaN agrees with itself."""
    if is_dataclass(recorded) and type(recorded) is type(replayed):
        for field in fields(recorded):
            path = f"{name}.{field.name}" if name else field.name
            found = first_difference(getattr(recorded, field.name), getattr(replayed, field.name), path)
            if found is not None:
                return found
        return None
    if isinstance(recorded, np.ndarray) and isinstance(replayed, np.ndarray):
        return _array_difference(recorded, replayed, name)
    if isinstance(recorded, float) and isinstance(replayed, float):
        same = struct.pack("<d", recorded) == struct.pack("<d", replayed)
    else:
        same = recorded == replayed
    return None if same else (name or "value", _shown(recorded), _shown(replayed))


def _array_difference(recorded: np.ndarray, replayed: np.ndarray, name: str) -> tuple[str, str, str] | None:
    if recorded.shape != replayed.shape or recorded.dtype != replayed.dtype:
        return name, f"{recorded.dtype}{recorded.shape}", f"{replayed.dtype}{replayed.shape}"
    if recorded.tobytes() == replayed.tobytes():
        return None
    for index in np.ndindex(recorded.shape):
        if recorded[index].tobytes() != replayed[index].tobytes():
            return (
                f"{name}[{', '.join(map(str, index))}]",
                _shown(recorded[index].item()),
                _shown(replayed[index].item()),
            )
    return None


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 120 else text[:117] + "..."
