"""The packets to the drones in a tick: setpoint, pose, the ground's heartbeat, and what each link has to say."""

from collections.abc import Sequence

import numpy as np

from formation.messages import AttitudeTarget, Datagram, LabFrame
from gcs.drones.drone import Drone
from gcs.drones.telemetry import ground_heartbeat
from wire.link_messages import ground_address
from wire.mavlink.batches import PoseBatch, SetpointBatch
from wire.mavlink.framing import packed

HEARTBEAT_NS = 1_000_000_000
POSE_NS = 20_000_000


class Packets:
    """One ground's packets: the heartbeat rides on ticks with a frame alone, poses on every second one at 100 Hz."""

    def __init__(self, drones: Sequence[Drone], session: int, t0_ns: int) -> None:
        """session: the ground session."""
        self._drones = drones
        self._heartbeat = ground_heartbeat(session)
        self._setpoints = SetpointBatch(ground_address(session), [drone.link.target for drone in drones])
        self._poses = PoseBatch(ground_address(session), len(drones))
        self._bodies = np.array([drone.index for drone in drones])
        self._nothing = [b""] * len(drones)
        self._heartbeat_due_ns = self._pose_due_ns = t0_ns

    def due(self, frame: LabFrame | None, target: AttitudeTarget | None, now_ns: int) -> tuple[Datagram, ...]:
        """One datagram a drone where it holds all that is due, the setpoint first.

        frame: of this tick; without one neither heartbeat, pose nor setpoint is sent. target: streamed now, if any.
        """
        beat = frame is not None and now_ns >= self._heartbeat_due_ns
        pose = frame is not None and now_ns >= self._pose_due_ns
        if beat:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_NS
        if pose:  # a steady 50 Hz out of frames that jitter
            self._pose_due_ns = max(self._pose_due_ns + POSE_NS, now_ns)
        streamed = self._nothing if frame is None or target is None else self._encode(frame, target)
        poses = self._encode_poses(frame) if pose and frame is not None else self._nothing
        datagrams = []
        for drone, setpoint, seen in zip(self._drones, streamed, poses, strict=True):
            link = drone.link
            due, parts = link.due(now_ns), [setpoint, seen]
            if beat:
                parts.append(link.codec.encode(self._heartbeat))
            if due:
                parts += [link.codec.encode(message) for message in due]
                datagrams += [Datagram(link.sysid, data) for data in packed(b"".join(parts))]
            elif data := b"".join(parts):  # three frames at most: nothing to split
                datagrams.append(Datagram(link.sysid, data))
        return tuple(datagrams)

    def _encode_poses(self, frame: LabFrame) -> list[bytes]:
        """VISION_POSITION_ESTIMATE, which PX4 and ArduPilot both fuse as documented; empty for whom none is sent.

        That is who is not seen, and who has not said yet which autopilot it is.
        """
        bodies, seen = self._bodies, frame.seen[self._bodies].tolist()
        sent = [of and drone.link.model is not None for drone, of in zip(self._drones, seen, strict=True)]
        seqs = [drone.link.codec.next_seq() if of else 0 for drone, of in zip(self._drones, sent, strict=True)]
        packets = self._poses.encode(
            frame.t_capture_ns // 1000, frame.pos_lab_m[bodies], frame.q_lab_from_flu[bodies], seqs
        )
        return [packet if of else b"" for packet, of in zip(packets, sent, strict=True)]

    def _encode(self, frame: LabFrame, target: AttitudeTarget) -> list[bytes]:
        """SET_ATTITUDE_TARGET of each drone, stamped with the frame's capture time; empty for whom none is sent."""
        held_off = target.held_off.tolist()
        sent = [drone.flown and not off for drone, off in zip(self._drones, held_off, strict=True)]
        seqs = [drone.link.codec.next_seq() if of else 0 for drone, of in zip(self._drones, sent, strict=True)]
        ignore = [drone.link.setpoint_ignore for drone in self._drones]
        packets = self._setpoints.encode(target, frame.t_capture_ns // 1_000_000, ignore, seqs)
        return [packet if of else b"" for packet, of in zip(packets, sent, strict=True)]
