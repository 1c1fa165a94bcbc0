"""A law that a study flies, by its name: a control preset, a registered own law, or an own law's Python file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from inspect import signature
from pathlib import Path
from typing import Any

from formation.config import LabConfig
from formation.control.presets import PRESETS, Preset, preset_for
from formation.own_law.flight import OwnLaws
from formation.own_law.law import ControlLaw
from wire.files import read_toml
from wire.lab_surroundings import law_in_file, law_of

TABLES = ("law", "observer")


@dataclass(frozen=True, slots=True)
class ChosenLaw:
    """One law with its gains; it is made anew in every process that flies it.

    name: of a preset, of a registered own law, or the file of one. law: options of an own law, or gains of a preset's
    followers; observer: of their horizontal observer. Both instead of what the law or preset has.
    """

    name: str
    law: tuple[tuple[str, Any], ...] = ()
    observer: tuple[tuple[str, Any], ...] = ()

    @property
    def label(self) -> str:
        """A short name for tables."""
        return Path(self.name.partition(":")[0]).name if self.is_file else self.name

    @property
    def is_file(self) -> bool:
        """Whether it is the law of a Python file."""
        return self.name.partition(":")[0].endswith(".py")

    @property
    def is_preset(self) -> bool:
        """Whether it is one of the built-in laws."""
        return self.name in PRESETS

    def lab(self, lab: LabConfig) -> LabConfig:
        """The lab flown by it; an own law's take-off, hold and landing are the default preset's."""
        preset = self.name if self.is_preset else "default"
        return lab.model_copy(update={"control_preset": preset, "control_law": None})

    def gains(self, lab: LabConfig) -> Preset | None:
        """The preset in the place of the lab's, where gains were given; ValueError for one that is none."""
        if not self.observer and not (self.law and self.is_preset):
            return None
        preset = preset_for(self.lab(lab).control_preset, lab.profile_of(lab.followers[0]), lab.mocap)
        follower = _replaced(preset.follower, self.law, "law") if self.is_preset else preset.follower
        return replace(preset, follower=follower, observer=_replaced(preset.observer, self.observer, "observer"))

    def own(self, lab: LabConfig) -> OwnLaws | None:
        """The own laws of the lab's followers; None where a preset flies. ValueError where there is no such law."""
        return None if self.is_preset else OwnLaws(self.maker(), self.label, lab)

    def check(self) -> None:
        """ValueError where it is an own law that cannot be made: before anything flies."""
        if not self.is_preset:
            self.maker()

    def maker(self) -> Callable[[], ControlLaw]:
        """Makes an own law; ValueError where there is none of that name, or it takes no such options."""
        if self.is_file:
            return law_in_file(self.name, dict(self.law))
        try:
            return law_of(self.name, dict(self.law))
        except ValueError as error:
            raise ValueError(f"{error}; control presets: {', '.join(PRESETS)}; or a law's file.py") from error

    def options(self) -> dict[str, float]:
        """The options of an own law that are numbers with a fraction, and not 0, as it has them; ValueError."""
        maker: Any = self.maker()  # printing_to_stderr, partial(class, options)
        made = maker.args[0]
        known = {name: parameter.default for name, parameter in signature(made.func).parameters.items()}
        return {name: value for name, value in (known | made.keywords).items() if isinstance(value, float) and value}


def followed_by(law: ChosenLaw, lab: LabConfig) -> Preset:
    """The gains under which the followers fly the law, and a commanded leader is led as the lab's own preset says."""
    believed = lab.profile_of(lab.followers[0])
    gains = law.gains(lab) or preset_for(law.lab(lab).control_preset, believed, lab.mocap)
    before = preset_for(lab.control_preset, lab.profile_of(lab.leader), lab.mocap)
    return replace(
        gains, leader=before.leader, leader_vertical=before.leader_vertical, own_observer=before.own_observer,
        leader_lag_compensation=before.leader_lag_compensation,
    )  # fmt: skip


def chosen(name: str, gains: Path | None = None) -> ChosenLaw:
    """The law of that name with the gains of a TOML file, tables `law` and `observer`; ValueError, OSError."""
    if gains is None:
        return ChosenLaw(name)
    values = read_toml(gains)
    if unknown := set(values) - set(TABLES):
        raise ValueError(f"{gains}: [{min(unknown)}] is unknown; known: {', '.join(TABLES)}")
    return ChosenLaw(name, *(tuple(dict(values.get(table, {})).items()) for table in TABLES))


def flown_by(lab: LabConfig) -> str:
    """The name of the law that the lab flies."""
    return lab.control_preset if lab.control_law is None else lab.control_law.name


def _replaced(of: Any, values: tuple[tuple[str, Any], ...], table: str) -> Any:
    known = {field.name for field in fields(of)} - {"law"}
    wanted: Mapping[str, Any] = dict(values)
    for key, value in wanted.items():
        if key not in known:
            raise ValueError(f"[{table}] {key} is unknown; known: {', '.join(sorted(known))}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"[{table}] {key} = {value!r}: a number is wanted")
    return replace(of, **wanted)
