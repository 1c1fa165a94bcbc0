"""The record of a GcsCore, and its order: the one definition that recording and replay share.

Inputs at the time they were received, then the tick, then what it put out: records, datagrams, replies.
"""

import json
from collections.abc import Callable
from dataclasses import asdict
from itertools import product

from formation import topics
from formation.config import LabConfig
from formation.control.presets import preset_for
from formation.messages import Datagram, HostReport, LabFrame, OperatorRequest, Phase, PhaseChange, Tick, UnmetParameter
from formation.topics import Topic
from gcs.core import Outgoing
from wire import version
from wire.lab_surroundings import law_package

Record = Callable[[Topic, object, int], None]
Input = LabFrame | Datagram | OperatorRequest | HostReport | UnmetParameter

INPUT_TOPICS = (topics.MOCAP, topics.LINK_UP, topics.REQUEST, topics.HOST, topics.UNMET)
OUTPUT_TOPICS = (
    topics.STATE, topics.REFERENCE, topics.COMMAND, topics.TARGET, topics.LAW_FAILURE, topics.PHASE, topics.EVENT,
    topics.LINK_DOWN, topics.REPLY,
)  # fmt: skip

STAGES = (topics.STATE, topics.REFERENCE, topics.COMMAND, topics.TARGET)
_TOPIC_OF = {topic.type: topic for topic in INPUT_TOPICS}
_TOPIC_OF[Datagram] = topics.LINK_UP


class Thinning:
    """Which of a core's outputs are recorded: all in flight; of the control's stages ten a second while on the ground.

    Decided by the outputs alone, so that replay, which makes them all anew, leaves out the same.
    """

    def __init__(self, calm_ns: int = 100_000_000) -> None:
        """calm_ns: so far apart the control's own outputs are recorded while nobody is armed."""
        self._calm, self._calm_ns = False, calm_ns
        self._next_ns = 0
        self.detailed = True
        """Whether the last tick was recorded whole."""

    def recorded(self, outgoing: Outgoing, now_ns: int) -> list[tuple[Topic, object]]:
        """Those of a tick's outputs that are recorded, in order."""
        staged, records = False, list(outgoing.records)
        for topic, message in records:
            staged = staged or topic is topics.STATE
            if topic is topics.PHASE and isinstance(message, PhaseChange):
                self._calm = message.phase is Phase.GROUND
        self.detailed = not self._calm or (staged and now_ns >= self._next_ns)
        if self.detailed:
            self._next_ns = now_ns + self._calm_ns
        else:
            records = [record for record in records if record[0] not in STAGES]
        records += product((topics.LINK_DOWN,), outgoing.datagrams)
        records += product((topics.REPLY,), outgoing.replies)
        return records


class Recorder:
    """Records what one core is given and puts out."""

    def __init__(self, record: Record) -> None:
        self.record = record
        self._thinning = Thinning()

    @property
    def detailed(self) -> bool:
        """Whether the last tick was recorded whole."""
        return self._thinning.detailed

    def input(self, message: Input, now_ns: int) -> None:
        """Record what `GcsCore.receive` is given."""
        self.record(_TOPIC_OF[type(message)], message, now_ns)

    def tick(self, outgoing: Outgoing, now_ns: int) -> None:
        """Record a call of `GcsCore.tick` and what is kept of all it returned."""
        self.record(topics.TICK, Tick(now_ns), now_ns)
        for topic, message in self._thinning.recorded(outgoing, now_ns):
            self.record(topic, message, now_ns)


def run_metadata(config: LabConfig, t0_ns: int, session: int = 0) -> dict[str, str]:
    """Metadata by which a log is replayed, and with which it was flown: gains and profiles as they were used.

    Hosts add what else they know (scenario, seed, link, lab file, machine).
    """
    profiles = {vehicle.profile: config.profile_of(vehicle) for vehicle in config.vehicles}
    gains = {name: preset_for(config.control_preset, kind, config.mocap) for name, kind in profiles.items()}
    law = config.control_law
    return {
        "control_law": "" if law is None else f"{law.name}, of {law_package(law.name)}",
        "lab": config.model_dump_json(),
        "t0_ns": str(t0_ns),
        "ground_session": str(session),
        "gains": json.dumps({name: asdict(preset) for name, preset in gains.items()}),
        "profiles": json.dumps({name: kind.model_dump(mode="json") for name, kind in profiles.items()}),
        "versions": version.text(),
        "version": version.VERSION,
        "commit": version.commit(),
    }
