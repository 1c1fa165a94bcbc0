"""The autopilot's HIGHRES_IMU for the bridge: asked for where it does not come. No sockets."""

from drone_agent.bridge.reckoning import Reckoning
from wire.clock_offset import SenderClock
from wire.link_messages.address import Address
from wire.link_messages.commands import CommandAck, CommandLong, MavCommand, Result, command_long
from wire.link_messages.message_id import MessageId
from wire.link_messages.motion import InertialSample
from wire.timesync import TimeSyncClient

_LISTEN_NS = 1_500_000_000  # before it is asked for: the autopilot may send it anyhow
_ASK_NS = 1_000_000_000
_SHARE = 0.4  # of the rate wanted: what comes more slowly is asked for
_PATIENCE_NS = 5_000_000_000  # of asking, before the operator is told that it does not come
LACKS = "No HIGHRES_IMU: sliding poses are not found"


class InertialStream:
    """One autopilot's; what it tells goes to `reckoning`, each sample at the time on our clock when it was made.

    sync: the autopilot's clock, which stamps alone do not tell: a slow clock and a growing queue look the same. Where
    it answers no TIMESYNC, its quickest sample counts.
    """

    def __init__(self, target: Address, rate_hz: float, reckoning: Reckoning, t0_ns: int) -> None:
        """rate_hz: wanted; 0: none, and all passes as it comes."""
        self._unasked, self._wanted = True, False
        """Whether it came before anybody asked; whether the ground did."""
        self._target, self._rate_hz = target, rate_hz
        self._reckoning = reckoning
        self._stamps = SenderClock()
        self.sync = TimeSyncClient(target)
        self.restarted(t0_ns)

    @property
    def passes(self) -> bool:
        """Whether the ground is to hear it."""
        return self._unasked or self._wanted

    def hear(self, sample: InertialSample, now_ns: int) -> None:
        """A sample came."""
        self._count += 1
        by_stamps_ns = self._stamps.made_ns(sample.t_boot_us * 1000, now_ns)
        synchronised_ns = self.sync.clock.to_ours_ns(sample.t_boot_us * 1000)
        made_ns = by_stamps_ns if synchronised_ns is None else min(synchronised_ns, now_ns)
        self._reckoning.feel(made_ns, sample.specific_force_flu_m_s2, sample.rate_flu_rad_s)

    def restarted(self, now_ns: int) -> None:
        """The autopilot is new, or was: listen, then ask again."""
        self.sync = TimeSyncClient(self._target)
        self._asks_ns, self._count, self._refused = now_ns + _LISTEN_NS, 0, self._rate_hz <= 0.0
        self._lacks_ns: int | None = None
        self._told = self._refused

    def answered(self, ack: CommandAck) -> None:
        """The autopilot answered a command of ours: what it does not know is not asked for again."""
        if ack.command == MavCommand.SET_MESSAGE_INTERVAL and ack.result is not Result.ACCEPTED:
            self._refused = True

    def due(self, now_ns: int) -> CommandLong | None:
        """The request to send now, where too little comes."""
        if self._refused or now_ns < self._asks_ns:
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

    def tells(self, now_ns: int) -> bool:
        """Whether the operator is to be told, once, that it does not come."""
        lacks = self._refused or (self._lacks_ns is not None and now_ns - self._lacks_ns >= _PATIENCE_NS)
        tells, self._told = lacks and not self._told, self._told or lacks
        return tells

    def requested(self, command: CommandLong) -> bool:
        """The ground sets a message's interval; whether that is this message's and ends here, as good as done."""
        if command.command != MavCommand.SET_MESSAGE_INTERVAL or command.params[0] != MessageId.HIGHRES_IMU:
            return False
        interval_us = command.params[1]
        self._wanted = interval_us >= 0.0
        self._unasked = self._unasked and self._wanted
        return not self._refused and not 0.0 < interval_us <= 1e6 / self._rate_hz
