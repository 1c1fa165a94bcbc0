"""The autopilot's HIGHRES_IMU for the bridge: asked for where it does not come. No sockets."""

from drone_agent.guard.estimate import BodyEstimate
from wire.clock_offset import TimeSyncClient
from wire.link_messages import (
    Address,
    AttitudeQuaternion,
    CommandAck,
    CommandLong,
    InertialSample,
    MavCommand,
    MessageId,
    Result,
    command_long,
)

_LISTEN_NS = 1_500_000_000  # before it is asked for: the autopilot may send it anyhow
_ASK_NS = 1_000_000_000
_SHARE = 0.4  # of the rate wanted: what comes more slowly is asked for
_LONGEST_NS = 20_000_000  # between samples that nobody asked for: beyond, some were lost
_PATIENCE_NS = 5_000_000_000  # of requests, before the report that the stream is missing
LACKS = "No HIGHRES_IMU: slow pose drift is not detected"


class InertialStream:
    """The IMU stream of one autopilot; each sample goes to `estimate` with its time on our clock.

    sync: the autopilot's clock.
    """

    def __init__(self, target: Address, rate_hz: float, estimate: BodyEstimate, t0_ns: int) -> None:
        """rate_hz: wanted; 0: none, and all passes as it comes."""
        self._unasked, self._wanted = True, False
        """Whether it came before anybody asked; whether the ground did."""
        self._target, self._rate_hz = target, rate_hz
        self._longest_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else _LONGEST_NS
        self._made_ns = t0_ns
        self._estimate = estimate
        self.sync = TimeSyncClient(target)
        self.restarted(t0_ns)

    @property
    def passes(self) -> bool:
        """Whether the ground is to hear it."""
        return self._unasked or self._wanted

    def receive_sample(self, sample: InertialSample, now_ns: int) -> None:
        """A sample came."""
        self._count += 1
        made_ns = self.sync.clock.made_ns(sample.t_boot_us * 1000, now_ns)
        # The estimate takes a sample for the mean of the interval until its time: its middle is when that was so.
        interval_ns, self._made_ns = min(max(made_ns - self._made_ns, 0), self._longest_ns), made_ns
        self._estimate.receive_imu(made_ns - self._delay_ns + interval_ns // 2, sample)

    def receive_attitude(self, attitude: AttitudeQuaternion, now_ns: int) -> None:
        """An attitude came."""
        made_ns = self.sync.clock.made_ns(attitude.t_boot_ms * 1_000_000, now_ns)
        self._estimate.receive_attitude(made_ns, attitude)

    def restarted(self, now_ns: int, delay_s: float = 0.0) -> None:
        """The autopilot is new, or was: listen, then ask again. delay_s: its table's `inertial_delay_s`."""
        self._delay_ns = round(delay_s * 1e9)
        self.sync = TimeSyncClient(self._target)
        self._asks_ns, self._count, self._rejected = now_ns + _LISTEN_NS, 0, self._rate_hz <= 0.0
        self._lacks_ns: int | None = None
        self._reported = self._rejected

    def answered(self, ack: CommandAck) -> None:
        """The autopilot answered a command of ours: what it does not know is not asked for again."""
        if ack.command == MavCommand.SET_MESSAGE_INTERVAL and ack.result is not Result.ACCEPTED:
            self._rejected = True

    def due(self, now_ns: int) -> CommandLong | None:
        """The request to send now, where too little comes."""
        if self._rejected or now_ns < self._asks_ns:
            return None
        lacks = self._count < _SHARE * self._rate_hz * _ASK_NS * 1e-9
        self._asks_ns, self._count = now_ns + _ASK_NS, 0
        if not lacks:
            self._lacks_ns = None
            return None
        self._lacks_ns = self._lacks_ns or now_ns
        self._unasked = False
        interval_us = 1e6 / self._rate_hz
        return command_long(self._target, MavCommand.SET_MESSAGE_INTERVAL, float(MessageId.HIGHRES_IMU), interval_us)

    def is_missing_report_due(self, now_ns: int) -> bool:
        """Whether to report now, once, that the stream is missing."""
        lacks = self._rejected or (self._lacks_ns is not None and now_ns - self._lacks_ns >= _PATIENCE_NS)
        is_missing_report_due, self._reported = lacks and not self._reported, self._reported or lacks
        return is_missing_report_due

    def requested(self, command: CommandLong) -> bool:
        """The ground sets a message's interval; whether that is this message's and ends here, as good as done."""
        if command.command != MavCommand.SET_MESSAGE_INTERVAL or command.params[0] != MessageId.HIGHRES_IMU:
            return False
        interval_us = command.params[1]
        self._wanted = interval_us >= 0.0
        self._unasked = self._unasked and self._wanted
        return not self._rejected and not 0.0 < interval_us <= 1e6 / self._rate_hz
