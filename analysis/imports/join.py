"""What `gcs-log join` does: an autopilot's log on a flight's time axis, in a copy of the flight's log."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.imports.align import Alignment, by_exchanges, by_motion
from analysis.imports.formats import read
from analysis.imports.maps import ImportMap
from analysis.imports.recording import Recording, Table
from analysis.imports.signals import Imported, imported
from analysis.imports.write import Stream, in_order, signal_streams
from analysis.links import from_drones, from_ground
from analysis.load import Flight, Vehicle, load
from analysis.series import Sampled
from formation.maths.arrays import Float
from wire.link_messages import MessageId, TimeSync
from wire.logs.mcap_read import clock_of, read_log
from wire.logs.mcap_scan import LogError
from wire.logs.mcap_write import LogWriter

JOINED = "joined"
"""Key of a run's metadata: which logs were put on its time axis, and how, JSON."""
CLOCKS = frozenset({MessageId.TIMESYNC})
OWN_ID = ("MAV_SYS_ID", "SYSID_THISMAV", "MAV_SYSID")
"""Parameters of PX4 and ArduPilot."""


@dataclass(frozen=True, slots=True)
class Joined:
    """One autopilot's log on the flight's time."""

    file: str
    body: str
    alignment: Alignment
    damage: str

    @property
    def text(self) -> str:
        """In one line."""
        return f"{self.file}: {self.body}, {self.alignment.text}"


def join(path: Path, logs: Sequence[Path], out: Path, sysid: int | None, by: ImportMap | None) -> tuple[Joined, ...]:
    """Write the flight's log with the autopilots' signals in it. LogError, BadFileError, ConfigError, OSError."""
    flight = load(path)
    joined, streams = list[Joined](), list[Stream]()
    for file in logs:
        with np.errstate(all="ignore"):
            recording, chosen = read(file, by)
            vehicle = _vehicle(flight, recording, sysid)
            found = imported(recording, chosen, vehicle.body)
        aligned = align(flight, vehicle, found)
        streams += signal_streams(_within(found, flight, aligned), -1e-9 * flight.t0_ns, aligned.flight_s)
        joined.append(Joined(str(file), vehicle.body, aligned, recording.damage))
    with np.errstate(all="ignore"):
        _write(path, out, joined, streams)
    return tuple(joined)


def align(flight: Flight, vehicle: Vehicle, found: Imported) -> Alignment:
    """The clocks of a vehicle's autopilot and of the flight, by TIMESYNC where it ran, else by the motion. LogError."""
    aligned = by_exchanges(*_exchanges(flight, vehicle))
    if aligned is None:
        gyro = found.quantities.get("rates")
        if gyro is None:
            raise LogError(f"{found.recording.path}: no TIMESYNC in the flight's log, and no gyros in this one")
        index = flight.vehicles.index(vehicle)
        seen = flight.poses.seen[:, index]
        try:
            aligned = by_motion(flight.poses.t_s[seen], flight.poses.q_lab_from_flu[seen, index], gyro)
        except LogError as error:
            raise LogError(f"{found.recording.path}: {error}") from error
    begin_s, end_s = aligned.flight_s(np.array(found.recording.span_s))
    if end_s < 0.0 or begin_s > flight.duration_s:
        raise LogError(f"{found.recording.path}: is of another time, {begin_s:.1f} to {end_s:.1f} s from the flight's")
    return aligned


def _vehicle(flight: Flight, recording: Recording, sysid: int | None) -> Vehicle:
    """Whose log it is: as asked, by its own parameters, or the only drone there."""
    own = next((int(recording.parameters[name]) for name in OWN_ID if name in recording.parameters), None)
    drones = [vehicle for vehicle in flight.vehicles if vehicle.sysid is not None]
    wanted = own if sysid is None else sysid
    found = [vehicle for vehicle in drones if vehicle.sysid == wanted] or (drones if wanted is None else [])
    if len(found) != 1:
        whose = "does not say which drone it is of" if wanted is None else f"is of drone {wanted}"
        known = ", ".join(f"{vehicle.sysid} ({vehicle.body})" for vehicle in drones)
        raise LogError(f"{recording.path}: {whose}; --sysid names one of {known or 'none'}")
    return found[0]


def _exchanges(flight: Flight, vehicle: Vehicle) -> tuple[Float, Float, Float]:
    """The TIMESYNC of one drone: asked, its own time, answered, s."""
    asked = {
        message.ts1_ns: 1e-9 * (message.ts1_ns - flight.t0_ns)
        for _, sysid, message in from_ground(flight, CLOCKS)
        if isinstance(message, TimeSync) and sysid == vehicle.sysid and message.tc1_ns == 0
    }
    rows = [
        (asked[message.ts1_ns], 1e-9 * message.tc1_ns, t_s)
        for t_s, sysid, message in from_drones(flight, CLOCKS)
        if isinstance(message, TimeSync) and sysid == vehicle.sysid and message.tc1_ns and message.ts1_ns in asked
    ]
    asked_s, theirs_s, answered_s = np.array(rows, np.float64).reshape(-1, 3).T
    return asked_s, theirs_s, answered_s


def _within(found: Imported, flight: Flight, aligned: Alignment) -> Imported:
    """What lies within the flight."""

    def inside(t_s: Float) -> slice:
        at_s = aligned.flight_s(t_s)
        return slice(*np.searchsorted(at_s, [0.0, flight.duration_s]).tolist())

    quantities = {
        name: Sampled(of.t_s[inside(of.t_s)], of.values[inside(of.t_s)]) for name, of in found.quantities.items()
    }
    others = {
        name: Table(of.t_s[inside(of.t_s)], {key: values[inside(of.t_s)] for key, values in of.columns.items()})
        for name, of in found.others.items()
    }
    # Its texts came over the link, and are in the flight's log as its ground heard them.
    return replace(found, quantities=quantities, others=others, recording=replace(found.recording, texts=()))


def _write(path: Path, out: Path, joined: Sequence[Joined], streams: Sequence[Stream]) -> None:
    """The flight's records as they were, and between them the streams'."""
    log = read_log(path)
    made_of = [
        {"file": Path(each.file).name, "body": each.body, "by": each.alignment.text} for each in joined
    ]  # fmt: skip
    metadata = {**log.metadata, JOINED: json.dumps(made_of)}
    more = in_order(streams)
    coming = next(more, None)
    with LogWriter(out, metadata, start=clock_of(log.metadata), threaded=False) as writer:
        for entry in log.entries:
            while coming is not None and coming[2] <= entry.t_ns:
                writer.write(*coming)
                coming = next(more, None)
            writer.write(entry.topic, entry.message, entry.t_ns)
