"""Why the ground refuses what an operator asks: a code for programs, of which the text for people is made."""

from dataclasses import dataclass
from enum import Enum

LAND_ALL = ": `gcs land` lands every drone"
LAND_AND_INCLUDE = ": `gcs land`, then `gcs include`"


class Reason(Enum):
    """One reason against a request; template: its text, with a place for each of the values that it names."""

    template: str

    def __new__(cls, template: str) -> "Reason":
        """A member; texts may be the same."""
        reason = object.__new__(cls)
        reason._value_ = len(cls.__members__)
        reason.template = template
        return reason

    OUT_OF_TURN = "{} is for {}, this is {}: {}"
    # Who asks, in a lab with keys
    NO_ROLE = "{} has no role: [security] operators names those who have"
    BEYOND_ROLE = "the role {} of {} may not {}"
    KEYS_REVOKED = "the keys of {} are revoked"
    # Arming
    NO_POSE = "{}: no fresh pose (last seen {})"
    TOO_NEAR = "{}: {:.2f} m from the next body, minimum is {:.2f} m"
    OUTSIDE_FENCE = "{}: {:.2f} m outside the fence"
    TILTED = "{}: tilted by {:.0f} degrees"
    MOVING = "{}: moving at {:.2f} m/s"
    NO_HEARTBEAT = "{}: no heartbeat (last heard {})"
    BATTERY_LOW = "{}: battery at {:.0%}"
    SYSID_TWICE = "{}: its sysid is used twice on the network"
    FOREIGN_DRONE = "{}: drone {} answers on the link of drone {}"
    UNKNOWN_AUTOPILOT = "{}: autopilot {} is neither PX4 nor ArduPilot"
    AUTOPILOT_UNREADY = "{}: {}"
    AWAITS_RESTART = "{}: {} {}"
    WRONG_PARAMETER = "{}: {}"
    LOG = "the log: {}"
    STOP_BUTTON = "{}"
    # Drones that fly under no ground, and other grounds
    FLYING = "drones are flying under no ground: `gcs take-control`, `gcs land` or `gcs stop`"
    ARMED_IN = "{}: armed, in {}"
    IN_AIR = "{}: in the air, it says ({})"
    OTHER_GROUND = "another ground is alive ({}): end it first"
    NONE_ARMED = "no drone is armed, there is nothing to take control of: `gcs arm`"
    NO_POSE_TO_LEAD = "{}: no fresh pose to lead it from: `gcs land` or `gcs stop`"
    NONE_FLIES = "every drone is on the ground and disarmed: there is nothing to land"
    JOINING = "{}: does not follow this ground yet"
    # Take-off and reset
    NOT_ARMED = "not every drone has armed yet: wait until `gcs arm` answers"
    DISARMS_ITSELF = "{}: disarms itself in {:.1f} s, a take-off needs {:g} s: `gcs land`, then `gcs arm`"
    ARMED = "{}: armed"
    MAY_BE_ARMED = "{0}: no heartbeat (last heard {1}), it may be armed: switch it on, or `gcs exclude {0}`"
    # Who takes part
    NO_DRONE = "{}: none of the lab's drones ({})"
    LEADER_NEEDED = "{}: nothing is formed without the leader{}"
    NONE_LEFT = "no follower would be left{}"
    NOT_FLYING = "{}: does not fly in the formation"
    # Who joins in flight
    NOT_CLEAR = "{}: {:.2f} m beside {}: it rises alone where it is {:.2f} m clear of all"
    RISING = "{}: it rises to join: wait until it is at its height"
    # A spare
    NO_SYSID = "{!r} is no system id: 1 to 250"
    SYSID_IN_USE = "system {} is {}'s already"
    OWN_LINK = (
        "{}: its link {} is its own: write the spare's link and sysid into the lab file, and start `gcs run` again"
    )
    KEYS_BY_SYSID = "this lab has keys, made by system id: write sysid = {} into the lab file, then `gcs keys new`"
    SPARE_UNHEARD = (
        "nothing is heard of system {0}: is it on, and its bridge (`drone-agent --lab ... --body {1} --sysid {0}`)?"
    )
    SPARE_ARMED = "system {}: armed: it takes a place disarmed, on the floor"
    SPARE_AWAITED = "another spare is listened for: ask again"
    # Shapes and trajectories
    LEADER_OBSERVED = "{}: it is only observed, and flies what it flies"
    LEADER_UNSEEN = "{}: no fresh pose, there is nothing to form on"
    SLOT_OUTSIDE = "{}: its slot would be outside the fence, {}"
    LEADER_OUTSIDE = "{}: it would be outside the fence, {}"
    NOT_INTERRUPTED = "no trajectory was interrupted by a hold: `gcs start`"
    NO_TIME = "the time to begin is past, or more than an hour ahead"
    LED_HOME = "the drones are led home: `gcs hold` first"
    NO_START = "{}: where it took off is not known: `gcs land` lands it where it is"
    NO_VELOCITY = "{!r}: a body, x, y, z in m/s and a turn in rad/s are wanted"
    NOT_LEADER = "{}: in formation the leader alone is moved: `gcs hold` first"
    MOVED_ALREADY = "{} is moved by somebody"
    NO_SHAPE = "{}"
    NO_TRANSITION = "{}"
    NO_TRAJECTORY = "{}"
    INFEASIBLE = "{}"

    @property
    def code(self) -> str:
        """Its name in JSON and logs."""
        return self.name.lower()

    def of(self, *values: object) -> "Reject":
        """This reason, with the values that its text names."""
        return Reject(self, values)


@dataclass(frozen=True, slots=True)
class Reject:
    """One reason against a request, with the values that its text names."""

    reason: Reason
    values: tuple[object, ...] = ()

    @property
    def text(self) -> str:
        """In words."""
        return self.reason.template.format(*self.values)
