"""The makes of autopilot an agent can be."""

from collections.abc import Mapping
from types import MappingProxyType

from drone_agent.autopilots.ardupilot import ARDUPILOT
from drone_agent.autopilots.personality import Personality
from drone_agent.autopilots.px4 import PX4

PERSONALITIES: Mapping[str, Personality] = MappingProxyType({make.name: make for make in (PX4, ARDUPILOT)})
