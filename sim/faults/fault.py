"""One fault as data: what goes wrong, where, from when on, for how long, how badly. `FAMILIES` says what each means."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from formation.messages import Verb
from formation.model import Model, Name, Positive, WrongKeyError


class Site(StrEnum):
    """Where a fault acts."""

    CAMERAS = "cameras"
    BUS = "bus"
    LINK = "link"
    CORE = "core"
    VEHICLE = "vehicle"
    OPERATOR = "operator"
    HOST = "host"


class Family(StrEnum):
    """Every kind of fault."""

    FREEZE = "freeze"
    JUMP = "jump"
    ABSURD = "absurd"
    NOT_A_NUMBER = "not-a-number"
    FLIP = "flip"
    YAW = "yaw"
    SWAP = "swap"
    LOST_BODY = "lost-body"
    DRIFT = "drift"
    NOISE = "noise"
    HIDDEN_LATENCY = "hidden-latency"
    STAMP_OFFSET = "stamp-offset"
    LOST_STREAM = "lost-stream"
    LATE_STREAM = "late-stream"
    SLOW_STREAM = "slow-stream"
    DROP = "drop"
    DELAY = "delay"
    GROWING_DELAY = "growing-delay"
    JITTER = "jitter"
    REORDER = "reorder"
    DUPLICATE = "duplicate"
    CORRUPT = "corrupt"
    REPLAY = "replay"
    ROGUE_SETPOINT = "rogue-setpoint"
    KILL = "kill"
    STALL = "stall"
    RESTART = "restart"
    TWIN = "twin"
    DEAD_MOTOR = "dead-motor"
    WEAK_MOTORS = "weak-motors"
    MASS = "mass"
    BATTERY = "battery"
    REQUEST = "request"
    PILOT = "pilot"
    LOG_TROUBLE = "log-trouble"


@dataclass(frozen=True, slots=True)
class Meaning:
    """Where a family acts, what its severity is and in which unit; "" where it has none.

    zero_is_none: whether less of it is milder, down to no fault at all.
    """

    site: Site
    severity: str = ""
    zero_is_none: bool = False


FAMILIES: Mapping[Family, Meaning] = MappingProxyType(
    {
        Family.FREEZE: Meaning(Site.CAMERAS),
        Family.JUMP: Meaning(Site.CAMERAS, "m, horizontally", zero_is_none=True),
        Family.ABSURD: Meaning(Site.CAMERAS, "m, along every axis"),
        Family.NOT_A_NUMBER: Meaning(Site.CAMERAS),
        Family.FLIP: Meaning(Site.CAMERAS, "rad about the body's forward axis", zero_is_none=True),
        Family.YAW: Meaning(Site.CAMERAS, "rad about the lab's z", zero_is_none=True),
        Family.SWAP: Meaning(Site.CAMERAS),
        Family.LOST_BODY: Meaning(Site.CAMERAS),
        Family.DRIFT: Meaning(Site.CAMERAS, "m/s, horizontally", zero_is_none=True),
        Family.NOISE: Meaning(Site.CAMERAS, "m, standard deviation per axis; ten times as many rad", zero_is_none=True),
        Family.HIDDEN_LATENCY: Meaning(Site.CAMERAS, "s later than the stamp says", zero_is_none=True),
        Family.STAMP_OFFSET: Meaning(Site.CAMERAS, "s that stamps lie ahead, behind where negative", zero_is_none=True),
        Family.LOST_STREAM: Meaning(Site.BUS),
        Family.LATE_STREAM: Meaning(Site.BUS, "s", zero_is_none=True),
        Family.SLOW_STREAM: Meaning(Site.BUS, "share of the frames that is missing, evenly", zero_is_none=True),
        Family.DROP: Meaning(Site.LINK, "share lost", zero_is_none=True),
        Family.DELAY: Meaning(Site.LINK, "s", zero_is_none=True),
        Family.GROWING_DELAY: Meaning(Site.LINK, "s per s", zero_is_none=True),
        Family.JITTER: Meaning(Site.LINK, "s, mean of an exponential; nothing overtakes", zero_is_none=True),
        Family.REORDER: Meaning(Site.LINK, "share that comes 30 ms later, overtaken", zero_is_none=True),
        Family.DUPLICATE: Meaning(Site.LINK, "share that comes again, 30 ms later", zero_is_none=True),
        Family.CORRUPT: Meaning(Site.LINK, "share with a byte changed", zero_is_none=True),
        Family.REPLAY: Meaning(Site.LINK, "s ago, what was sent then is sent again"),
        Family.ROGUE_SETPOINT: Meaning(Site.LINK, "rad that attitude targets are tilted farther", zero_is_none=True),
        Family.KILL: Meaning(Site.CORE),
        Family.STALL: Meaning(Site.CORE),
        Family.RESTART: Meaning(Site.CORE),
        Family.TWIN: Meaning(Site.CORE),
        Family.DEAD_MOTOR: Meaning(Site.VEHICLE, "share of its thrust that one motor keeps"),
        Family.WEAK_MOTORS: Meaning(Site.VEHICLE, "share of its thrust that every motor keeps"),
        Family.MASS: Meaning(Site.VEHICLE, "times what it was"),
        Family.BATTERY: Meaning(Site.VEHICLE, "charge left, 0..1"),
        Family.REQUEST: Meaning(Site.OPERATOR),
        Family.PILOT: Meaning(Site.OPERATOR),
        Family.LOG_TROUBLE: Meaning(Site.HOST),
    }
)

Core = Literal["ground", "mocap", "agent"]
OnsetPhase = Literal["GROUND", "ARMED", "TAKEOFF", "FORMATION", "HOLD", "LAND"]
GROUND_RECEIVER = "ground"


class Fault(Model):
    """One fault; it begins `after_s` after the flight first enters `phase`, and lasts `for_s` or, without it, for ever.

    body: the mocap's name of the body or drone; not given: every one. other: with which body it is swapped. receiver:
    of a fault of the bus, who alone meets it, `ground` or a body; not given: everyone. direction: of a link, `down` to
    the drone. core: which one; an agent's or bridge's by `body`; one that restarts is back after `for_s`. verb,
    argument: what the operator asks for, of the new ground alone (2 s old) for a restart or twin of it. heading_rad:
    whither in the lab, about z from x; not given: drawn by the seed. motor: 0..3.
    """

    family: Family
    phase: OnsetPhase = "FORMATION"
    after_s: Annotated[float, Field(ge=0.0)] = 0.0
    for_s: Positive | None = None
    severity: float = 1.0
    body: Name | None = None
    other: Name | None = None
    receiver: Name | None = None
    direction: Literal["down", "up", "both"] = "both"
    core: Core | None = None
    verb: Verb | None = None
    argument: str = ""
    heading_rad: float | None = None
    motor: Annotated[int, Field(ge=0, le=3)] = 0

    @property
    def site(self) -> Site:
        """Where it acts."""
        return FAMILIES[self.family].site

    def hits(self, body: str) -> bool:
        """Whether it is about that body, among others."""
        return self.body is None or self.body == body

    def text(self) -> str:
        """In a few words: family, victim, onset, length, severity."""
        victim = " ".join(part for part in (self.core, self.body, self.other, self.receiver) if part)
        direction = f" {self.direction}" if self.site is Site.LINK else ""
        how_much = f" {self.severity:.3g}" if FAMILIES[self.family].severity else ""
        request = f" requests {self.verb}" if self.verb else ""
        lasts = "" if self.for_s is None else f" for {self.for_s:.3g} s"
        whom = f" of {victim}" if victim else ""
        return f"{self.family}{how_much}{whom}{direction}{request} at {self.phase} + {self.after_s:.3g} s{lasts}"

    @model_validator(mode="after")
    def _has_required_keys(self) -> Self:
        missing = {
            "core": self.site is Site.CORE and self.core is None,
            "for_s": self.family in (Family.STALL, Family.RESTART) and self.for_s is None,
            "body": self.family is Family.SWAP and self.body is None,
            "other": self.family is Family.SWAP and self.other is None,
            "verb": self.family is Family.REQUEST and self.verb is None,
        }
        for key, is_missing in missing.items():
            if is_missing:
                raise WrongKeyError(key, f"is missing: a fault `{self.family}` needs `{key}`")
        return self
