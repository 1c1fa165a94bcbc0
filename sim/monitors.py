"""Every monitor by name, and which core it belongs to: what a campaign can switch off to see that it is needed."""

from drone_agent.guard.stages import MONITORS as AGENT_MONITORS
from gcs.safety import MONITORS as GROUND_MONITORS
from mocap.validator import NAMES as VALIDATOR_CHECKS

NAMES = (*VALIDATOR_CHECKS, *AGENT_MONITORS, *GROUND_MONITORS)
"""All of them."""


class Without:
    """The monitors to do without, by the cores that have them; ValueError names one that is none: no core does."""

    def __init__(self, names: frozenset[str] = frozenset()) -> None:
        if unknown := sorted(names - set(NAMES)):
            raise ValueError(f"no monitor {unknown[0]!r}; known: {', '.join(NAMES)}")
        self.mocap = names & set(VALIDATOR_CHECKS)
        self.agent = names & set(AGENT_MONITORS)
        self.ground = names & set(GROUND_MONITORS)


WITHOUT_NONE = Without()
"""Nothing is switched off."""
