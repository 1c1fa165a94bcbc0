"""The simulated operator, sans-IO: watches the flight's phase and asks for the next thing when its time has come."""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field

from formation.codes import FlightResult, Outcome
from formation.messages import OperatorReply, OperatorRequest, Phase, Verb
from formation.model import Model
from wire.ground_state import GroundState

READY_WITHIN_NS = 30_000_000_000
RETRY_NS = 200_000_000
ANSWER_NS = 20_000_000_000
REJECTED_FOR_NS = 30_000_000_000


class Step(Model):
    """Ask for `verb` once the flight has been in `phase` for `after_s` and, if so wanted, the leader has finished."""

    verb: Verb
    phase: Literal["GROUND", "ARMED", "TAKEOFF", "FORMATION", "HOLD", "LAND"]
    after_s: Annotated[float, Field(ge=0.0)] = 0.0
    leader_done: bool = False
    argument: str = ""


FLIGHT = (
    Step(verb=Verb.ARM, phase="GROUND"),
    Step(verb=Verb.TAKEOFF, phase="ARMED"),
    Step(verb=Verb.START, phase="HOLD", after_s=1.0),
    Step(verb=Verb.HOLD, phase="FORMATION", leader_done=True, after_s=1.0),
    Step(verb=Verb.LAND, phase="HOLD", after_s=1.0),
)


@dataclass(frozen=True, slots=True)
class OperatorView:
    """The part of the ground's published state that an operator acts on.

    formed: the followers are in their slots, and the leader moves. prearm_failures: why the ground would not arm now.
    lost: why the landing ended, where a drone has not reported its motors off.
    """

    phase: Phase
    formed: bool = False
    trajectory_done: bool = False
    prearm_failures: tuple[str, ...] = ()
    lost: str = ""

    @classmethod
    def at(cls, state: GroundState) -> Self:
        """The view in a state."""
        return cls(
            phase=state.phase,
            formed=state.trajectory_started,
            trajectory_done=state.trajectory_done,
            prearm_failures=state.prearm_failures,
            lost=state.cause if state.not_landed else "",
        )


class Operator:
    """Walks through the steps; it repeats a rejected request for up to REJECTED_FOR_NS.

    Before arming it waits until no pre-arm check fails. Arming is answered only when every drone has armed,
    so an answer may take its time.
    """

    def __init__(self, steps: tuple[Step, ...], leader_s: float | None = None) -> None:
        """leader_s: how long the leader moves, where the ground does not know it."""
        self._steps = steps
        self._leader_ns = None if leader_s is None else round(leader_s * 1e9)
        self._formed_ns: int | None = None
        self._leader_done = False
        self._ready = False
        self._next = 0
        self._phase = Phase.GROUND
        self._since_ns: int | None = None
        self._ask_again_ns = 0
        self._asked_since_ns: int | None = None
        self._requests = 0
        self.outcome: Outcome | None = None

    @property
    def phase(self) -> Phase:
        """The phase last reported."""
        return self._phase

    def observe(self, view: OperatorView, now_ns: int) -> None:
        """Receive the ground's state."""
        phase = view.phase
        if view.formed and self._formed_ns is None:
            self._formed_ns = now_ns
        self._ready = not view.prearm_failures
        self._leader_done = view.trajectory_done
        if self._leader_ns is not None:
            self._leader_done = self._formed_ns is not None and now_ns - self._formed_ns >= self._leader_ns
        if self._since_ns is None or phase is not self._phase:
            self._phase, self._since_ns = phase, now_ns
            if phase is Phase.STOPPED:
                self.outcome = Outcome(FlightResult.ABORTED, "the ground stopped every drone")
            elif phase is Phase.GROUND and self._next > 0:
                self._end_on_ground(view.lost)
            elif phase is Phase.HOLD and self._next == len(self._steps) and self._steps[-1].verb is not Verb.LAND:
                self.outcome = Outcome(FlightResult.HELD)

    def next_request(self, now_ns: int) -> OperatorRequest | None:
        """The request to make now, if any."""
        if self.outcome is not None or self._since_ns is None or now_ns < self._ask_again_ns:
            return None
        if self._next == len(self._steps):
            return None
        step = self._steps[self._next]
        if Phase[step.phase] is not self._phase or now_ns - self._since_ns < round(step.after_s * 1e9):
            return None
        if step.leader_done and not self._leader_done:
            return None
        if step.verb is Verb.ARM and not self._ready and now_ns - self._since_ns < READY_WITHIN_NS:
            return None
        self._ask_again_ns = now_ns + ANSWER_NS
        if self._asked_since_ns is None:
            self._asked_since_ns = now_ns
        self._requests += 1
        return OperatorRequest(self._requests, step.verb, step.argument)

    def receive(self, reply: OperatorReply, now_ns: int) -> None:
        """The answer to the request made last."""
        if reply.id != self._requests or self._asked_since_ns is None:
            return
        self._ask_again_ns = now_ns
        if reply.accepted:
            self._next += 1
            self._asked_since_ns = None
            return
        self._ask_again_ns += RETRY_NS
        if now_ns - self._asked_since_ns > REJECTED_FOR_NS:
            step = self._steps[self._next]
            self.outcome = Outcome(FlightResult.ABORTED, f"{step.verb} refused: {reply.text}")

    def _end_on_ground(self, lost: str) -> None:
        if lost:
            self.outcome = Outcome(FlightResult.LOST, lost)
        elif self._next == len(self._steps):
            self.outcome = Outcome(FlightResult.LANDED)
        else:
            self.outcome = Outcome(FlightResult.ABORTED, f"back on the ground before `{self._steps[self._next].verb}`")
