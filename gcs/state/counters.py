"""The ground's counters, by the names under which they are published."""

from collections.abc import Collection

from gcs.drones.link_state import DroneLink
from gcs.facts import Lateness


def counters(
    frames: Lateness, stale_frames: int, rejected_frames: int, strays: int, links: Collection[DroneLink]
) -> dict[str, int | float]:  # fmt: skip
    """What was counted since the start; late_share: of about the last second's frames."""
    return {
        "frames": frames.frames,
        "missed_frames": frames.missed_frames,
        "late_share": round(frames.share, 4),
        "stale_frames": stale_frames,
        "rejected_frames": rejected_frames,
        "bad_bytes": sum(link.codec.bad_bytes for link in links),
        "bad_packets": sum(link.codec.bad_packets for link in links),
        "lost_packets": sum(link.sequence.lost for link in links),
        "superseded_packets": sum(link.superseded for link in links),
        "stray_datagrams": strays,
    }
