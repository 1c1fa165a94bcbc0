"""A fake drone (ideal attitude, point mass, the least of the protocol) and a lab that joins drones to a GcsCore."""

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.messages import (
    Cause,
    Datagram,
    LabFrame,
    OperatorReply,
    OperatorRequest,
    Phase,
    Rejection,
    Severity,
    Verb,
)
from formation.reasons import Reason
from formation.vehicle.profile import profile
from gcs.core import GcsCore, Outgoing
from wire.ground_state import GroundState, decode, encode
from wire.link_messages import (
    Address,
    AttitudeQuaternion,
    AttitudeSetpoint,
    CommandAck,
    CommandLong,
    EkfStatus,
    Heartbeat,
    LinkMessage,
    LocalPosition,
    MavAutopilot,
    MessageId,
    ParamRequestRead,
    ParamType,
    ParamValue,
    Result,
    StatusText,
    TimeSync,
    ground_address,
)
from wire.mavlink.codec import Codec, param_to_raw

G = 9.8
MS = 1_000_000
T0_NS = 5_000_000_000
AHEAD_NS = 7_000_000_000  # a drone's clock
PX4_OFFBOARD, PX4_LAND, COPTER_GUIDED, COPTER_LAND = 6 << 16, 4 << 16 | 6 << 24, 4, 9
PX4_PARAMETERS = {"COM_OF_LOSS_T": 0.2, "CBRK_FLIGHTTERM": 0, "COM_OBL_RC_ACT": 4, "EKF2_EV_CTRL": 11,
                  "EKF2_HGT_REF": 3,
                  "EKF2_EVP_NOISE": 0.01, "EKF2_GPS_CTRL": 0, "EKF2_MAG_TYPE": 5, "COM_RCL_EXCEPT": 4,
                  "COM_DISARM_PRFLT": 10.0}  # fmt: skip
COPTER_PARAMETERS = {"DISARM_DELAY": 10, "GUID_OPTIONS": 8, "GUID_TIMEOUT": 1.0, "FS_GCS_ENABLE": 5, "VISO_TYPE": 1,
                     "EK3_SRC1_POSXY": 6, "EK3_SRC1_POSZ": 6, "EK3_SRC1_VELXY": 0, "EK3_SRC1_VELZ": 0,
                     "EK3_SRC1_YAW": 6}  # fmt: skip


class FakeDrone:
    """Ideal attitude response; flies while armed and told to; its failures are switches."""

    def __init__(self, sysid: int, pos_lab_m, hover: float, autopilot: MavAutopilot = MavAutopilot.PX4) -> None:
        self.sysid, self.hover, self.autopilot = sysid, hover, autopilot
        self.pos, self.vel, self.q = np.array(pos_lab_m, float), np.zeros(3), frames.IDENTITY
        self.armed, self.mode, self.thrust = False, 0, 0.0
        self.codec = Codec(Address(sysid, 1))
        px4 = autopilot is MavAutopilot.PX4
        self.offboard, self.land = (PX4_OFFBOARD, PX4_LAND) if px4 else (COPTER_GUIDED, COPTER_LAND)
        name = "MPC_THR_HOVER" if px4 else "MOT_THST_HOVER"
        self.parameters = {**(PX4_PARAMETERS if px4 else COPTER_PARAMETERS), name: hover}
        self.ahead_ns = AHEAD_NS
        self.rejects_arming = self.sends_nothing = self.receives_nothing = False
        self.ignore_first = 0
        self.ground = self.owner = ground_address(0)
        self.knows_owners = True
        self.last_setpoint_ns = 0
        self.heard: list[LinkMessage] = []
        self.setpoints: list[tuple[int, AttitudeSetpoint]] = []
        self._out: list[bytes] = []
        self._beat_ns = self._own_ns = 0
        self.own_shift = np.zeros(3)  # how far off its own estimate is
        self.own_q = None  # what it believes its attitude to be, if not what it is

    def receive(self, data: bytes, now_ns: int) -> None:
        if self.receives_nothing:
            return
        for packet in self.codec.receive(data):
            self.heard.append(packet.message)
            self.ground = packet.source
            self._react(packet.message, now_ns)

    def _react(self, message: LinkMessage, now_ns: int) -> None:
        match message:
            case AttitudeSetpoint():
                self.setpoints.append((now_ns, message))
                if self.armed and self.mode == self.offboard and self.owner == self.ground:
                    self.last_setpoint_ns = now_ns
                    self.q, self.thrust = message.q_lab_from_flu, message.thrust_norm
            case CommandLong():
                if self.ignore_first:
                    self.ignore_first -= 1
                    return
                self._say(CommandAck(self.ground, message.command, self._obey(message)))
            case ParamRequestRead() if message.name in self.parameters:
                value = self.parameters[message.name]
                kind = ParamType.INT32 if isinstance(value, int) else ParamType.REAL32
                raw = param_to_raw(value, kind, self.autopilot)
                self._say(ParamValue(message.name, raw, kind, len(self.parameters), 0))
            case TimeSync() if message.tc1_ns == 0:
                self._say(TimeSync(now_ns + self.ahead_ns, message.ts1_ns, self.ground))

    def _obey(self, command: CommandLong) -> Result:
        match command.command:
            case 400 if command.params[0] == 1.0:
                if self.rejects_arming:
                    self._say(StatusText(Severity.CRITICAL, "PreArm: no position"))
                    return Result.DENIED
                self.armed = True
            case 400:
                if self.pos[2] > 0.05 and command.params[1] != 21196.0:
                    return Result.DENIED
                self.armed, self.thrust = False, 0.0
            case 176:
                px4 = self.autopilot is MavAutopilot.PX4
                self.mode = int(command.params[1]) << 16 if px4 else int(command.params[1])
            case 21:
                self.mode = self.land
            case 512 if command.params[0] == MessageId.HEARTBEAT:
                self._beat_ns = 0
            case 32100:
                if not self.knows_owners:
                    return Result.UNSUPPORTED
                self.owner = self.ground
        return Result.ACCEPTED

    def _say(self, message: LinkMessage) -> None:
        self._out.append(self.codec.encode(message))

    def advance(self, now_ns: int, dt_s: float) -> None:
        """Point mass under thrust along the body's up axis; a floor at z = 0."""
        if self.mode == self.land and self.armed:
            self.q, self.thrust = frames.IDENTITY, self.hover
            self.vel = np.array([0.0, 0.0, -0.5])
            if self.pos[2] <= 0.0:
                self.armed, self.thrust = False, 0.0
        elif self.armed and self.pos[2] > 0.0 and (self.mode != self.offboard or self._forsaken(now_ns)):
            self.q, self.thrust, self.vel = frames.IDENTITY, self.hover, np.zeros(3)  # it holds its place
        lift = self.thrust / self.hover * G if self.armed else 0.0
        w, x, y, z = self.q.tolist()
        up = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
        acc = lift * up - np.array([0.0, 0.0, G])
        self.vel = self.vel + dt_s * acc
        self.pos = self.pos + dt_s * self.vel
        if self.pos[2] <= 0.0:
            self.pos[2], self.vel = 0.0, np.zeros(3)

    def _forsaken(self, now_ns: int) -> bool:
        return now_ns - self.last_setpoint_ns > 100 * MS

    def outgoing(self, now_ns: int) -> list[bytes]:
        if now_ns - self._beat_ns >= 1_000_000_000:
            self._beat_ns = now_ns
            status = 4 if self.armed else 3
            self._say(Heartbeat(self.autopilot, 2, 1 | (128 if self.armed else 0), self.mode, status))
            if self.autopilot is MavAutopilot.ARDUPILOT:
                self._say(EkfStatus(0x10, ardupilot=True))
        if now_ns - self._own_ns >= 10 * MS:
            self._own_ns = now_ns
            t_ms = (now_ns + self.ahead_ns) // MS
            self._say(AttitudeQuaternion(t_ms, self.q if self.own_q is None else self.own_q, np.zeros(3)))
            self._say(LocalPosition(t_ms, self.pos + self.own_shift, self.vel))
        out, self._out = self._out, []
        return [] if self.sends_nothing else out


class FakeLab:
    """A GcsCore and fake drones joined by a function; 100 Hz frames, links without delay."""

    def __init__(self, config: LabConfig, autopilots: dict[int, MavAutopilot] | None = None) -> None:
        self.config = config
        self.core = GcsCore(config, T0_NS)
        self.now_ns = T0_NS
        self.seq = 0
        self.noise = np.random.default_rng(7)
        self.drones = {
            v.sysid: FakeDrone(v.sysid, _start(config, i), _hover(v), (autopilots or {}).get(v.sysid, MavAutopilot.PX4))
            for i, v in enumerate(config.vehicles)
            if v.sysid is not None
        }
        self.in_place: dict[str, int] = {}
        """Whose body another system than the lab's is."""
        self.leader_pos = np.array([0.0, 0.0, 0.3])
        self.hidden: set[str] = set()
        self.rejected: set[str] = set()
        self.shift_m: dict[str, tuple[float, float, float]] = {}
        self.frames_stopped = False
        self.replies: list[OperatorReply] = []
        self.records: list[tuple[str, object]] = []
        self.ticks: list[tuple[int, Outgoing]] = []
        self.requests = 0

    @property
    def phase(self) -> Phase:
        return self.core.phase

    def ask(self, verb: Verb, argument: str = "") -> int:
        self.requests += 1
        self.core.receive(OperatorRequest(self.requests, verb, argument), self.now_ns)
        self._tick_while_due()
        return self.requests

    def restart_ground(self, after_s: float = 0.0) -> None:
        """The ground dies, and `after_s` later another begins, of the next session."""
        frames_stopped, self.frames_stopped = self.frames_stopped, True
        core, self.core = self.core, _Nobody()
        self.run(after_s)
        self.core, self.frames_stopped = GcsCore(self.config, self.now_ns, core._session + 1), frames_stopped

    def reply(self, request: int) -> OperatorReply | None:
        return next((r for r in self.replies if r.id == request), None)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def run_until(self, phase: Phase, longest_s: float = 30.0) -> None:
        for _ in range(round(longest_s * 100)):
            if self.phase is phase:
                return
            self.step()
        raise AssertionError(f"still in {self.phase.name}, not {phase.name}; {self.events[-5:]}")

    def command(self, verb: Verb, phase: Phase) -> None:
        request = self.ask(verb)
        self.run_until(phase)
        while self.reply(request) is None:
            self.step()
        assert self.reply(request).accepted, self.reply(request).text

    def take_off(self) -> None:
        """Arm, and take off into HOLD."""
        self.run(2.0)
        self.command(Verb.ARM, Phase.ARMED)
        self.command(Verb.TAKEOFF, Phase.TAKEOFF)
        self.run_until(Phase.HOLD)

    def fly(self) -> None:
        """Take off, and take up the formation."""
        self.take_off()
        self.command(Verb.START, Phase.FORMATION)

    def land(self) -> None:
        """Land, down to the phase GROUND, in which no motor runs."""
        self.command(Verb.LAND, Phase.LAND)
        self.run_until(Phase.GROUND)
        assert not any(drone.armed for drone in self.drones.values())

    @property
    def state(self) -> GroundState:
        """What the ground publishes, as who hears it on the bus has it."""
        return decode(encode(self.core.state(self.now_ns)))

    @property
    def reported(self) -> list[tuple[str, str]]:
        """The code and the subject of each event that has a code; of the end of a condition `over` before it."""
        events = [e for name, e in self.records if name == "event" and e.code]
        return [(f"over {e.code}" if e.ends else e.code, e.subject) for e in events]

    @property
    def causes(self) -> list[Cause]:
        """Why the phase has changed, each time."""
        return [change.code for name, change in self.records if name == "phase"]

    @property
    def events(self) -> list[str]:
        return [e.text for name, e in self.records if name == "event"]

    def step(self) -> None:
        self.now_ns += 10 * MS
        for drone in self.drones.values():
            drone.advance(self.now_ns, 0.01)
        if not self.frames_stopped:
            self.seq += 1
            self.core.receive(self.frame(), self.now_ns)
        for drone in self.drones.values():
            for data in drone.outgoing(self.now_ns):
                self.core.receive(Datagram(drone.sysid, data), self.now_ns)
        if self.core.next_deadline_ns() <= self.now_ns:
            self._tick_while_due()

    def frame(self) -> LabFrame:
        vehicles = self.config.vehicles
        flown = [self.drones.get(self.in_place.get(v.body, v.sysid)) for v in vehicles]
        pos = np.array([self.leader_pos if drone is None else drone.pos for drone in flown])
        q = np.array([frames.IDENTITY if drone is None else drone.q for drone in flown])
        pos = pos + self.noise.normal(0.0, 1e-4, pos.shape)
        pos = pos + np.array([self.shift_m.get(v.body, (0.0, 0.0, 0.0)) for v in vehicles])
        seen = np.array([v.body not in self.hidden | self.rejected for v in vehicles])
        codes = np.array([Rejection.JUMP if v.body in self.rejected else 0 for v in vehicles], np.uint8)
        return LabFrame(self.seq, self.now_ns - 5 * MS, tuple(v.body for v in vehicles), pos, q, seen, rejected=codes)

    def _tick_while_due(self) -> None:
        for _ in range(4):
            out = self.core.tick(self.now_ns)
            self.ticks.append((self.now_ns, out))
            self.replies += out.replies
            self.records += [(topic.name, message) for topic, message in out.records]
            for datagram in out.datagrams:
                self.drones[datagram.sysid].receive(datagram.data, self.now_ns)
            if self.core.next_deadline_ns() > self.now_ns:
                return
        raise AssertionError("the core wants to tick without end")


STAY = {"body": "lead", "sysid": 1, "trajectory": {"kind": "hold", "duration_s": 60.0}}


def answer(lab: FakeLab, verb: Verb, argument: str = "") -> OperatorReply:
    """The reply to a request that is answered at once."""
    reply = lab.reply(lab.ask(verb, argument))
    assert reply is not None
    return reply


def accepted(lab: FakeLab, verb: Verb, argument: str = "") -> str:
    """The reply to a request that is accepted, in words."""
    reply = answer(lab, verb, argument)
    assert reply.accepted, reply.text
    return reply.text


def refusal(lab: FakeLab, verb: Verb, argument: str = "") -> str:
    """Why the request is refused, in words."""
    return rejected(lab, verb, argument).text


def reasons(lab: FakeLab, verb: Verb, argument: str = "") -> list[Reason]:
    """Why the request is refused."""
    return [Reason[code.upper()] for code in rejected(lab, verb, argument).codes]


def rejected(lab: FakeLab, verb: Verb, argument: str = "") -> OperatorReply:
    """The reply to a request that is refused."""
    reply = answer(lab, verb, argument)
    assert not reply.accepted
    return reply


def commands(drone: FakeDrone, number: int) -> list[CommandLong]:
    """Those of that number which the drone has heard."""
    return [m for m in drone.heard if isinstance(m, CommandLong) and m.command == number]


class _Nobody:
    """In the place of a ground that is dead."""

    phase = Phase.GROUND

    def receive(self, message, now_ns: int) -> None:
        pass

    def next_deadline_ns(self) -> int:
        return 2**62


def _start(config: LabConfig, i: int):
    if i == 0:
        return (0.0, 0.0, 0.0)
    x, y, _ = config.followers[i - 1].offset_m
    return (x, y, 0.0)


def _hover(vehicle) -> float:
    return profile(vehicle.profile).hover_thrust_norm


def triangle(**changes) -> LabConfig:
    """The paper's triangle: leader and two followers."""
    values = {
        "leader": {"body": "lead", "sysid": 1, "trajectory": {"kind": "line", "duration_s": 3.0}},
        "followers": [
            {"body": "left", "sysid": 2, "offset_m": (-0.4, 0.4, 0.0)},
            {"body": "right", "sysid": 3, "offset_m": (-0.4, -0.4, 0.0)},
        ],
    }
    return LabConfig.model_validate({**values, **changes})


def flying(**changes) -> FakeLab:
    """The triangle, a second in formation."""
    lab = FakeLab(triangle(**changes))
    lab.fly()
    lab.run(1.0)
    return lab
