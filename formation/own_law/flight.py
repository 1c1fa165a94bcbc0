"""Flies a lab's own law in the place of ours: for followers in their slots, behind the same prediction and limits.

Where the law fails, ours takes over in the same tick, and for good.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.control.law import HORIZON_MAX_NS, Demand, LawMemory, LawSettings
from formation.control.prediction import WORKSPACE, LawContext, situation
from formation.estimation.response import NEVER_NS, SECONDS, attitude_dead_s
from formation.guidance.followed_leader import STEP_MAX_S
from formation.guidance.reference_generator import SLOT
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.records import Rows
from formation.messages import LawFailure
from formation.own_law.law import ControlLaw, LawGuard, LawOverrunError, PointMotion, Situation, unlimited
from formation.paper.eq2_relative_frame import copy_motion

ACC_MOST_M_S2 = 1e3
"""No vehicle's: who asks for more has lost its sums."""
OWN, SLOT_MOTION, FRAME = range(3)


@dataclass(frozen=True, slots=True)
class Asked:
    """What our law was asked with in this tick."""

    settings: Rows[LawSettings]
    context: LawContext
    memory: Rows[LawMemory]
    now_ns: int


class OwnLaws:
    """The laws of the commanded vehicles, each from when it is led into a slot until it is led elsewhere."""

    def __init__(
        self, make: Callable[[], ControlLaw], name: str, config: LabConfig, guard: LawGuard = unlimited
    ) -> None:
        """guard: calls the laws of a tick, and bounds how long they take."""
        self._make, self._name, self._guard = make, name, guard
        self._bodies = [config.vehicles[i].body for i in config.commanded]
        self._laws: dict[int, ControlLaw] = {}
        self._failed = False
        self._asked = ""
        """Whose law was called last."""
        self._failures: list[LawFailure] = []

    def pop_failures(self) -> list[LawFailure]:
        """The failures since the last call; after the first, the built-in law flies, so there is never another."""
        failures, self._failures = self._failures, []
        return failures

    def take_over(self, wanted: Rows[Demand], asked: Asked) -> Rows[Demand]:
        """The demand with what the own laws want in it; the inside of ours, which then did nothing, is 0 there."""
        references = asked.context.references
        forming = [i for i in range(len(wanted)) if references[i].kind == SLOT and references[i].airborne]
        self._laws = {i: law for i, law in self._laws.items() if i in forming}
        if self._failed or not forming:
            return wanted
        motions = np.empty((len(wanted), 3, 3, 4))
        _motions(asked.settings, asked.context, asked.now_ns, motions)
        try:
            answers = self._guard(
                asked.now_ns, lambda: {i: self._answer(i, motions[i], wanted[i], asked) for i in forming}
            )
        except KeyboardInterrupt:  # meant for the program
            raise
        except BaseException as error:  # noqa: BLE001 - a lab's own code may do anything; drones in the air need a law
            self._fail(error, asked.now_ns)
            return wanted
        for i, acc_lab_m_s2 in answers.items():
            wanted["acc_lab_m_s2"][i] = acc_lab_m_s2
            for field in ("s_lead_m_s", "t_m_lead_m_s2", "z_m_lead_m_s2", "lead_acc_lab_m_s2"):
                wanted[field][i] = 0.0
        return wanted

    def _answer(self, i: int, motion: Float, wanted: Demand, asked: Asked) -> Float:
        """What one vehicle's law demands; ValueError for what is no acceleration, and whatever the law raises."""
        n, memory, begun = asked.settings[i].vehicle, asked.memory[i], i in self._laws
        self._asked = self._bodies[i]
        if not begun:
            self._laws[i] = self._make()
        response = asked.context.observers[n].response
        at = Situation(
            body=self._bodies[i],
            dt_s=min((asked.now_ns - memory.asked_ns) * SECONDS, STEP_MAX_S) if begun else 0.0,
            own=_point(motion[OWN]),
            slot=_point(motion[SLOT_MOTION]),
            leader=_point(motion[FRAME]),
            heading_rad=float(motion[FRAME, 0, 3]),
            heading_rate_rad_s=float(motion[FRAME, 1, 3]),
            error_lead_m=wanted.e_lead_m.copy(),
            error_rate_lead_m_s=wanted.e_rate_lead_m_s.copy(),
            disturbance_lab_m_s2=asked.context.estimates[n].dist_lab_m_s2.copy(),
            lag_s=(float(response.attitude_lag_s), float(response.thrust_lag_s)),
            saturated=bool(memory.saturated),
        )
        acc_lab_m_s2 = np.asarray(self._laws[i](at), dtype=np.float64)
        if acc_lab_m_s2.shape != (3,):
            raise ValueError(f"its answer has the shape {acc_lab_m_s2.shape}: (3,) is wanted")
        if not np.abs(acc_lab_m_s2).max() <= ACC_MOST_M_S2:
            raise ValueError(f"it demands {acc_lab_m_s2.tolist()} m/s^2")
        return acc_lab_m_s2

    def _fail(self, error: BaseException, now_ns: int) -> None:
        self._failed, overran = True, isinstance(error, LawOverrunError)
        body, reason = ("", str(error)) if overran else (self._asked, f"{type(error).__name__}: {error}")
        self._failures.append(LawFailure(now_ns, self._name, body, reason, overran))


def _point(motion: Float) -> PointMotion:
    return PointMotion(motion[0, :3], motion[1, :3], motion[2, :3])


@kernel
def _motions(settings: Rows[LawSettings], context: LawContext, now_ns: int, out: Float) -> None:
    """Of each vehicle OWN, SLOT_MOTION and FRAME (m, 3, 3, 4) as our law sees them; z from the thrust's channel."""
    estimates, observers = context.estimates, context.observers
    space = np.empty(2, WORKSPACE)
    for channel in range(2):
        space[channel].leader_ns[:] = NEVER_NS
    for i in range(len(settings)):
        n = settings[i].vehicle
        at_ns, response = min(now_ns, estimates[n].t_ns + HORIZON_MAX_NS), observers[n].response
        for channel in range(2):
            w = space[channel]
            dead_s = response.thrust_dead_s if channel == 1 else attitude_dead_s(estimates[n], observers[n])
            lag_s = response.thrust_lag_s if channel == 1 else response.attitude_lag_s
            hold_ns = at_ns + int(dead_s * 1e9)
            situation(i, n, context, hold_ns, int(lag_s * 1e9) // 2, w)
            if channel == 0:
                copy_motion(w.mine, out[i, OWN])
                copy_motion(w.lab, out[i, SLOT_MOTION])
                copy_motion(w.frame, out[i, FRAME])
            else:
                for order in range(3):
                    out[i, OWN, order, 2] = w.mine[order, 2]
                    out[i, SLOT_MOTION, order, 2] = w.lab[order, 2]
                    out[i, FRAME, order, 2] = w.frame[order, 2]
