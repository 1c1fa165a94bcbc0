"""Setpoints that a fault makes wild are still whole, and nothing else of the datagram is changed."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from sim.faults.channel import tilted
from wire.link_messages import Address, AttitudeSetpoint
from wire.mavlink.codec import Codec


def test_an_attitude_target_is_tilted_in_its_senders_name_and_the_rest_is_as_it_was() -> None:
    """As pymavlink reads it: body axes forward, right, down."""
    ground = common.MAVLink(None, srcSystem=255, srcComponent=25)
    beat = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(ground)
    level = common.MAVLink_set_attitude_target_message(123, 2, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5).pack(
        ground
    )
    reader = common.MAVLink(None)
    first, second = reader.parse_buffer(tilted(beat + level, 2.0)) or []
    assert first.get_type() == "HEARTBEAT"
    assert (second.get_srcSystem(), second.get_srcComponent(), second.time_boot_ms) == (255, 25, 123)
    assert 2.0 * np.arccos(abs(second.q[0])) == pytest.approx(2.0, abs=1e-3)
    assert abs(second.q[1]) == pytest.approx(np.sin(1.0), abs=1e-3)
    assert second.thrust == pytest.approx(0.5)
    (read,) = [p.message for p in Codec(Address(2, 1)).receive(tilted(level, 0.0))]
    assert isinstance(read, AttitudeSetpoint)
