"""One commanded drone as the flight handles it: its stage (gcs.drones.stages), setpoint, link and landing."""

from dataclasses import dataclass, field

from formation.guidance.plan import IDLE, Setpoint
from formation.maths.arrays import Vec3
from formation.model import Vec3Tuple
from gcs.drones.land_detector import AIRBORNE_STATES, NEAR_FLOOR_M, LandDetector
from gcs.drones.link_state import DroneLink
from gcs.drones.stages import MOTORS_OFF, ROWS, TABLE, Row, Stage, Trigger, control
from gcs.drones.telemetry import NEVER_NS
from wire.link_messages import LandedState

CONFIRM_NS = 1_000_000_000  # an answer stands until the next heartbeat can confirm it
WORDS_NS = 300_000_000  # an autopilot's reasons come beside its answer, before it or after
OWN_LANDING_NS = 2_500_000_000
TAKE_OFF_S = 3.0  # thrust takes two to rise (formation.control.attitude), its own landing detector one to notice
IDLE_DISARM_WITHIN_S = 0.5
PATIENCE_NS = 5_000_000_000  # how long a drone is waited for that is silent, rejects its disarm, or does not follow yet


@dataclass(slots=True)
class Drone:
    """index: its place among the n vehicles. since_ns: when its stage began. start_lab_m: where it stood on the floor,
    None where it took off under no ground or another.

    excluded: takes no part in the flight, and stays on the floor; a stop stops it, too. rises: to join those that fly;
    it arms and takes off alone. leaving_to: the spot, x and y,
    where it lands alone while the others fly on. checked: its parameters have been read and wrong ones reported.
    landing_itself: its autopilot was seen to land since it was commanded to. stopped_ns: when it reported its cut
    motors off.
    """

    index: int
    link: DroneLink
    stage: Stage = Stage.FOLLOW
    since_ns: int = NEVER_NS
    setpoint: Setpoint = IDLE
    floor: LandDetector = field(default_factory=LandDetector)
    start_lab_m: Vec3Tuple | None = None
    excluded: bool = False
    rises: bool = False
    leaving_to: tuple[float, float] | None = None
    checked: bool = False
    landing_itself: bool = False
    stopped_ns: int | None = None

    def enter(self, trigger: Trigger, now_ns: int) -> bool:
        """Change the stage, if the trigger means anything in this one; whether it has changed."""
        after = TABLE.get((self.stage, trigger), self.stage)
        if after is self.stage:
            return False
        self.stage, self.since_ns = after, now_ns
        self.landing_itself, self.stopped_ns = False, None
        return True

    @property
    def row(self) -> Row:
        """What its stage asks for."""
        return ROWS[self.stage]

    @property
    def reached(self) -> bool:
        """Whether the drone has reported its stage's goal since it began."""
        reached = ROWS[self.stage].reached
        return reached is None or (self.link.telemetry.heartbeat_ns > self.since_ns and reached(self.link))

    @property
    def flown(self) -> bool:
        """Whether it is sent setpoints: not after a release or a motor cut, nor while a pilot flies it."""
        return ROWS[self.stage].streams and not self.excluded

    @property
    def led_to(self) -> Setpoint:
        """Its setpoint for the control: none without setpoints."""
        return self.setpoint if self.flown else IDLE

    @property
    def piloted(self) -> bool:
        """Whether a pilot has taken it over."""
        return self.stage is Stage.PILOTED

    def rejects(self, now_ns: int) -> bool:
        """Whether its autopilot has rejected the step to the goal that was asked last, and its words have come."""
        step = None if self.reached else self.row.command(self.link, now_ns - self.since_ns)
        answer = None if step is None else self.link.commands.answers.get(step)
        if answer is None or answer.result is None or answer.accepted or answer.t_ns < self.since_ns:
            return False
        return now_ns - answer.t_ns >= WORDS_NS

    def joining(self, now_ns: int) -> bool:
        """Whether it is only just being taken over, and is given time to follow."""
        return self.stage is Stage.JOIN and not self.reached and now_ns - self.since_ns < PATIENCE_NS

    def awaited(self, now_ns: int) -> bool:
        """Whether it is being taken over and has not even accepted to follow: its motion is not ours yet."""
        if not self.joining(now_ns) or self.link.model is None or self.link.offboard:
            return False
        answer = self.link.commands.answers.get(self.link.model.set_offboard(self.link.target))
        return answer is None or not answer.accepted or answer.t_ns < self.since_ns

    @property
    def is_landed(self) -> bool:
        """Whether it has reported its motors off since it was commanded to land, to disarm or to stop."""
        return self.stage in MOTORS_OFF and self.reached

    @property
    def is_coming_down(self) -> bool:
        """Whether it has landed, or its autopilot lands it; a landing is not interrupted."""
        link = self.link
        return not link.armed or link.landing or link.telemetry.landed is LandedState.ON_GROUND

    def is_lost(self, now_ns: int) -> bool:
        """Whether it fell silent before it reported that its motors are off, and is sent no setpoints any more."""
        silent_ns = now_ns - max(self.link.telemetry.received_ns, self.since_ns)
        return self.stage in (Stage.RELEASED, Stage.CUT) and not self.reached and silent_ns > PATIENCE_NS

    def is_awaited_down(self, now_ns: int) -> bool:
        """Whether a landing still waits for it: not for a pilot's drone, nor for a lost one."""
        return not (self.excluded or self.piloted or self.is_landed or self.is_lost(now_ns))

    def disarms_in_s(self, now_ns: int) -> float | None:
        """How long until it disarms by itself for want of a take-off; None where it is not about to."""
        since_ns, timeout_s = self.link.armed_clock.since_ns, self.link.idle_disarm_s
        if since_ns is None or timeout_s is None or self.floor.lifted:
            return None
        return max(timeout_s - (now_ns - since_ns) * 1e-9, 0.0)

    @property
    def idle_disarm_text(self) -> str:
        """Why it is disarmed, where that was its own time-out; else the empty text."""
        timeout_s, model = self.link.idle_disarm_s, self.link.model
        waited = timeout_s is not None and self.link.armed_clock.lasted_s >= timeout_s - IDLE_DISARM_WITHIN_S
        if self.link.armed or self.floor.lifted or model is None or not waited:
            return ""
        return f"{self.link.name} disarmed itself: no take-off in {timeout_s:g} s ({model.table.idle_disarm_parameter})"

    def detect_pilot(self, now_ns: int) -> bool:
        """Detect that a pilot has taken it over in flight; true once. A stop of the swarm still stops it."""
        is_released = self.stage is Stage.RELEASED
        self.landing_itself = self.landing_itself or (is_released and self.link.landing)
        if not self.floor.lifted or not self.link.piloted or (is_released and not self.landing_itself):
            return False  # or the command to land is still on its way
        return self.enter(Trigger.PILOT, now_ns)

    def pursue(self, now_ns: int) -> None:
        """Ask for the next command towards the goal; nothing when it is reached, or while one is on its way.

        If a landed drone keeps rejecting a disarm, the disarm is forced, provided that two independent estimates
        confirm the landing. Else the drone is released.
        """
        link, lasted_ns = self.link, now_ns - self.since_ns
        if self.stage is Stage.CUT:  # an acknowledgement may be another command's; armed again is not stopped
            self.stopped_ns = (self.stopped_ns or link.telemetry.heartbeat_ns) if self.reached else None
        if self.stage is Stage.DISARM and not self.reached:
            if self.floor.touched and link.telemetry.landed in AIRBORNE_STATES and lasted_ns < OWN_LANDING_NS:
                return  # it would refuse: its own landing detector has not seen yet what the mocap saw
            if lasted_ns > PATIENCE_NS:
                self._force_disarm(now_ns)
        if self.reached:
            if link.commands.urgent:
                link.commands.end_urgent()
            return
        command = self.row.command(link, now_ns - self.since_ns)
        if command is None:
            return
        answer = link.commands.answers.get(command)
        if self.stage is Stage.CUT:
            link.commands.ask_urgently(command)
        elif answer is None or now_ns - answer.t_ns >= CONFIRM_NS:
            link.commands.ask(command)

    def _force_disarm(self, now_ns: int) -> None:
        """Force the disarm if the landed state, or the height by the mocap, confirms the landing; else release it."""
        if self.link.piloted:
            self.enter(Trigger.PILOT, now_ns)
        elif self.floor.height_m < NEAR_FLOOR_M or self.link.telemetry.landed is LandedState.ON_GROUND:
            self.enter(Trigger.CUT, now_ns)
        else:
            self.enter(Trigger.RELEASE, now_ns)

    def stand(self, now_ns: int) -> None:
        """It is on the floor, landed or never risen: no thrust any more, and disarmed."""
        self.floor.touched, self.setpoint = True, IDLE
        if not self.excluded:
            self.enter(Trigger.DISARM, now_ns)

    def exchange(self, link: DroneLink, now_ns: int) -> None:
        """Another drone stands in its place, behind that link."""
        self.link, self.floor, self.start_lab_m, self.checked = link, LandDetector(), None, False
        self.enter(Trigger.REST, now_ns)

    def arm(self, now_ns: int) -> None:
        """A flight begins, for who takes part."""
        self.floor.lifted = False
        self.link.reports.texts.clear()
        self.enter(Trigger.REST if self.excluded else Trigger.ARM, now_ns)

    def note_start(self, pos_lab_m: Vec3, now_ns: int) -> None:
        """It stands there, on the floor."""
        x_m, y_m, z_m = pos_lab_m.tolist()
        self.start_lab_m, self.floor.rest_z_m = (x_m, y_m, z_m), z_m
        self.link.own_estimate.settle(pos_lab_m, now_ns)

    def join(self, now_ns: int) -> None:
        """It flies under no ground: it is to follow this one, from where it is."""
        self.excluded, self.floor.lifted, self.start_lab_m = False, True, None
        self.link.commands.reset_answer(control(self.link))
        self.enter(Trigger.JOIN, now_ns)

    def land_alone(self, now_ns: int) -> None:
        """Nobody leads it: if it is armed, or was not heard of, its autopilot lands it."""
        self.floor.lifted = self.link.armed or self.link.telemetry.heartbeat is None
        self.enter(Trigger.REST, now_ns)
        if self.floor.lifted:
            self.enter(Trigger.RELEASE, now_ns)

    def lead(self, setpoint: Setpoint, trigger: Trigger, now_ns: int) -> None:
        """A new phase: another setpoint, another stage; a released or cut drone stays so."""
        self.setpoint = setpoint
        self.floor.reset()
        if not self.excluded:
            self.enter(trigger, now_ns)
