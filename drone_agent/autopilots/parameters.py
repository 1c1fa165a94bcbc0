"""A drone's parameters: what its table declares, the values that rule now, and MAVLink's view of both.

PX4 carries an integer's own bytes in the float field, ArduPilot casts it; the kind of autopilot says which.
"""

from collections.abc import Callable, Mapping
from math import isfinite

from wire.autopilots.table import AutopilotTable
from wire.link_messages import MavAutopilot, ParamType, ParamValue
from wire.mavlink.codec import param_from_raw, param_to_raw
from wire.mavlink.framing import MavlinkError


class Parameters:
    """The set, in the order of its names, as autopilots list it."""

    def __init__(self, table: AutopilotTable, values: Mapping[str, float]) -> None:
        """values: what differs from the table's defaults; ValueError for a name or a value it cannot have."""
        self._specs = tuple(sorted(table.parameters.values(), key=lambda spec: spec.name))
        self._index = {spec.name: i for i, spec in enumerate(self._specs)}
        self._values = [spec.default for spec in self._specs]
        self._autopilot = table.autopilot
        self.on_change: Callable[[], None] = lambda: None
        """Called after each change."""
        for name, value in values.items():
            if not self.set(name, value):
                raise ValueError(f"{name!r} is unknown to this autopilot, or {value:g} is no value for it")

    def __len__(self) -> int:
        return len(self._specs)

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def __getitem__(self, name: str) -> float:
        return self._values[self._index[name]]

    def set(self, name: str, value: float) -> bool:
        """Give a parameter a finite value of its type, as autopilots do without looking at the range; else False."""
        index = self._index.get(name)
        if index is None or not isfinite(value):
            return False
        try:
            raw = param_to_raw(value, self._specs[index].type, self._autopilot)
        except MavlinkError:
            return False
        stored = param_from_raw(raw, self._specs[index].type, self._autopilot)
        if stored != self._values[index]:
            self._values[index] = stored
            self.on_change()
        return True

    def set_raw(self, name: str, raw: bytes, kind: ParamType) -> bool:
        """PARAM_SET; False for an unknown name, a foreign type (PX4), or bytes that are no value."""
        index = self._index.get(name)
        if index is None:
            return False
        cast = self._autopilot is MavAutopilot.ARDUPILOT
        if not cast and kind is not self._specs[index].type:
            return False
        try:
            value = param_from_raw(raw, ParamType.REAL32 if cast else kind, self._autopilot)
        except MavlinkError:
            return False
        if cast and self._specs[index].type is not ParamType.REAL32:
            value = round(value) if abs(value) < 2.0**31 else value
        return self.set(name, value)

    def message(self, name_or_index: str | int) -> ParamValue | None:
        """PARAM_VALUE of one parameter, or None if there is no such, or nobody knows its value."""
        index = self._index.get(name_or_index, -1) if isinstance(name_or_index, str) else name_or_index
        if not 0 <= index < len(self._specs):
            return None
        spec = self._specs[index]
        if not isfinite(self._values[index]):
            return None  # a vehicle has not said it
        raw = param_to_raw(self._values[index], spec.type, self._autopilot)
        return ParamValue(spec.name, raw, spec.type, len(self._specs), index)
