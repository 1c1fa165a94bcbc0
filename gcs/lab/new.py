"""`gcs new`: a commented lab file of three answers, which `gcs check` accepts and `gcs-sim run` flies."""

from math import ceil

from formation.guidance.patterns import triangle
from formation.vehicle.profile import VehicleProfile

WITH_HOST = ("vicon", "natnet", "qualisys", "vrpn", "chingmu", "nokov", "ros2")
SOURCES = (*WITH_HOST, "zenoh")
FILE = """\
# A leader and its followers. Metres; x forward, y left, z up; floor z = 0. Every key: the manual's page "Lab file".
name = "lab"                    # grounds, drones and recordings of one lab share it
formation = {{ spacing_m = {spacing_m:g} }}  # of the named shapes, as `gcs shape v`
flight = {{ altitude_m = {altitude_m:g} }}

[mocap]
source = "{source}"
rate_hz = 100.0                 # as the camera system is set
axes = ["x forward", "y left", "z up"]  # where the camera system's axes point: `gcs doctor` proves it
# names = {{ "Rigid Body 1" = "leader" }}  # where the camera system calls bodies otherwise
{host}
[limits]
min_separation_m = {separation_m:g}         # {profile} is {width_m:.2f} m wide
fence = {{ low_m = [{low}, -0.1], high_m = [{high}, {top_m:g}] }}  # measure your flight volume

[leader]
body = "leader"                 # the rigid body's name
sysid = 1                       # its MAVLink system id; leave it out for a leader that is only observed
profile = "{profile}"           # the vehicle, for every drone below too
trajectory = {{ kind = "line", length_m = 1.0 }}
"""
FOLLOWER = """
[[followers]]
body = "follower{k}"
sysid = {sysid}
profile = "{profile}"
offset_m = [{x:.2f}, {y:.2f}, 0.0]   # forward, left, up of the leader
"""


def lab_text(source: str, followers: int, kind: VehicleProfile) -> str:
    """The file's text, of one of SOURCES and 1 to 249 followers of one kind, in a triangle within the fence."""
    width_m = kind.width_m
    separation_m = max(ceil(20.0 * width_m) / 20.0, 0.2)
    spacing_m = ceil(20.0 * separation_m) / 10.0  # twice as far: nobody brakes for a neighbour
    slots = triangle(followers, spacing_m)
    reach_m = spacing_m + 1.0
    low = ", ".join(f"{x - reach_m:.1f}" for x in slots.min(axis=0)[:2])
    high = ", ".join(f"{max(x, 1.0) + reach_m:.1f}" for x in slots.max(axis=0)[:2])
    text = FILE.format(
        source=source, profile=kind.name, width_m=width_m, separation_m=separation_m, spacing_m=spacing_m, low=low,
        high=high, top_m=1.0 + 3.0 * spacing_m, altitude_m=max(0.5, spacing_m),
        host=f'\n[mocap.{source}]\nhost = "127.0.0.1"              # the cameras\' computer\n' * (source in WITH_HOST),
    )  # fmt: skip
    numbered = enumerate(slots.tolist(), 1)
    return text + "".join(FOLLOWER.format(k=k, sysid=k + 1, profile=kind.name, x=x, y=y) for k, (x, y, _) in numbered)
