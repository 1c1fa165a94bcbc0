"""A flight as a short animation, for a README or a talk: paths in 3-D, the formation as it turns, its error below."""

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from analysis.load import Flight, load
from analysis.plots import motion, style
from analysis.tracking import airborne, track
from wire.logs.mcap_scan import LogError

FRAMES, FRAME_MS, INK_COLOURS = 80, 90, 64
"""Of any flight: so its file stays under 3 MB, which the tests hold."""


def animation(path_mcap: Path, path_gif: Path) -> Path:
    """Draw a log's flight, from take-off to landing, into a GIF; returns where. Raises as `analysis.load.load`."""
    flight = load(path_mcap)
    if not len(flight.poses):
        raise LogError(f"{path_mcap}: holds no pose to draw")
    with style.styled():
        first, *others = _Scene(flight).images()
    buffer = BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=FRAME_MS, loop=0)
    path_gif.write_bytes(buffer.getvalue())
    return path_gif


class _Scene:
    """One figure, of which only what moves is drawn anew."""

    def __init__(self, flight: Flight) -> None:
        poses = flight.poses
        self._t_s = poses.t_s
        self._pos_lab_m = np.where(poses.seen[..., None], poses.pos_lab_m, np.nan)
        flying = np.flatnonzero(airborne(flight, poses.t_s))
        ends = (int(flying[0]), int(flying[-1])) if len(flying) else (0, len(poses) - 1)
        self._chosen = np.linspace(*ends, FRAMES).astype(int)
        fig = Figure(figsize=(6.6, 5.6))
        self._canvas = FigureCanvasAgg(fig)
        space = fig.add_axes((0.0, 0.27, 1.0, 0.73), projection="3d")
        motion.draw_space(space, flight)
        for path in space.get_lines():
            path.set_alpha(0.15)
        space.legend(loc="upper left")
        colours = style.colours(len(flight.vehicles))
        self._trails = [space.plot([], [], [], color=colour, lw=1.6)[0] for colour in colours]
        self._dots = [space.plot([], [], [], "o", color=colour, ms=6)[0] for colour in colours]
        (self._shape,) = space.plot([], [], [], color=style.SOFT, lw=1.2)
        error = fig.add_axes((0.1, 0.1, 0.87, 0.17))
        tracking = track(flight)
        if tracking.formed.any():
            motion.draw_error(error, flight, tracking, 1e3 * np.linalg.norm(tracking.error_lead_m, axis=-1))
        begin_s, self._end_s = (float(self._t_s[k]) for k in ends)
        style.time_axis(error, begin_s, self._end_s)
        error.set(ylabel="error, mm", ylim=(0.0, None))
        self._ahead = error.axvspan(begin_s, self._end_s, color="white", alpha=0.85, zorder=9)

    def images(self) -> list[Image.Image]:
        """The frames, each in the colours of the last, where all are in view."""
        rgb = [self._drawn(k) for k in self._chosen]
        palette = rgb[-1].quantize(INK_COLOURS)
        return [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in rgb]

    def _drawn(self, k: int) -> Image.Image:
        trails_lab_m = self._pos_lab_m[self._chosen[0] : k + 1 : 3]
        now_lab_m = self._pos_lab_m[k]
        for i, (trail, dot) in enumerate(zip(self._trails, self._dots, strict=True)):
            trail.set_data_3d(*trails_lab_m[:, i].T)  # type: ignore[attr-defined]
            dot.set_data_3d(*now_lab_m[i : i + 1].T)  # type: ignore[attr-defined]
        self._shape.set_data_3d(  # type: ignore[attr-defined]
            *np.concatenate((now_lab_m, now_lab_m[:1])).T
        )
        self._ahead.set(x=self._t_s[k], width=self._end_s - self._t_s[k])
        self._canvas.draw()  # type: ignore[no-untyped-call]
        rgba = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        return Image.fromarray(rgba).convert("RGB")
