"""What an operator may say of a shape, `NAME [scale=S] [heading=DEGREES]`: the one place that writes and reads it."""

from dataclasses import dataclass
from math import degrees, isfinite, radians

SCALE_MAX, HEADING_MOST = 100.0, 360.0
USAGE = "a shape is asked for as NAME [scale=S] [heading=DEGREES]"


@dataclass(frozen=True, slots=True)
class ShapeRequest:
    """A shape by name, how much larger than usual, and turned by how much about the leader, to the left."""

    name: str
    scale: float = 1.0
    heading_rad: float = 0.0

    @property
    def text(self) -> str:
        """As `parse` reads it; what is usual is left out."""
        scale = f" scale={self.scale:g}" if self.scale != 1.0 else ""
        heading = f" heading={degrees(self.heading_rad):g}" if self.heading_rad != 0.0 else ""
        return f"{self.name}{scale}{heading}"


def parse(text: str) -> ShapeRequest:
    """The request in an operator's words; ValueError says what is not understood, and what would be."""
    name, *rest = text.split() or [""]
    values: dict[str, float] = {}
    for word in rest:
        key, equals, value = word.partition("=")
        if key not in ("scale", "heading") or not equals or key in values:
            raise ValueError(f"{word!r} is not understood; {USAGE}")
        values[key] = _number(key, value)
    scale, heading = values.get("scale", 1.0), values.get("heading", 0.0)
    if not 0.0 < scale <= SCALE_MAX:
        raise ValueError(f"scale is {scale:g}; it must be above 0 and at most {SCALE_MAX:g}")
    if abs(heading) > HEADING_MOST:
        raise ValueError(f"heading is {heading:g}; it is in degrees, at most a whole turn, {HEADING_MOST:g}")
    return ShapeRequest(name, scale, radians(heading))


def _number(key: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError as error:
        raise ValueError(f"{key} is {value!r}, not a number; {USAGE}") from error
    if not isfinite(number):
        raise ValueError(f"{key} is {value!r}, not a finite number; {USAGE}")
    return number
