"""Each camera system's own protocol over real sockets: poses in a turned room, and flights with it in the loop."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.maths.frames import canonical
from formation.messages import LabFrame, Phase, Truth
from formation.mocap_config import IN_METRES
from sim.cameras.systems import SOURCE_OF, lab_with
from sim.fly import Files
from sim.ports import private_link
from sim.processes import ProcessGroup
from sim.scenario import Scenario, load
from tests.end_to_end.flights import CIRCLE, LINE, UPSIDE_DOWN, gcs_sim_fly, write_scenario
from wire.clock import monotonic_ns
from wire.config_file import dump
from wire.logs.mcap_read import read_log
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

pytestmark = [pytest.mark.processes, pytest.mark.timeout(900)]

AWAY_S, BACK_S = 1.5, 2.0
"""How long the server is gone, and how soon after it the frames are to be back."""
TURNED = """
source = "{source}"
axes = ["x right", "y up", "z back"]
origin_lab_m = [0.3, -0.2, 0.1]
unit = "{unit}"
names = {{ "{leader}" = "leader" }}
"""


STANDING = {
    1: ([1.0, 2.0, 0.5], [0.5, 0.5, 0.5, 0.5]),
    2: ([-1.0, 0.25, 1.5], [0.8, 0.6, 0.0, 0.0]),
    3: ([0.0, -3.0, 1.0], [0.8, 0.0, 0.0, -0.6]),
}
"""Where the drones are, by sysid: pos_lab_m and q_lab_from_flu."""
FRAMES = 50
NEAR_M, NEAR_RAD = 0.0005, 0.002
"""Of the mean pose of so many frames; the emulated cameras' noise is 0.1 mm and 1 mrad."""


async def frames_of(scenario: Scenario, protocol: str, folder: Path) -> list[LabFrame]:
    """What the mocap process publishes of standing drones, by a served camera system's protocol."""
    frames: list[LabFrame] = []
    with private_link("zenoh", ()) as link:
        lab = lab_with(scenario.lab.model_copy(update={"link": link}), protocol)
        files = Files(folder)
        files.lab.write_text(dump(lab))
        files.scenario.write_text(dump(scenario.model_copy(update={"lab": lab})))
        async with ProcessGroup(folder) as group:
            await group.start("cameras", "sim", ["mocap", str(files.scenario)])
            await group.start("mocap", "gcs", ["mocap", str(files.lab)])
            bus = await ZenohBus.open(link, lab.name)
            MocapBus(bus).on_frame(frames.append)
            while sum(frame.seen.all() for frame in frames) < FRAMES:
                for sysid, (pos, q) in STANDING.items():
                    still = np.zeros(3)
                    bus.publish_truth(
                        Truth(monotonic_ns(), sysid, np.array(pos), still, np.array(q), still, still, True)
                    )
                await asyncio.sleep(0.01)
            await bus.close()
    return [frame for frame in frames if frame.seen.all()]


@pytest.mark.parametrize("protocol", sorted(SOURCE_OF))
def test_in_a_turned_room_poses_are_where_the_drones_are(protocol: str, tmp_path: Path) -> None:
    source, leader = SOURCE_OF[protocol], "307" if protocol == "chingmu" else "Quad 1"
    unit = "m" if source in IN_METRES else "mm"
    file = write_scenario(tmp_path, LINE, TURNED.format(source=source, leader=leader, unit=unit), UPSIDE_DOWN)
    scenario = load(str(file))
    frames = asyncio.run(frames_of(scenario, protocol, tmp_path))
    assert {frame.bodies for frame in frames} == {tuple(vehicle.body for vehicle in scenario.lab.vehicles)}
    pos_lab_m = np.mean([frame.pos_lab_m for frame in frames], axis=0)
    q_lab_from_flu = np.mean([canonical(frame.q_lab_from_flu) for frame in frames], axis=0)
    for row, vehicle in enumerate(scenario.lab.vehicles):
        pos, q = STANDING[vehicle.sysid]
        np.testing.assert_allclose(pos_lab_m[row], pos, atol=NEAR_M)
        np.testing.assert_allclose(q_lab_from_flu[row], canonical(np.array(q)), atol=NEAR_RAD)


@pytest.mark.flights
def test_a_server_that_is_gone_for_a_while_makes_them_hold_then_land_and_the_landing_ends_on_mocap(
    tmp_path: Path,
) -> None:
    gone = f"[{{ at_s = 1.5, for_s = {AWAY_S} }}]"
    with gcs_sim_fly(
        str(write_scenario(tmp_path, CIRCLE, gaps=gone)), "--mocap", "natnet", "--out", str(tmp_path / "run")
    ) as process:
        process.communicate()
    log = read_log(tmp_path / "run" / "flight.mcap")
    frames = [(entry.t_ns, entry.message) for entry in log.entries if entry.topic is topics.MOCAP]
    changes = [(entry.t_ns, entry.message) for entry in log.entries if entry.topic is topics.PHASE]
    formed_ns = next(t_ns for t_ns, change in changes if change.phase is Phase.FORMATION)
    captured = np.array([frame.t_capture_ns for _, frame in frames if frame.seen.all()])
    in_formation = captured[captured > formed_ns]
    dark = int(np.argmax(np.diff(in_formation)))
    last_ns, back_ns = in_formation[dark], in_formation[dark + 1]
    assert AWAY_S < (back_ns - last_ns) * 1e-9 < AWAY_S + BACK_S
    held_s, landed_s = (
        (next(t_ns for t_ns, change in changes if t_ns > last_ns and change.phase is phase) - last_ns) * 1e-9
        for phase in (Phase.HOLD, Phase.LAND)
    )
    assert 0.2 <= held_s < 0.4
    assert 0.4 <= landed_s < 0.6
    assert changes[-1][1].phase is Phase.GROUND
    assert captured[-1] > changes[-1][0] - 500_000_000
