"""A flight's log as a rosbag2: a folder of one MCAP file and its metadata, which `ros2 bag info` and `play` take.

Its metadata are those of Humble (version 5), which later distributions read, too.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from formation import topics
from formation.config import LabConfig
from formation.messages import Datagram, Event, PhaseChange
from wire.logs.mcap_read import Log, clock_of, lab_of
from wire.logs.mcap_scan import LogError
from wire.logs.views import LINK_NS, LinkView
from wire.ros2.flight import TF_STATIC, Flight, Shown, diagnostics, fault_status, phase_status, static_frames
from wire.ros2.message_types import message_type

RECORDED = (
    topics.MOCAP, topics.STATE, topics.REFERENCE, topics.COMMAND, topics.PHASE, topics.EVENT, topics.MOCAP_EVENT,
    topics.LINK_UP,
)  # fmt: skip
_FOREVER = {"sec": 9223372036, "nsec": 854775807}

Message = tuple[int, Shown]
"""(date of its record, topic and message)."""


def write(log: Log, folder: Path, progress: Callable[[str], None] = lambda _text: None) -> list[Path]:
    """Write the bag into an empty folder; its files. Raises OSError, and LogError where the log names no lab."""
    lab = lab_of(log.metadata)
    if lab is None:
        raise LogError(f"{log.path}: its metadata say of no lab, without which its bodies have no names")
    path = folder / f"{folder.name}_0.mcap"
    flight = Flight(lab)
    with path.open("wb") as stream:
        bag = _Bag(Writer(stream, compression=CompressionType.ZSTD), flight.types)
        for count, (unix_ns, shown) in enumerate(_messages(log, lab, flight)):
            if count % 1000 == 0:
                progress(f"{count} messages written")
            bag.add(unix_ns, shown)
        bag.finish()
    described = folder / "metadata.yaml"
    described.write_text(json.dumps(bag.metadata(path.name), indent=2), encoding="utf-8")  # JSON is YAML
    return [path, described]


def _messages(log: Log, lab: LabConfig, flight: Flight) -> Iterator[Message]:
    ahead_ns = clock_of(log.metadata).ahead_ns
    links = {v.sysid: (v.body, LinkView(v.sysid)) for v in lab.vehicles if v.sysid is not None}
    slow_ns: int | None = None
    for entry in log.only(*RECORDED):
        unix_ns, record = entry.t_ns + ahead_ns, entry.message
        if slow_ns is None:
            yield unix_ns, static_frames(unix_ns)
            slow_ns = entry.t_ns
        match record:
            case Datagram():
                links[record.sysid][1].receive(record, entry.t_ns)
            case PhaseChange():
                yield unix_ns, diagnostics([phase_status(record)], unix_ns)
            case Event():
                yield unix_ns, diagnostics([fault_status(record, record.ends)], unix_ns)
            case _:
                yield from ((unix_ns, shown) for shown in flight.of(record, ahead_ns))
        if entry.t_ns - slow_ns >= LINK_NS:
            slow_ns = entry.t_ns
            for body, view in links.values():
                link = view.now(entry.t_ns)
                yield unix_ns, flight.battery(body, link.battery_v, link.battery, unix_ns)


class _Bag:
    """The messages of one bag's file, and what its metadata say of them."""

    def __init__(self, writer: Writer, types: Mapping[str, str]) -> None:
        self._writer = writer
        self._types = {_absolute(topic): kind for topic, kind in types.items()}
        self._counts: Counter[str] = Counter()
        self._first_ns = self._last_ns = 0
        writer.start(profile="ros2", library="mavlink-formation")
        schemas = {
            name: writer.register_schema(name, "ros2msg", message_type(name).definition.encode())
            for name in dict.fromkeys(types.values())
        }
        self._channels = {
            topic: writer.register_channel(topic, "cdr", schemas[name], {"offered_qos_profiles": _qos(topic)})
            for topic, name in self._types.items()
        }

    def add(self, unix_ns: int, shown: Shown) -> None:
        topic, values = _absolute(shown[0]), shown[1]
        data = message_type(self._types[topic]).encode(values)
        if not self._counts:
            self._first_ns = self._last_ns = unix_ns
        self._counts[topic] += 1
        self._first_ns, self._last_ns = min(self._first_ns, unix_ns), max(self._last_ns, unix_ns)
        self._writer.add_message(self._channels[topic], unix_ns, data, unix_ns, self._counts[topic])

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]

    def metadata(self, file: str) -> Mapping[str, object]:
        span = {
            "starting_time": {"nanoseconds_since_epoch": self._first_ns},
            "duration": {"nanoseconds": self._last_ns - self._first_ns},
            "message_count": self._counts.total(),
        }
        described = [
            {
                "topic_metadata": {
                    "name": topic, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": _qos(topic),
                },
                "message_count": self._counts[topic],
            }
            for topic, kind in self._types.items()
        ]  # fmt: skip
        information = {
            "version": 5, "storage_identifier": "mcap", **span, "topics_with_message_count": described,
            "compression_format": "", "compression_mode": "", "relative_file_paths": [file],
            "files": [{"path": file, **span}],
        }  # fmt: skip
        return {"rosbag2_bagfile_information": information}


def _absolute(topic: str) -> str:
    return f"/{topic.lstrip('/')}"


def _qos(topic: str) -> str:
    """The quality of service that was offered; the frames that stand still are there for those who come late."""
    last = reliable = automatic = transient_local = 1  # as rmw has them
    latched = topic == TF_STATIC
    profile = {
        "history": last, "depth": 1 if latched else 10, "reliability": reliable,
        "durability": transient_local if latched else 2, "deadline": _FOREVER, "lifespan": _FOREVER,
        "liveliness": automatic, "liveliness_lease_duration": _FOREVER, "avoid_ros_namespace_conventions": False,
    }  # fmt: skip
    return json.dumps([profile])
