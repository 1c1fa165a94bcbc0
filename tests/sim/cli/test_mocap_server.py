"""`gcs-sim mocap-server`: what is served, and what is refused with a word."""

from pathlib import Path

import pytest

from sim.cli.app import BoxOptions
from sim.cli.mocap_server import BoxError, box

LAB = """
[mocap]
source = "{source}"
rate_hz = 50.0
[mocap.names]
"Quad 1" = "lead"
[leader]
body = "lead"
[[followers]]
body = "left"
sysid = 2
offset_m = [-0.5, 0.5, 0.0]
"""


def lab_file(folder: Path, source: str) -> Path:
    path = folder / "lab.toml"
    path.write_text(LAB.format(source=source))
    return path


def test_the_address_comes_from_the_command_line() -> None:
    served = box(BoxOptions(protocol="qtm", port=30_001))
    assert served.scene.bodies == ("body1", "body2", "body3")
    assert served.mocap.source == "qualisys"
    assert served.mocap.qualisys is not None
    assert (served.mocap.qualisys.host, served.mocap.qualisys.port) == ("127.0.0.1", 30_001)


def test_a_lab_file_says_bodies_names_and_system(tmp_path: Path) -> None:
    served = box(BoxOptions(lab=lab_file(tmp_path, "vicon")))
    assert served.scene.bodies == ("lead", "left")
    assert served.mocap.source_name("lead") == "Quad 1"
    assert served.mocap.source_name("left") == "left"


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (BoxOptions(), 'source "zenoh" is no camera system'),
        (BoxOptions(protocol="vrpn", cameras="colour=red"), "colour"),
        (BoxOptions(protocol="vrpn", cameras="burst"), "is not KEY=VALUE"),
        (BoxOptions(protocol="vrpn", cameras="lost_share=2"), "lost_share"),
        (BoxOptions(protocol="vrpn", lab=Path("/no/such/lab.toml")), "lab.toml"),
        (BoxOptions(protocol="vrpn", csv=Path("/no/such/poses.csv")), "poses.csv"),
    ],
)
def test_what_cannot_be_served_is_refused_in_one_line(options: BoxOptions, why: str) -> None:
    with pytest.raises(BoxError, match=why) as refused:
        box(options)
    assert "\n" not in str(refused.value)
