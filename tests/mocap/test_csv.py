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


def test_further_columns_and_a_header_without_a_mark_are_left_alone(tmp_path):
    text = "timestamp,x,y,z,qw,qx,qy,qz,vx\n" + GOOD.strip() + ",0.1\r\n" + LATER.strip() + ",nan\n"
    assert len(read_recording(_file(tmp_path, text)).t_ns) == 2


FAULTS = {
    "too few fields": (HEADER + GOOD + "1,2,3\n", ":3: 3 fields, expected 8"),
    "too many fields": (HEADER + GOOD + LATER.strip() + ",1\n", ":3: 9 fields, expected 8"),
    "not a number": (HEADER + GOOD + LATER.replace("0.42", "here"), ":3: not a number: could not convert"),
    "stamp with a point": (HEADER + "1.5,0,0,0,1,0,0,0\n", ":2: not a number: invalid literal"),
    "nan": (HEADER + GOOD + LATER.replace("0.42", "nan"), ":3: a value is not finite"),
    "infinite": (HEADER + GOOD + LATER.replace("0.42", "-inf"), ":3: a value is not finite"),
    "time going back": (HEADER + LATER + GOOD, ":3: time goes back, from 1413394881404401408 to 1413394881394290944"),
    "time standing": (HEADER + GOOD + GOOD, ":3: time goes back"),
    "no rotation": (HEADER + "1,0,0,0,0,0,0,0\n", ":2: the quaternion's length is 0.000, not 1"),
    "empty": ("", ": no poses in this file"),
    "header alone": (HEADER, ": no poses in this file"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_names_the_file_and_the_line(tmp_path, fault):
    text, reason = FAULTS[fault]
    path = _file(tmp_path, text)
    with pytest.raises(MocapFileError) as raised:
        read_recording(path)
    assert str(raised.value).startswith(f"{path}{reason}")


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(MocapFileError, match=r"nowhere\.csv: No such file"):
        read_recording(tmp_path / "nowhere.csv")
    binary = tmp_path / "x.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(MocapFileError, match="not a text file"):
        read_recording(binary)
