"""One flight identified: every drone's response and thrust, the mocap, and a profile the controller can hold."""

from dataclasses import dataclass

from analysis.identify import response, sensing, thrust
from analysis.identify.response import Response
from analysis.identify.sensing import Sensing, estimate_sensing
from analysis.identify.signals import Estimate, seen, sent
from analysis.identify.thrust import Thrust
from analysis.load import Flight, Vehicle
from formation.model import LONGEST_NAME
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G, VehicleProfile


@dataclass(frozen=True, slots=True)
class Identified:
    """One drone; a text in place of an estimate says why there is none. base: the profile the lab flew it with.

    late_s: how much older its poses are than their stamps say.
    """

    vehicle: Vehicle
    base: VehicleProfile
    response: Response | str
    thrust: Thrust | str
    late_s: Estimate | str

    @property
    def name(self) -> str:
        """What its profile is called."""
        ending = f"_{self.vehicle.body}"
        return (self.base.name.removesuffix(ending) + ending)[-LONGEST_NAME:]

    def profile(self) -> VehicleProfile:
        """The base profile updated with all estimates of this flight; the mass stays the assumed one."""
        update: dict[str, float | bool | str] = {"name": self.name}
        if isinstance(self.response, Response):
            update |= _answers(self.response)
            # What is inside the vehicle is part of the delay seen; the link's share of it is not known.
            update["command_delay_s"] = min(self.base.command_delay_s, self.response.delay_s.value)
        if isinstance(self.thrust, Thrust):
            curve = self.base.thrust_curve if self.thrust.curve is None else _fraction(self.thrust.curve.value)
            hover = self.thrust.hover_norm.value
            weight_n = self.base.mass_kg * GRAVITY_M_S2
            update |= {"thrust_curve": curve, "thrust_max_n": weight_n / ((1.0 - curve) * hover + curve * hover**2)}
        return self.base.model_copy(update={key: _short(value) for key, value in update.items()})


def _answers(found: Response) -> dict[str, float | bool | str]:
    """The profile's entries that a response decides."""
    lead = {} if found.rate_lead is None else {"rate_feed_forward": found.rate_lead.value > 0.5}
    return {
        "response_dead_time_s": found.dead_time_s.value,
        "response_lag_s": found.lag_s.value,
        "thrust_dead_time_s": found.delay_s.value,
        "thrust_lag_s": found.motor_lag_s.value,
        "attitude_p_1_s": found.attitude_p_1_s.value,
        "rate_p_1_s": found.rate_p_1_s.value,
        "motor_lag_s": found.motor_lag_s.value,
        **lead,
    }


def _fraction(value: float) -> float:
    """Into 0..1, where a thrust curve lives."""
    return min(max(value, 0.0), 1.0)


def _short(value: float | bool | str) -> float | bool | str:
    """Numbers to four significant digits: more is not known."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


@dataclass(frozen=True, slots=True)
class Identification:
    """The estimates from one flight, of its drones and its mocap."""

    drones: tuple[Identified, ...]
    sensing: Sensing | str


def identify(flight: Flight) -> Identification:
    """Every drone that was sent targets, in the configuration's order."""
    targets, own = sent(flight), sensing.attitudes_of(flight)
    drones = []
    for index, vehicle in enumerate(flight.vehicles):
        if vehicle.sysid not in targets:
            continue
        of, saw = targets[vehicle.sysid], seen(flight, vehicle)
        base = _base(flight, index)
        found = response.fit(of, saw)
        delay_s, lag_s = (
            (found.delay_s.value, found.motor_lag_s.value)
            if isinstance(found, Response)
            else (base.thrust_dead_time_s, base.thrust_lag_s)
        )
        late_s = sensing.late(flight, vehicle, own.get(vehicle.sysid))
        drones.append(Identified(vehicle, base, found, thrust.fit(of, saw, delay_s, lag_s), late_s))
    return Identification(tuple(drones), estimate_sensing(flight))


def _base(flight: Flight, index: int) -> VehicleProfile:
    """The profile the lab flew a vehicle with, its own or a shipped one; the paper's where the log names none."""
    lab = flight.run.lab
    return PAPER_40G if lab is None else lab.profile_of(lab.vehicles[index])
