"""Gives an autopilot its signing key over a serial line, by SETUP_SIGNING, and has it prove that it has it."""

from collections.abc import Callable
from pathlib import Path

import serial

from gcs.security.signing_probe import ASK_S, ASKS, ProbeOutcome, SigningProbe
from wire import clock
from wire.errors import ConfigError
from wire.link_messages import DRONE_COMPONENT, GROUND
from wire.mavlink.framing import framed, layout
from wire.mavlink.signing import SigningChannel, StampClock, stamp_at
from wire.security.private_keys import (
    AUTOPILOT,
    INSTALLED,
    KEY_BYTES,
    StampFile,
    drone_stamp_file,
    read_mavlink_key,
    read_mavlink_keys,
    write_private,
)
from wire.transport.serial_link import device_and_baud

LINK = 1
"""A stream of its own: an autopilot whose stamps are ahead of the clock would take the ground's for replayed ones."""
PRESENT_S, TURN_S = 5.0, 0.05
"""How long the autopilot's first packet is awaited, and how long one read of the line takes."""
_SETUP_SIGNING = layout("SETUP_SIGNING", 3 + KEY_BYTES)


def setup_signing(sysid: int, component: int, key: bytes, stamp: int, seq: int) -> bytes:
    """SETUP_SIGNING (256) for an autopilot: its key, and the stamp from which packets count."""
    return framed(_SETUP_SIGNING, (sysid, component, *key, stamp), GROUND, seq).data


def send_key(own: Path, line: str) -> ProbeOutcome:
    """Send the key of an installed drone to the autopilot on a line DEV:BAUD, and probe it. ConfigError, OSError.

    Behind a bridge the autopilot has a key of its own, which is never on the network. One that has a key already takes
    the new one from a packet that the old one signs. The key that it proves to have is the bridge's from then on.
    """
    mavlink_keys = read_mavlink_keys(own)
    sysids = tuple(mavlink_keys)
    if len(sysids) != 1:
        raise ConfigError([f"{own}: not the keys of one drone"])
    is_bridged = (own / AUTOPILOT).exists()
    key = read_mavlink_key(own / AUTOPILOT) if is_bridged else mavlink_keys[sysids[0]]
    stamps = StampFile(own / drone_stamp_file(mavlink_keys))
    stamp_clock = StampClock(stamps.read())
    try:
        device, baud = device_and_baud(f"serial:{line}")
    except ValueError as error:
        raise ConfigError([f"--serial: {line} is not DEV:BAUD"]) from error
    with serial.Serial(device, baud, timeout=TURN_S, write_timeout=1.0, exclusive=True) as port:
        probe = SigningProbe(sysids[0], SigningChannel(key, stamp_clock, sysids[0].__eq__, LINK))
        _await_autopilot(port, probe, line)
        _send(port, sysids[0], key, _installed(own, stamp_clock, sysids[0]))
        for signed in ASKS:
            port.write(probe.beat(clock.unix_us(), signed=True) + probe.ask(clock.unix_us(), signed=signed))
            _read(port, probe, ASK_S, lambda: False)
    stamps.store(stamp_clock.newest)
    if probe.outcome.has_key:
        write_private(own / INSTALLED, key.hex().encode())
    return probe.outcome


def _await_autopilot(port: serial.Serial, probe: SigningProbe, line: str) -> None:
    """OSError where nothing of that system comes: PX4 takes a key whichever system it is for."""
    until_ns = clock.monotonic_ns() + round(PRESENT_S * 1e9)
    while not probe.outcome.received:
        if clock.monotonic_ns() > until_ns:
            raise OSError(f"{line}: no autopilot of system {probe.sysid} speaks there; no key was sent")
        port.write(probe.beat(clock.unix_us(), signed=False))
        _read(port, probe, ASK_S, lambda: probe.outcome.received)


def _send(port: serial.Serial, sysid: int, key: bytes, old: SigningChannel | None) -> None:
    for seq in range(2):  # it is not acknowledged, so MAVLink's guide asks for more than one
        message = setup_signing(sysid, DRONE_COMPONENT, key, stamp_at(clock.unix_us()), seq)
        port.write(message if old is None else message + old.sign(message, clock.unix_us()))
    port.flush()


def _installed(own: Path, stamp_clock: StampClock, sysid: int) -> SigningChannel | None:
    """The autopilot's own key as it is by now; None where it has none."""
    if not (own / INSTALLED).exists():
        return None
    return SigningChannel(read_mavlink_key(own / INSTALLED), stamp_clock, sysid.__eq__, LINK)


def _read(port: serial.Serial, probe: SigningProbe, for_s: float, enough: Callable[[], bool]) -> None:
    """Hand over what comes for so long, or until it is enough."""
    until_ns = clock.monotonic_ns() + round(for_s * 1e9)
    while clock.monotonic_ns() < until_ns and not enough():
        probe.receive(port.read(max(port.in_waiting, 1)), clock.unix_us())
