"""Which links of a bridge are signed towards its autopilot."""

import pytest

from wire.mavlink.signing import StampClock
from wire.security.private_keys import StampFile
from wire.security.protection import Protection, Signing


@pytest.mark.parametrize("link", ["serial:/dev/ttyACM0:921600", "udp:127.0.0.1:14580", "udp:192.0.2.2:14580"])
@pytest.mark.parametrize("has_key", [True, False])
def test_a_bridge_signs_where_the_autopilot_has_its_key_and_always_over_a_network(link, has_key, tmp_path) -> None:
    signing = Signing({2: bytes(range(32))}, StampClock(), StampFile(tmp_path / "stamp"), at_ground=True)
    protection = Protection(autopilot=signing, autopilot_has_key=has_key)
    signed = protection.towards_autopilot(link).channel(2) is not None
    assert signed is (has_key or "192.0.2.2" in link)
