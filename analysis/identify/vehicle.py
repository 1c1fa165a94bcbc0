"""One flight identified: every drone's response and thrust, the mocap, and a profile the controller can hold."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.identify import drag, response, sensing, thrust
from analysis.identify.drag import Drag
from analysis.identify.response import Response
from analysis.identify.sensing import Sensing, estimate_sensing
from analysis.identify.signals import Estimate, seen, sent
from analysis.identify.thrust import Thrust
from analysis.load import Flight, Vehicle
from analysis.reading import IMPORTED
from formation.model import LONGEST_NAME
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G, VehicleProfile

KNOWN_WITHIN = 1.0 / 3.0
"""A figure is written where half its 95 % interval is at most this share of it: control stands gains off by as much."""

NONE_COMMANDED = "the log holds no commanded attitude"


@dataclass(frozen=True, slots=True)
class Identified:
    """One drone; a text in place of an estimate says why there is none. base: the profile the lab flew it with.

    late_s: how much older its poses are than their stamps say.
    """

    vehicle: Vehicle
    base: VehicleProfile
    response: Response | str
    thrust: Thrust | str
    drag: Drag | str
    late_s: Estimate | str

    @property
    def name(self) -> str:
        """What its profile is called."""
        ending = f"_{self.vehicle.body}"
        return (self.base.name.removesuffix(ending) + ending)[-LONGEST_NAME:]

    @property
    def untold(self) -> frozenset[str]:
        """Why there is no estimate of what."""
        parts = (self.response, self.thrust, self.drag, self.late_s)
        return frozenset(reason for reason in parts if isinstance(reason, str))

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The estimate behind each number of the profile that this flight gives."""
        found, r, t = dict[str, Estimate](), self.response, self.thrust
        if isinstance(r, Response):
            found |= {
                "response_dead_time_s": r.dead_time_s, "response_lag_s": r.lag_s, "thrust_dead_time_s": r.delay_s,
                "thrust_lag_s": r.motor_lag_s, "attitude_p_1_s": r.attitude_p_1_s, "rate_p_1_s": r.rate_p_1_s,
                "motor_lag_s": r.motor_lag_s,
            }  # fmt: skip
        if isinstance(t, Thrust):
            found |= {} if t.curve is None else {"thrust_curve": t.curve}
            found["thrust_max_n"] = max(t.full_m_s2, t.hover_norm, key=lambda estimate: estimate.share)
        if isinstance(self.drag, Drag):
            found["drag_n_s_m"] = self.drag.drag_1_s.scaled(self.base.mass_kg)
        return found

    def unchanged(self, share: float = KNOWN_WITHIN) -> tuple[str, ...]:
        """The entries of the profile that stay the base's."""
        mine = self.profile(share)
        return tuple(key for key in VehicleProfile.model_fields if getattr(mine, key) == getattr(self.base, key))

    def unknown(self, share: float = KNOWN_WITHIN) -> tuple[str, ...]:
        """The entries of the profile that are not known within that share of themselves."""
        return tuple(key for key, estimate in self.estimates.items() if not estimate.share <= share)

    def profile(self, share: float = np.inf) -> VehicleProfile:
        """The base profile updated with the estimates of this flight that are known within that share of themselves;
        the mass stays the assumed one."""
        known = {key: each.value for key, each in self.estimates.items() if each.share <= share}
        update: dict[str, Any] = {"name": self.name} | known
        if "drag_n_s_m" in known:
            sideways = _short(max(known["drag_n_s_m"], 0.0))
            update["drag_n_s_m"] = (sideways, sideways, self.base.drag_n_s_m[2])
        if isinstance(self.response, Response):
            delay_s, lead = self.response.delay_s, self.response.rate_lead
            # What is inside the vehicle is part of the delay seen; the link's share of it is not known.
            seen_s = delay_s.value if delay_s.share <= share else delay_s.high
            update["command_delay_s"] = min(self.base.command_delay_s, seen_s)
            if lead is not None and not lead.low <= 0.5 <= lead.high:  # an autopilot takes it whole or not at all
                update["rate_feed_forward"] = lead.value > 0.5
        if isinstance(self.thrust, Thrust) and "thrust_max_n" not in known:
            update.pop("thrust_curve", None)  # the two make the hover thrust together
        elif isinstance(self.thrust, Thrust):
            curve = min(max(known.get("thrust_curve", self.base.thrust_curve), 0.0), 1.0)
            hover = self.thrust.hover_norm.value
            weight_n = self.base.mass_kg * GRAVITY_M_S2
            update |= {"thrust_curve": curve, "thrust_max_n": weight_n / ((1.0 - curve) * hover + curve * hover**2)}
        return self.base.model_copy(update={key: _short(value) for key, value in update.items()})


def _short(value: Any) -> Any:
    """Numbers to four significant digits: more is not known."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


@dataclass(frozen=True, slots=True)
class Identification:
    """The estimates from one flight, of its drones and its mocap."""

    drones: tuple[Identified, ...]
    sensing: Sensing | str


def identify(flight: Flight, base: VehicleProfile | None = None) -> Identification:
    """Every drone that was sent targets, in the configuration's order, and those of others' logs without any.

    base: what is assumed of each; None: the profile that the lab flew it with.
    """
    targets, own = sent(flight), sensing.attitudes_of(flight)
    drones = []
    for index, vehicle in enumerate(flight.vehicles):
        is_imported = IMPORTED in flight.run.metadata
        of, saw = targets.get(vehicle.sysid or 0), seen(flight, vehicle)
        if of is None and not is_imported:
            continue
        assumed = base or _base(flight, index)
        late_s = sensing.late(flight, vehicle, sensing.logged_attitudes(flight, vehicle) if is_imported
                              else own.get(vehicle.sysid or 0))  # fmt: skip
        dragged = drag.fit(saw)
        if of is None:
            drones.append(Identified(vehicle, assumed, NONE_COMMANDED, NONE_COMMANDED, dragged, late_s))
            continue
        if is_imported and not isinstance(late_s, str):  # its targets are stamped as its attitude is
            of = replace(of, t_s=of.t_s + late_s.value)
        found = response.fit(of, saw)
        delay_s, lag_s = (
            (found.delay_s.value, found.motor_lag_s.value)
            if isinstance(found, Response)
            else (assumed.thrust_dead_time_s, assumed.thrust_lag_s)
        )
        drones.append(Identified(vehicle, assumed, found, thrust.fit(of, saw, delay_s, lag_s), dragged, late_s))
    return Identification(tuple(drones), estimate_sensing(flight))


def _base(flight: Flight, index: int) -> VehicleProfile:
    """The profile the lab flew a vehicle with, its own or a shipped one; the paper's where the log names none."""
    lab = flight.run.lab
    return PAPER_40G if lab is None else lab.profile_of(lab.vehicles[index])
