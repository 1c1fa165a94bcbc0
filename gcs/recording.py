"""What a host records of a GcsCore, and in which order: the one definition that recording and replay share.

Inputs at the time they were received, then the tick, then what it put out: records, datagrams, replies.
"""

from collections.abc import Callable, Iterator

from formation import topics
from formation.config import LabConfig
from formation.messages import Datagram, HostReport, LabFrame, OperatorRequest, Tick
from formation.topics import Topic
from gcs.core import Outgoing

Record = Callable[[Topic, object, int], None]
Input = LabFrame | Datagram | OperatorRequest | HostReport

INPUT_TOPICS = (topics.MOCAP, topics.LINK_UP, topics.REQUEST, topics.HOST)
OUTPUT_TOPICS = (
    topics.STATE, topics.REFERENCE, topics.COMMAND, topics.TARGET, topics.PHASE, topics.EVENT,
    topics.LINK_DOWN, topics.REPLY,
)  # fmt: skip

_TOPIC_OF = {topic.type: topic for topic in INPUT_TOPICS}
_TOPIC_OF[Datagram] = topics.LINK_UP


def record_input(record: Record, message: Input, now_ns: int) -> None:
    """Record what `GcsCore.receive` is given."""
    record(_TOPIC_OF[type(message)], message, now_ns)


def record_tick(record: Record, outgoing: Outgoing, now_ns: int) -> None:
    """Record a call of `GcsCore.tick` and all it returned."""
    record(topics.TICK, Tick(now_ns), now_ns)
    for topic, message in outputs(outgoing):
        record(topic, message, now_ns)


def outputs(outgoing: Outgoing) -> Iterator[tuple[Topic, object]]:
    """Everything a tick put out, in the order of the log."""
    yield from outgoing.records
    for datagram in outgoing.datagrams:
        yield topics.LINK_DOWN, datagram
    for reply in outgoing.replies:
        yield topics.REPLY, reply


def run_metadata(config: LabConfig, t0_ns: int, epoch: int = 0) -> dict[str, str]:
    """What a log must say of its run to be replayed; hosts add what else they know (scenario, seed, link, versions)."""
    return {"lab": config.model_dump_json(), "t0_ns": str(t0_ns), "epoch": str(epoch)}
