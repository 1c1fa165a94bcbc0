"""Turned camera axes: flies the same lab with other mocap axes, another origin and turned marker frames.

`python -m tools.camera_axes [--leader-csv FILE] [SCENARIO ...]` flies every shipped scenario in all of them
(`make camera-axes`).
"""

from argparse import ArgumentParser
from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

import numpy as np

from formation import topics
from formation.maths import frames
from formation.maths.arrays import Float
from formation.model import NO_ROTATION, QuatTuple, Vec3Tuple
from mocap.sources.csv_file import read_recording
from sim import lockstep
from sim.scenario import Scenario, load, with_leader_file
from sim.shipped import shipped

HALF = sqrt(0.5)


@dataclass(frozen=True, slots=True)
class AxesConvention:
    """How the cameras' axes lie in the lab, and every body's marker frame on it."""

    q_lab_from_mocap: QuatTuple = NO_ROTATION
    origin_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    q_marker_from_flu: QuatTuple = NO_ROTATION


def _about_z(angle_rad: float) -> QuatTuple:
    return cos(angle_rad / 2), 0.0, 0.0, sin(angle_rad / 2)


CAMERA_AXES: Mapping[str, AxesConvention] = MappingProxyType(
    {
        "30 degrees about z": AxesConvention(_about_z(pi / 6)),
        "90 degrees about z": AxesConvention(_about_z(pi / 2)),
        "180 degrees about z": AxesConvention(_about_z(pi)),
        "y up": AxesConvention((HALF, HALF, 0.0, 0.0)),
        "arbitrary": AxesConvention((0.7, -0.1, 0.5, sqrt(0.25)), (1.0, -2.0, 0.3), (0.5, 0.5, -0.5, 0.5)),
    }
)


def with_camera_axes(scenario: Scenario, axes: AxesConvention, folder: Path) -> Scenario:
    """The same flight in those camera axes; a recorded leader's file is written again into `folder`."""
    lab = scenario.lab
    turned = {"q_marker_from_flu": axes.q_marker_from_flu}
    mocap = {"q_lab_from_mocap": axes.q_lab_from_mocap, "origin_lab_m": axes.origin_lab_m}
    file = scenario.leader.file
    if file is not None:
        file = str(_turn_recording(Path(file), scenario, axes, folder / "leader.csv"))
    return scenario.model_copy(
        update={
            "lab": lab.model_copy(
                update={
                    "mocap": lab.mocap.model_copy(update=mocap),
                    "leader": lab.leader.model_copy(update=turned),
                    "followers": tuple(f.model_copy(update=turned) for f in lab.followers),
                }
            ),
            "leader": scenario.leader.model_copy(update={"file": file}),
        }
    )


def _turn_recording(path: Path, scenario: Scenario, axes: AxesConvention, out: Path) -> Path:
    """The leader's recording as cameras with those axes would have made it."""
    recording, mocap = read_recording(path), scenario.lab.mocap
    q_lab_from_mocap = np.array(mocap.q_lab_from_mocap)
    pos_lab_m = frames.rotate(q_lab_from_mocap, recording.pos_mocap_m) + np.array(mocap.origin_lab_m)
    q_lab_from_marker = frames.multiply(q_lab_from_mocap, recording.q_mocap_from_marker)
    q_lab_from_flu = frames.multiply(q_lab_from_marker, np.array(scenario.lab.leader.q_marker_from_flu))
    back = frames.inverse(np.array(axes.q_lab_from_mocap))
    pos = frames.rotate(back, pos_lab_m - np.array(axes.origin_lab_m))
    q = frames.multiply(frames.multiply(back, q_lab_from_flu), frames.inverse(np.array(axes.q_marker_from_flu)))
    rows = (
        f"{t}," + ",".join(map(repr, [*p, *r]))
        for t, p, r in zip(recording.t_ns, pos.tolist(), q.tolist(), strict=True)
    )
    out.write_text("\n".join(rows), encoding="utf-8")
    return out


def paths_of(scenario: Scenario, seed: int = 7) -> tuple[str, dict[int, Float]]:
    """How the flight ended, and each drone's true positions, (T, 3) in lab."""
    flown, records = lockstep.run_in_memory(scenario, seed)
    paths: dict[int, list[Float]] = {}
    for record in records:
        if record.topic is topics.TRUTH:
            paths.setdefault(record.message.sysid, []).append(record.message.pos_lab_m)
    return flown.outcome.result, {sysid: np.array(path) for sysid, path in paths.items()}


def max_distance_m(one: dict[int, Float], other: dict[int, Float]) -> float:
    """The largest distance between the same drone at the same time in two flights."""
    assert {sysid: path.shape for sysid, path in one.items()} == {sysid: path.shape for sysid, path in other.items()}
    return max(float(np.abs(one[sysid] - other[sysid]).max()) for sysid in one)


def main(names: list[str], leader_csv: Path | None) -> None:
    """Fly and print a line a flight."""
    for name in names or shipped():
        scenario = load(name)
        if scenario.needs_leader_file and leader_csv is not None:
            scenario = with_leader_file(scenario, str(leader_csv))
        if scenario.needs_leader_file and scenario.leader.file is None:
            print(f"{name}: needs a recorded leader, see --leader-csv")
            continue
        outcome, plain = paths_of(scenario)
        print(f"{name}: {outcome}", flush=True)
        for axes, convention in CAMERA_AXES.items():
            with TemporaryDirectory() as folder:
                turned, paths = paths_of(with_camera_axes(scenario, convention, Path(folder)))
            print(f"    {axes}: {turned}, {max_distance_m(plain, paths):.1e} m from the plain flight", flush=True)


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO")
    parser.add_argument("--leader-csv", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    main(arguments.scenarios, arguments.leader_csv)
