"""The policy of an ONNX file as a law; the files are written here, by the format's own numbers (onnx.proto)."""

from pathlib import Path

import numpy as np
import pytest

from formation.maths.arrays import Float
from sim.research import league
from sim.research.laws import chosen
from sim.research.league import Row

pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: pip install 'mavlink-formation[research]'")

LAW = Path(__file__).parents[3] / "examples" / "laws" / "policy.py"
PD = np.hstack([-12.0 * np.eye(3), -6.0 * np.eye(3), np.eye(3), -np.eye(3)])
"""What `policy.onnx` is: acceleration (3) of off, fast, slot's acceleration, disturbance (12)."""


def number(key: int, value: int) -> bytes:
    return bytes([key << 3, value])


def part(key: int, inside: bytes | str) -> bytes:
    data = inside.encode() if isinstance(inside, str) else inside
    length = bytes([len(data)]) if len(data) < 128 else bytes([len(data) & 127 | 128, len(data) >> 7])
    return bytes([key << 3 | 2]) + length + data


def tensor_of(name: str, width: int) -> bytes:
    shape = b"".join(part(1, number(1, size)) for size in (1, width))
    return part(1, name) + part(2, part(1, number(1, 1) + part(2, shape)))


def linear(gains: Float) -> bytes:
    """A model of one MatMul: (1, n) by the transposed gains (m, n)."""
    m, n = gains.shape
    weights = number(1, n) + number(1, m) + number(2, 1) + part(8, "w") + part(9, gains.T.astype("<f4").tobytes())
    node = part(1, "x") + part(1, "w") + part(2, "y") + part(4, "MatMul")
    graph = part(1, node) + part(2, "policy") + part(5, weights)
    return (
        number(1, 8)
        + part(7, graph + part(11, tensor_of("x", n)) + part(12, tensor_of("y", m)))
        + part(8, number(2, 13))
    )


def test_the_shipped_policy_is_the_one_that_is_written_here_and_flies() -> None:
    assert LAW.with_name("policy.onnx").read_bytes() == linear(PD)
    result = league.fly(Row(chosen(str(LAW)), "circle", "paper_40g"))
    assert result.outcome == "held"
    assert result.rms_m is not None
    assert result.rms_m < 0.002


def test_what_is_no_policy_is_named_with_what_is_wanted(tmp_path: Path) -> None:
    cases = {
        "absent.onnx": (None, "no such file; the option `file`"),
        "text.onnx": (b"no network", r"no policy of one float32 input \(1, 12\)"),
        "narrow.onnx": (linear(PD[:, :11]), r"no policy of one float32 input \(1, 12\)"),
        "flat.onnx": (linear(PD[:2]), r"shape \(1, 2\): \(1, 3\) is wanted"),
    }
    for name, (data, text) in cases.items():
        if data is not None:
            (tmp_path / name).write_bytes(data)
        law = league.rows(
            [chosen(str(LAW))], ["line"], ["paper_40g"], {"policy.py": {"paper_40g": {"file": str(tmp_path / name)}}}
        )
        with pytest.raises(ValueError, match=f"{name}.*{text}"):
            law[0].law.maker()
