"""Gives an autopilot its signing key over a serial line: SETUP_SIGNING, which no network ever carries."""

from pathlib import Path

import serial

from wire import clock
from wire.errors import ConfigError
from wire.link_messages.address import GROUND
from wire.mavlink.framing import framed, layout
from wire.mavlink.signing import stamp_at
from wire.security.private_keys import AUTOPILOT, KEY_BYTES, read_mavlink_key, read_mavlink_keys
from wire.transport.serial_link import device_and_baud

TIMES = 2
"""It is not acknowledged, so it is sent more than once, as MAVLink's guide asks."""
_SETUP_SIGNING = layout("SETUP_SIGNING", 3 + KEY_BYTES)


def setup_signing(sysid: int, component: int, key: bytes, stamp: int, seq: int) -> bytes:
    """SETUP_SIGNING (256) for an autopilot: its key, and the stamp from which packets count."""
    return framed(_SETUP_SIGNING, _SETUP_SIGNING.pack((sysid, component, *key, stamp)), GROUND, seq)


def send_key(own: Path, line: str) -> None:
    """Send the key of an installed drone to the autopilot on a line DEV:BAUD. ConfigError, OSError.

    Behind a bridge the autopilot has a key of its own, which is never on the network.
    """
    sysids = tuple(read_mavlink_keys(own))
    if len(sysids) != 1:
        raise ConfigError([f"{own}: not the keys of one drone"])
    inner = own / AUTOPILOT
    key = read_mavlink_key(inner) if inner.exists() else read_mavlink_keys(own)[sysids[0]]
    try:
        device, baud = device_and_baud(f"serial:{line}")
    except ValueError as error:
        raise ConfigError([f"--serial: {line} is not DEV:BAUD"]) from error
    with serial.Serial(device, baud, timeout=1.0, write_timeout=1.0, exclusive=True) as port:
        for seq in range(TIMES):
            port.write(setup_signing(sysids[0], 1, key, stamp_at(clock.unix_us()), seq))
        port.flush()
