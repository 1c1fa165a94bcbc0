"""The autopilots a simulated drone can be, each as a model built on its table."""

from collections.abc import Mapping
from types import MappingProxyType

from drone_agent.autopilots.ardupilot import ARDUPILOT_MODEL
from drone_agent.autopilots.model import AutopilotModel
from drone_agent.autopilots.px4 import PX4_MODEL

MODELS: Mapping[str, AutopilotModel] = MappingProxyType({model.name: model for model in (PX4_MODEL, ARDUPILOT_MODEL)})
