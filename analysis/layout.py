"""A Foxglove layout and a Rerun blueprint for a formation flight: the room in 3-D, the drones' states, the log."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from formation.config import LabConfig
from mavlink_formation.installation import install_command
from wire.config_file import load as load_lab
from wire.logs import COLOURS
from wire.logs.mcap_read import lab_of, read_log
from wire.logs.mcap_scan import LogError
from wire.logs.scene import rerun_blueprint

USUAL = ("leader", "right", "left")
FOXGLOVE, RERUN = ".json", ".rbl"


def bodies_of(source: Path | None) -> tuple[str, ...]:
    """The lab's bodies, leader first, by a lab file or a log. OSError, LogError, ConfigError (a ValueError)."""
    if source is None:
        return USUAL
    if source.suffix == ".toml":
        return _bodies(load_lab(source, LabConfig))
    lab = lab_of(read_log(source).metadata)
    if lab is None:
        raise LogError(f"{source}: holds no lab's configuration")
    return _bodies(lab)


def _bodies(lab: LabConfig) -> tuple[str, ...]:
    return tuple(vehicle.body for vehicle in lab.vehicles)


def write(path: Path, source: Path | None) -> None:
    """A Foxglove layout (.json) or a Rerun blueprint (.rbl, needs rerun-sdk). OSError; LogError for other names.

    source: as for `bodies_of`; of a blueprint a log, since Rerun applies it to the recording of that file's name.
    """
    bodies = bodies_of(source)
    if path.suffix == FOXGLOVE:
        path.write_text(json.dumps(foxglove(bodies), indent=2), encoding="utf-8")
    elif path.suffix == RERUN and source is not None and source.suffix == ".mcap":
        _write_rerun(path, bodies, source.stem)
    elif path.suffix == RERUN:
        raise LogError(f"{path}: a blueprint for Rerun is of a log: gcs-log layout FLIGHT.MCAP --out {path}")
    else:
        raise LogError(f"{path}: ends in neither {FOXGLOVE} (Foxglove) nor {RERUN} (Rerun)")


def foxglove(bodies: Sequence[str]) -> dict[str, Any]:
    """The layout: 3-D at the left, errors, heights, batteries, setpoint ages and the log at the right."""
    plots = {
        "Plot!error": ("Formation error, lead, m", _paths(bodies, "state.err.x", "state.err.y", "state.err.z")),
        "Plot!height": ("Height and reference, m", _paths(bodies, "state.pos.z", "state.ref.z")),
        "Plot!thrust": ("Thrust", _paths(bodies, "state.thrust")),
        "Plot!battery": ("Battery, V", _paths(bodies, "link.battery_v")),
        "Plot!age": ("Setpoint age, ms", _paths(bodies, "link.setpoint_age_ms")),
    }
    panels: dict[str, Any] = {
        "3D!room": {
            "followTf": "lab",
            "fixedFrame": "lab",
            "cameraState": {
                "distance": 6.0, "perspective": True, "phi": 55.0, "thetaOffset": 135.0,
                "targetOffset": [0.0, 0.0, 0.3], "fovy": 45.0, "near": 0.1, "far": 500.0,
                "target": [0.0, 0.0, 0.0], "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            },
            "scene": {"transforms": {"axisScale": 0.3, "showLabel": False}},
            "topics": {"/scene": {"visible": True}, "/scene/trails": {"visible": True}},
            "layers": {
                "grid": {
                    "instanceId": "grid", "layerId": "foxglove.Grid", "label": "Grid", "frameId": "lab",
                    "visible": True, "size": 6.0, "divisions": 12,
                }
            },
        },
        "Log!lines": {"topicToRender": "/log", "minLogLevel": 1},
    }  # fmt: skip
    for panel, (title, paths) in plots.items():
        panels[panel] = {
            "title": title, "paths": paths, "showLegend": True, "legendDisplay": "floating", "showXAxisLabels": True,
            "showYAxisLabels": True, "isSynced": True, "xAxisVal": "timestamp", "followingViewWidth": 30.0,
        }  # fmt: skip
    right: Any = "Log!lines"
    share = 18.0
    for count, panel in enumerate(reversed(plots), start=1):
        right = {
            "direction": "column",
            "first": panel,
            "second": right,
            "splitPercentage": max(100.0 / (count + 1), share),
        }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1.0},
        "layout": {"direction": "row", "first": "3D!room", "second": right, "splitPercentage": 52.0},
    }


def _paths(bodies: Sequence[str], *fields: str) -> list[dict[str, Any]]:
    """One line a body and field: `/drone/left/state.pos.z`."""
    return [
        {
            "value": f"/drone/{body}/{field}", "enabled": True, "timestampMethod": "receiveTime",
            "label": f"{body} {field.split('.', 1)[1]}", "color": COLOURS[i % len(COLOURS)],
        }
        for i, body in enumerate(bodies)
        for field in fields
    ]  # fmt: skip


def _write_rerun(path: Path, bodies: Sequence[str], application: str) -> None:
    try:
        blueprint = rerun_blueprint(bodies)
    except ImportError as error:
        raise LogError(f"{path}: needs rerun-sdk: {install_command('live')}") from error
    blueprint.save(application, str(path))
