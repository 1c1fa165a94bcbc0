"""Faults of one simulated vehicle, and of who flies it, set and taken back on its agent."""

import numpy as np

from drone_agent.core import AgentCore
from drone_agent.simulation.attitude_loop import WHOLE_MOTORS
from formation.messages import Verb
from formation.vehicle.profile import VehicleProfile
from sim.faults.fault import Family, Fault
from wire.autopilots.table import FlightMode


def begin(fault: Fault, agent: AgentCore, now_ns: int) -> None:
    """The fault comes over the drone. A battery stays as empty as it is made."""
    agent.truth(now_ns)  # so that what was until now is past
    frame = agent.airframe
    match fault.family:
        case Family.DEAD_MOTOR:
            frame.motor_gain = np.where(np.arange(4) == fault.motor, fault.severity, 1.0)
        case Family.WEAK_MOTORS:
            frame.motor_gain = np.full(4, fault.severity)
        case Family.MASS:
            heavier = {"mass_kg": frame.profile.mass_kg * fault.severity}
            frame.profile = VehicleProfile.model_validate(frame.profile.model_dump() | heavier)
        case Family.BATTERY:
            frame.pack.set_remaining(fault.severity)
        case Family.PILOT:
            # Sticks centred: POSITION is what a pilot takes over in. The simulated autopilot has no remote control, so
            # that it is put there past its own question whether one is on.
            mode = FlightMode.LAND if fault.verb is Verb.LAND else FlightMode.POSITION
            if agent.autopilot.armed:
                agent.autopilot.enter(mode, now_ns)


def end(fault: Fault, agent: AgentCore, now_ns: int) -> None:
    """The fault leaves the drone, where it can; a pilot who still holds it brings it down."""
    agent.truth(now_ns)
    frame = agent.airframe
    if fault.family in (Family.DEAD_MOTOR, Family.WEAK_MOTORS):
        frame.motor_gain = WHOLE_MOTORS
    elif fault.family is Family.MASS:
        frame.profile = agent.config.true_vehicle()
    elif fault.family is Family.PILOT and agent.autopilot.mode is FlightMode.POSITION:
        agent.autopilot.enter(FlightMode.LAND, now_ns)
