"""How Rerun shows a formation flight: the room in 3-D, the drones' states, batteries and links, the log."""

from collections.abc import Sequence
from typing import Any

from wire.logs.scene import LAB


def rerun_blueprint(bodies: Sequence[str]) -> Any:
    """The blueprint for these bodies, leader first; ImportError where rerun-sdk is missing."""
    import rerun.blueprint as rrb

    drones = [rrb.DataframeView(origin=f"/drone/{body}/state", name=f"{body}: state") for body in bodies]
    links = [rrb.DataframeView(origin=f"/drone/{body}/link", name=f"{body}: battery and link") for body in bodies]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                name="Room",
                spatial_information=rrb.SpatialInformation(target_frame=LAB),
                eye_controls=rrb.EyeControls3D(position=(-2.2, -1.6, 1.6), look_target=(0.0, 0.0, 0.3)),
            ),
            rrb.Vertical(rrb.Tabs(*drones), rrb.Tabs(*links), rrb.TextLogView(origin="/log", name="Log")),
            column_shares=[3, 2],
        )
    )


def show_bodies(bodies: Sequence[str]) -> None:
    """Mark each body in Rerun's room, where the log's transforms have it: a point with its name, and its axes.

    Rerun reads transforms, and no Foxglove scenes: without this its room is empty.
    """
    import rerun

    for i, body in enumerate(bodies):
        colour = (240, 228, 66) if i == 0 else (86, 180, 233)
        mark = rerun.Points3D([(0.0, 0.0, 0.0)], radii=0.03, colors=colour, labels=body)
        rerun.log(f"/room/{body}", rerun.CoordinateFrame(body), mark, rerun.TransformAxes3D(0.15), static=True)
