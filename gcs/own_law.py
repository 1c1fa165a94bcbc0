"""The lab's own control law, from the package that registers it to the control that flies it."""

from formation.config import LabConfig
from formation.own_law.flight import OwnLaws
from formation.own_law.guard import LawGuard, unlimited
from wire.lab_surroundings import law_of


def own_laws(config: LabConfig, guard: LawGuard = unlimited) -> OwnLaws | None:
    """The laws that the lab's followers fly by in formation; None where it is ours. ValueError: not installed here."""
    law = config.control_law
    return None if law is None else OwnLaws(law_of(law.name, law.options), law.name, config, guard)
