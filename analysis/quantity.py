"""What a number of a flight is called, its unit, and how it is printed: once for every table."""

from dataclasses import dataclass

UNKNOWN = "–"
FACTORS = {"mm": 1e3, "%": 1e2}
"""By the first word of units that are not the program's own."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A field of a result, in metres or any unit; form: how it is printed in this one."""

    field: str
    name: str
    unit: str
    form: str = ".3g"

    @property
    def heading(self) -> str:
        """`RMS, mm`."""
        return f"{self.name}, {self.unit}"

    def text(self, value: float | None) -> str:
        """A value as it is printed; a dash for none."""
        return UNKNOWN if value is None else f"{FACTORS.get(self.unit.split()[0], 1.0) * value:{self.form}}"

    def of(self, result: object) -> str:
        """The field of a result, as it is printed."""
        return self.text(getattr(result, self.field))


FLIGHT = (
    Quantity("formation_rms_m", "RMS", "mm"),
    Quantity("formation_max_m", "largest", "mm"),
    Quantity("vibration_m", "vibration", "mm"),
    Quantity("altitude_rms_m", "height RMS", "mm"),
    Quantity("min_separation_m", "least separation", "mm"),
)
"""Of a flight's summary."""
