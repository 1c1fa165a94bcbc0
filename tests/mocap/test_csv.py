from pathlib import Path

import numpy as np
import pytest

from mocap.sources.csv_file import MocapFileError, read_recording

HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
GOOD = "1413394881394290944,-0.96,0.41,1.44,0.0,0.0,0.0,1.0\n"
LATER = "1413394881404401408,-0.95,0.42,1.45,0.6,0.0,0.0,-0.8\n"


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "leader.csv"
    path.write_text(text)
    return path


def test_stamps_are_kept_to_the_nanosecond_and_quaternions_made_canonical(tmp_path):
    recording = read_recording(_file(tmp_path, HEADER + GOOD + "\n" + LATER))
    assert recording.t_ns.tolist() == [0, 10_110_464]
    assert recording.pos_mocap_m.tolist() == [[-0.96, 0.41, 1.44], [-0.95, 0.42, 1.45]]
    assert np.allclose(recording.q_mocap_from_marker, [[0, 0, 0, 1], [0.6, 0, 0, -0.8]])


EUROC = "t [ns],x [m],y,z,qw,qx,qy,qz"
POSE = "0.1,0.2,0.3,0.5,-0.5,0.5,0.5"
MOTIVE = """Format Version,1.23,Take Notes,"a, b",Rotation Type,Quaternion,Length Units,Millimeters
,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body Marker
,Name,leader,leader,leader,leader,leader,leader,leader,leader:1
,ID,1,1,1,1,1,1,1,2
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X
0,0.000000,-0.5,0.5,0.5,0.5,100,200,300,1
1,0.010000,,,,,,,,
2,0.020000,-0.5,0.5,0.5,0.5,100,200,300,1
"""
VICON = """Objects
100
,,wand:wand,,,,,,,Global Angle (Quaternion) leader:leader,,,,,,
Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ,RX,RY,RZ,RW,TX,TY,TZ
,,,,,,mm,mm,mm,,,,,mm,mm,mm
1,0,0,0,0,1,0,0,0,-0.5,0.5,0.5,0.5,100,200,300
3,0,0,0,0,1,0,0,0,-0.5,0.5,0.5,0.5,100,200,300
"""
EQUALS = {
    "euroc": f"{EUROC}\n0,{POSE}\n20000000,{POSE}",
    "mark and repeated row": f"\ufeff#{EUROC}\r\n0,{POSE}\r\n0,{POSE}\r\n20000000,{POSE}\r\n",
    "unseen": f"{EUROC}\n0,{POSE}\n10000000,,,,,,,\n20000000,{POSE}",
    "tum": "# a bag, recorded\n# timestamp tx ty tz qx qy qz qw\n"
    + "\n".join(f"{t} 0.1 0.2 0.3 -0.5 0.5 0.5 0.5" for t in (1.70, 1.72)),
    "another order": "qw,qx,qy,qz,z [mm],y,x,time_ms\n0.5,-0.5,0.5,0.5,300,200,100,0\n0.5,-0.5,0.5,0.5,300,200,100,20",
    "decimal commas": f"{EUROC}\n0,{POSE}\n20000000,{POSE}".replace(",", ";").replace(".", ","),
    "decimal commas in quotes": f"{EUROC}\n0,{POSE}\n20000000,{POSE}".replace(",", '","')
    .replace("\n", '"\n"')
    .replace(".", ",")
    .join('""'),
    "decimal commas and blanks": f"t tx ty tz qw qx qy qz\n0.0,{POSE}\n0.02,{POSE}".replace(",", " ").replace(".", ","),
    "whole seconds among others": f"time,x,y,z,qw,qx,qy,qz\n3,{POSE}\n3.02,{POSE}",
    "no time worth a number": f"t [s],x,y,z,qw,qx,qy,qz\n0e-99999999999999999999,{POSE}\n0.02,{POSE}",
    "motive": MOTIVE,
    "vicon": VICON,
}


@pytest.mark.parametrize("name", EQUALS)
def test_one_recording_in_every_format_reads_the_same(tmp_path, name):
    recording = read_recording(_file(tmp_path, EQUALS[name]), "leader")
    assert recording.t_ns.tolist() == [0, 20_000_000]
    assert np.allclose(recording.pos_mocap_m, [[0.1, 0.2, 0.3]] * 2)
    assert np.allclose(recording.q_mocap_from_marker, [[0.5, -0.5, 0.5, 0.5]] * 2)


def test_the_labs_unit_counts_only_where_the_file_names_none(tmp_path):
    assert read_recording(_file(tmp_path, f"{EUROC}\n0,{POSE}"), unit_m=0.001).pos_mocap_m[0, 0] == 0.1
    assert read_recording(_file(tmp_path, f"0,{POSE}"), unit_m=0.001).pos_mocap_m[0, 0] == pytest.approx(1e-4)


FAULTS = {
    "too many fields": (HEADER + GOOD + LATER.strip() + ",1\n", ":3: 9 columns under a header of 8"),
    "not a number": (HEADER + GOOD + LATER.replace("0.42", "here"), ":3: column 3 (y, m) is not a number"),
    "nan": (HEADER + GOOD + LATER.replace("0.42", "nan"), ":3: column 3 (y, m) = nan: a value is not finite"),
    "a part of a pose": (HEADER + GOOD + LATER.replace("0.42", ""), ":3: column 3 (y, m) is empty"),
    "a size that no number has": (
        f"t,x,y,z,qw,qx,qy,qz\n0,{POSE}\n1e999,{POSE}",
        ":3: column 1 (t, taken as ns) = 1e999",
    ),
    "a stamp of another unit": (
        f"timestamp,x,y,z,qw,qx,qy,qz\n1.7e18,{POSE}",
        ":2: column 1 (t, taken as s) = 1.7e18 is no time; name the unit in the header",
    ),
    "an open quote": (f'{EUROC}\n0,"{POSE}', ":2: a quote that is left open"),
    "no frames a second": (VICON.replace("100\n", "0\n", 1), ":2: frames a second: 1 or more"),
    "time going back": (HEADER + LATER + GOOD, ":3: time goes back, from 1413394881404401408 to 1413394881394290944"),
    "time standing": (HEADER + GOOD + GOOD.replace("1.44", "1.45"), ":3: the stamp of the row before"),
    "no rotation": (HEADER + "1,0,0,0,0,0,0,0\n", ":2: the quaternion's length is 0.000, not 1"),
    "empty": ("", ": no line of numbers in this file"),
    "unknown header": (
        f"t,x,y,z,q0,q1,q2,q3\n0,{POSE}",
        ":1: the header names no qw, qx, qy, qz; known are timestamp, time or t [s, ms, us, ns]; x, tx",
    ),
    "a name twice": (f"t,x,y,z,qw,qx,qy,qz,tx\n0,{POSE},1", ':1: columns "x" and "tx" both give x'),
    "two units": (f"t,x [mm],y [m],z,qw,qx,qy,qz\n0,{POSE}", ":1: units m, mm"),
    "unknown unit": (f"t,x [ft],y,z,qw,qx,qy,qz\n0,{POSE}", ":1: units ft: one of mm, millimeters, cm, centimeters, m"),
    "stamps in another unit": (f"{EUROC}\n0,{POSE}\n20,{POSE}", ":2: stamps 2e-08 s apart"),
    "motive in angles": (MOTIVE.replace("Quaternion", "XYZ"), ":1: exported by Motive with Euler angles"),
    "motive, another body": (
        MOTIVE.replace(",leader,leader,leader,leader,leader", ",a,b,b,b,b"),
        ":6: Motive's rigid bodies are a, b, leader;",
    ),
    "vicon in angles": (VICON.replace("RW", "RR"), ':4: "leader" has no RW: export'),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_names_the_file_and_the_line(tmp_path, fault):
    text, reason = FAULTS[fault]
    path = _file(tmp_path, text)
    with pytest.raises(MocapFileError) as raised:
        read_recording(path, "leader" if "vicon" in fault else "nobody")
    assert str(raised.value).startswith(f"{path}{reason}")


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(MocapFileError, match="/dev/zero: not a file"):
        read_recording(Path("/dev/zero"))
    with pytest.raises(MocapFileError, match=r"nowhere\.csv: No such file"):
        read_recording(tmp_path / "nowhere.csv")
    binary = tmp_path / "x.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(MocapFileError, match="not UTF-8 text"):
        read_recording(binary)
