"""How Rerun shows a formation flight: the room in 3-D, the drones' states, batteries and links, the log."""

from collections.abc import Sequence
from typing import Any


def rerun_blueprint(bodies: Sequence[str]) -> Any:
    """The blueprint for these bodies, leader first; ImportError where rerun-sdk is missing."""
    import rerun.blueprint as rrb

    drones = [rrb.DataframeView(origin=f"/drone/{body}/state", name=f"{body}: state") for body in bodies]
    links = [rrb.DataframeView(origin=f"/drone/{body}/link", name=f"{body}: battery and link") for body in bodies]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="/", name="Room"),
            rrb.Vertical(rrb.Tabs(*drones), rrb.Tabs(*links), rrb.TextLogView(origin="/log", name="Log")),
            column_shares=[3, 2],
        )
    )
