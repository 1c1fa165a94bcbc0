"""The campaign's labs: short flights of a leader and some followers that still go through every phase."""

from collections.abc import Mapping
from math import ceil, sqrt
from types import MappingProxyType
from typing import Literal

from formation.config import (
    Fence,
    FlightConfig,
    FollowerConfig,
    LabConfig,
    LeaderConfig,
    LimitsConfig,
    TrajectoryConfig,
)
from formation.messages import Verb
from formation.model import Vec3Tuple
from sim.scenario import ObservedLeader, Pose, Scenario, TrueVehicle
from sim.script import Step

Kind = Literal["hold", "line", "circle", "turning", "shapes", "observed"]
KINDS: tuple[Kind, ...] = ("hold", "line", "circle", "turning", "shapes", "observed")
Autopilot = Literal["px4", "ardupilot"]

FORMATION_S = 5.0
DEFAULT_PROFILE = "paper_40g"
ALTITUDE_M = 1.0
SPACING_M = 0.6
SCRIPT = (
    Step(verb=Verb.ARM, phase="GROUND"),
    Step(verb=Verb.TAKEOFF, phase="ARMED"),
    Step(verb=Verb.START, phase="HOLD", after_s=0.2),
)
TRAJECTORIES: Mapping[Kind, TrajectoryConfig] = MappingProxyType(
    {
        "hold": TrajectoryConfig(kind="hold", duration_s=4.0),
        "line": TrajectoryConfig(kind="line", length_m=0.6, duration_s=3.0),
        "circle": TrajectoryConfig(kind="circle", radius_m=0.3, period_s=4.0, duration_s=4.0),
        "turning": TrajectoryConfig(kind="hold", duration_s=4.0, yaw_rate_rad_s=0.5),
        "shapes": TrajectoryConfig(kind="hold", duration_s=4.0),
        "observed": TrajectoryConfig(),
    }
)


def scenario(
    kind: Kind = "circle",
    followers: int = 2,
    autopilot: Autopilot = "px4",
    *,
    profile: str = DEFAULT_PROFILE,
    altitude_m: float = ALTITUDE_M,
) -> Scenario:
    """A flight without faults: up, a formation of some seconds, down; by `sim.proof.flight`."""
    observed = kind == "observed"
    at_m = (0.3, 0.0, 0.0) if kind == "circle" else (0.0, 0.0, 0.0)
    leader = LeaderConfig(
        body="leader", sysid=None if observed else 1, profile=profile, trajectory=TRAJECTORIES[kind], spawn_lab_m=at_m
    )
    slots = _slots(followers)
    names = tuple(f"f{i + 2}" for i in range(followers))
    reach_m = max(2.5, 1.2 + max(abs(x) for slot in slots for x in slot))
    lab = LabConfig(
        leader=leader,
        followers=tuple(
            FollowerConfig(body=name, sysid=i + 2, offset_m=slot, profile=profile)
            for i, (name, slot) in enumerate(zip(names, slots, strict=True))
        ),
        limits=LimitsConfig(fence=Fence(low_m=(-reach_m, -reach_m, -0.1), high_m=(reach_m, reach_m, 2.3))),
        flight=FlightConfig(altitude_m=altitude_m, climb_m_s=0.6, descend_m_s=0.4),
    )
    shape = (Step(verb=Verb.SHAPE, phase="FORMATION", after_s=1.5, argument="line"),) if kind == "shapes" else ()
    sysids = [v.sysid for v in lab.vehicles if v.sysid is not None]
    starts = {1: Pose(pos_lab_m=at_m)}
    return Scenario(
        name=f"campaign_{kind}",
        formation_s=FORMATION_S,
        lab=lab,
        vehicles=tuple(TrueVehicle(sysid=sysid, autopilot=autopilot, start=starts.get(sysid)) for sysid in sysids),
        leader=ObservedLeader(pose=Pose(pos_lab_m=(0.0, 0.0, altitude_m))),
        script=SCRIPT + shape,
    )


def _slots(followers: int) -> tuple[Vec3Tuple, ...]:
    """Rows behind the leader, as wide as they are deep."""
    wide = max(ceil(sqrt(followers)), 2)
    slots = []
    for i in range(followers):
        row, column = divmod(i, wide)
        here = min(wide, followers - row * wide)
        slots.append((-SPACING_M * (row + 1), SPACING_M * (column - 0.5 * (here - 1)), 0.0))
    return tuple(slots)
