"""The lab's own control law, from the package that registers it to the control that flies it."""

from collections.abc import Callable

from formation.config import LabConfig
from formation.own_law.flight import OwnLaws
from formation.own_law.law import Answer, LawGuard, unlimited
from wire.lab_surroundings import law_of, printing_to_stderr


def own_laws(config: LabConfig, guard: LawGuard = unlimited) -> OwnLaws | None:
    """The laws that the lab's followers fly by in formation; None where it is ours. ValueError: not installed here."""
    law = config.control_law

    def guarded(now_ns: int, call: Callable[[], Answer]) -> Answer:
        return printing_to_stderr(lambda: guard(now_ns, call))

    return None if law is None else OwnLaws(law_of(law.name, law.options), law.name, config, guarded)
