"""The table of topics: every channel of a log and every key on the bus, with its type, rate and drop policy."""

from dataclasses import dataclass
from enum import StrEnum

from formation import messages as m


class Drop(StrEnum):
    """What a full queue does."""

    LATEST_WINS = "latest wins"
    OLDEST_LOST = "oldest lost, counted"
    NEVER = "never"


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """One channel of the log, equal to itself alone: name, message type, nominal rate, what happens under pressure."""

    name: str
    type: type
    rate_hz: float
    drop: Drop


MOCAP = Topic("mocap/frame", m.LabFrame, 100.0, Drop.LATEST_WINS)
MOCAP_EVENT = Topic("mocap/event", m.Event, 0.1, Drop.NEVER)
LINK_UP = Topic("link/up", m.Datagram, 300.0, Drop.OLDEST_LOST)
LINK_DOWN = Topic("link/down", m.Datagram, 300.0, Drop.LATEST_WINS)
REQUEST = Topic("operator/request", m.OperatorRequest, 0.1, Drop.NEVER)
REPLY = Topic("operator/reply", m.OperatorReply, 0.1, Drop.NEVER)
HOST = Topic("input/host", m.HostReport, 0.1, Drop.NEVER)
UNMET = Topic("input/unmet", m.UnmetParameter, 0.1, Drop.NEVER)
STATE = Topic("control/state", m.SwarmState, 100.0, Drop.OLDEST_LOST)
REFERENCE = Topic("control/reference", m.Reference, 100.0, Drop.OLDEST_LOST)
COMMAND = Topic("control/command", m.Command, 100.0, Drop.OLDEST_LOST)
TARGET = Topic("control/target", m.AttitudeTarget, 100.0, Drop.OLDEST_LOST)
LAW_FAILURE = Topic("control/law_failure", m.LawFailure, 0.1, Drop.NEVER)
EVENT = Topic("event", m.Event, 1.0, Drop.NEVER)
REJECTED = Topic("edge/refused", m.Event, 1.0, Drop.NEVER)
PHASE = Topic("phase", m.PhaseChange, 0.1, Drop.NEVER)
TRUTH = Topic("sim/truth", m.Truth, 250.0, Drop.OLDEST_LOST)
INNOVATION = Topic("guard/innovation", m.Innovation, 40.0, Drop.OLDEST_LOST)
SIGNAL = Topic("import/signal", m.SignalRows, 1.0, Drop.NEVER)
COLUMN = Topic("import/column", m.SignalRows, 1.0, Drop.NEVER)
TICK = Topic("input/tick", m.Tick, 100.0, Drop.NEVER)
CLOCK = Topic("clock", m.ClockPair, 1 / 60, Drop.NEVER)
TIMING = Topic("timing/loop", m.LoopTiming, 100.0, Drop.OLDEST_LOST)

ALL = (
    MOCAP,
    MOCAP_EVENT,
    LINK_UP,
    LINK_DOWN,
    REQUEST,
    REPLY,
    HOST,
    UNMET,
    TICK,
    STATE,
    REFERENCE,
    COMMAND,
    TARGET,
    LAW_FAILURE,
    EVENT,
    REJECTED,
    PHASE,
    TIMING,
    TRUTH,
    INNOVATION,
    SIGNAL,
    COLUMN,
    CLOCK,
)
