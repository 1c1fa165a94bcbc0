"""A lab file as a simulated flight: everything of it but what is real, the drones, their links and the cameras."""

from typing import Any

from formation.config import LabConfig
from formation.guidance.preview import expected_start
from formation.mocap_config import CAMERA_SYSTEMS, MocapConfig

HELD_S = 8.0
"""How long the formation is held behind a leader that is only observed: it stands, so its way never ends."""


def with_stand_ins(lab: LabConfig) -> LabConfig:
    """The lab with simulated drones on the shared link and emulated cameras on the bus; the rest as the file has it."""
    cameras: dict[str, object] = dict.fromkeys(CAMERA_SYSTEMS)
    mocap = lab.mocap.model_copy(update=cameras | {"source": "zenoh", "file": None, "unit": None, "names": {}})
    followers = tuple(follower.model_copy(update={"link": None}) for follower in lab.followers)
    leader = lab.leader.model_copy(update={"link": None})
    operator = lab.operator.model_copy(update={"stop_button": None})
    real = {"mocap": mocap, "leader": leader, "followers": followers, "operator": operator, "security": None}
    return lab.model_copy(update=real)


def stand_ins(lab: LabConfig) -> str:
    """The simulated parts, and the lab's own parts that they replace, in one line."""
    links = [f"{vehicle.body} at {vehicle.link}" for vehicle in lab.vehicles if vehicle.link is not None]
    lines = ["simulated drones" + (f" instead of {', '.join(links)}" if links else "")]
    lines.append("emulated cameras" + (f" instead of {_source(lab.mocap)}" if lab.mocap.source != "zenoh" else ""))
    if lab.operator.stop_button is not None:
        lines.append(f"no stop button {lab.operator.stop_button.device}")
    return ", ".join(lines)


def scenario_values(lab: LabConfig, values: dict[str, Any]) -> dict[str, Any]:
    """The keys of a scenario that flies this lab: those in `values`, and what the lab decides where they are silent."""
    cameras: dict[str, Any] = {"rate_hz": lab.mocap.rate_hz, "delay_s": lab.mocap.delay_s}
    made: dict[str, Any] = {"lab": with_stand_ins(lab)}
    if isinstance(values.get("mocap", {}), dict):
        made["mocap"] = cameras | values.get("mocap", {})
    if isinstance(values.get("vehicles", []), list):
        made["vehicles"] = _at_start_positions(lab, values.get("vehicles", []))
    if lab.leader.sysid is None:
        x, y, z, yaw_rad = expected_start(lab).tolist()
        held = {"formation_s": HELD_S, "leader": {"pose": {"pos_lab_m": (x, y, z), "yaw_rad": yaw_rad}}}
        moves = isinstance(values.get("leader"), dict) and "file" in values["leader"]
        values = ({"leader": held["leader"]} if moves else held) | values
    return values | made


def _at_start_positions(lab: LabConfig, configured: list[Any]) -> list[Any]:
    """The drones where the lab file expects them to start, unless the scenario says where."""
    starts = {lab.leader.sysid: (lab.leader.spawn_lab_m, lab.leader.spawn_yaw_rad)}
    starts |= {f.sysid: (f.spawn_lab_m, 0.0) for f in lab.followers if "spawn_lab_m" in f.model_fields_set}
    tables = {table.get("sysid"): table for table in configured if isinstance(table, dict)}
    for sysid, (start_lab_m, yaw_rad) in starts.items():
        if sysid is not None:
            start = {"pos_lab_m": (start_lab_m[0], start_lab_m[1], 0.0), "yaw_rad": yaw_rad}
            tables[sysid] = {"sysid": sysid, "start": start} | tables.get(sysid, {})
    return [*tables.values(), *(table for table in configured if not isinstance(table, dict))]


def _source(mocap: MocapConfig) -> str:
    """The lab's own, with its address or file."""
    table = getattr(mocap, mocap.source, None)
    where = mocap.file or getattr(table, "host", "")
    return f"{mocap.source} {where}".strip()
