"""Why the ground refuses what an operator asks; decided here for every verb that can be refused."""

from collections.abc import Sequence

from formation.config import LabConfig
from formation.control.stack import Stages
from formation.messages import Phase, Verb
from formation.reasons import Reason, Reject
from formation.safety import arming
from formation.safety.phases import Trigger
from formation.safety.rules import Facts
from gcs import formation_change
from gcs.drones.drone import Drone
from gcs.flight import Flight
from gcs.operator import reset_reject_reasons, takeoff_reject_reasons
from gcs.safety import monitors, takeover
from gcs.safety.host import Host

OPERATORS = (
    Trigger.ARM, Trigger.TAKE_CONTROL, Trigger.TAKEOFF, Trigger.START, Trigger.HOLD, Trigger.LAND, Trigger.STOP,
    Trigger.RESET,
)  # fmt: skip
"""What an operator may pull, in the order of a flight."""


class Permissions:
    """What stands against a request now, given the facts; the flight's phase table refuses what is out of turn."""

    def __init__(
        self, config: LabConfig, drones: Sequence[Drone], flight: Flight, host: Host, without: frozenset[str]
    ) -> None:  # fmt: skip
        """without: monitors that are switched off."""
        self._config = config
        self._drones = drones
        self._flight = flight
        self._host = host
        self._without = without

    def reject_reasons(self, verb: Verb, facts: Facts, stages: Stages | None, now_ns: int) -> tuple[Reject, ...]:
        """Every reason against the verb; facts: with the links' pre-arm failures."""
        match verb, self._flight.phase:
            case Verb.ARM, Phase.GROUND:
                return self.arming(facts, now_ns)
            case Verb.TAKE_CONTROL, Phase.GROUND:
                others = self._other_grounds(now_ns)
                return takeover.take_control_reject_reasons(self._drones, facts, others, stages is not None)
            case Verb.LAND, Phase.GROUND:
                return takeover.land_reject_reasons(self._drones, now_ns)
            case Verb.RESET, Phase.STOPPED:
                return reset_reject_reasons(self._drones, now_ns)
            case Verb.TAKEOFF, Phase.ARMED:
                return takeoff_reject_reasons(facts, self._flight, self._drones, self._config, now_ns)
            case Verb.START, Phase.HOLD:
                joining = takeover.joining_reject_reasons(self._drones, now_ns)
                return joining or formation_change.start(self._flight, facts, stages, self._flight.config)
            case _:
                return ()

    def allowed(
        self, facts: Facts, stages: Stages | None, arming: Sequence[Reject], now_ns: int
    ) -> dict[str, tuple[Reject, ...]]:  # fmt: skip
        """By verb, every reason against it now, without expensive checks: a shape's fit and its transition are judged
        when it is requested, or by the page. arming: the reasons against arming, where the swarm is on the ground."""
        reasons: dict[str, tuple[Reject, ...]] = {}
        for trigger in OPERATORS:
            out_of_turn = self._flight.out_of_turn(trigger)
            reasons[trigger.value] = (
                (out_of_turn,) if out_of_turn else self._against(trigger, facts, stages, arming, now_ns)
            )
        reasons[Verb.TRAJECTORY.value] = formation_change.choice_reject_reasons(self._flight)
        return reasons

    def _against(
        self, trigger: Trigger, facts: Facts, stages: Stages | None, arming: Sequence[Reject], now_ns: int
    ) -> tuple[Reject, ...]:  # fmt: skip
        if trigger is Trigger.ARM:
            return tuple(arming)
        if trigger is Trigger.START:
            return (
                *takeover.joining_reject_reasons(self._drones, now_ns),
                *formation_change.leader_reject_reasons(facts, self._config),
            )
        return self.reject_reasons(Verb(trigger.value), facts, stages, now_ns)

    def arming(self, facts: Facts, now_ns: int) -> tuple[Reject, ...]:
        """Every reason not to arm; first of all, that drones may be flying already, under this ground or another."""
        flying = () if monitors.ARM_IN_AIR in self._without else takeover.flying(self._drones)
        trouble, button = self._host.log_trouble, self._host.button_trouble
        return (
            *takeover.arming_reject_reasons(flying, self._other_grounds(now_ns)),
            *arming.prearm_failures(facts, self._config.limits),
            *((Reason.LOG.of(trouble),) if trouble else ()),
            *((Reason.STOP_BUTTON.of(button),) if button else ()),
        )

    def _other_grounds(self, now_ns: int) -> tuple[str, ...]:
        if monitors.ARM_OTHER_GROUND in self._without:
            return ()
        return takeover.other_grounds(self._drones, self._host.other_grounds, now_ns)
