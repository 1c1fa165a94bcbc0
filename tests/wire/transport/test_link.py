"""What of a drone's datagrams is delivered where many wait: the newest of its telemetry, and everything else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from formation.maths.frames import IDENTITY
from formation.messages import Severity
from tests.wire.messages import decode_packet
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeQuaternion,
    CommandAck,
    InertialSample,
    LocalPosition,
    MavCommand,
    Result,
    StatusText,
)
from wire.mavlink.codec import Codec
from wire.transport.link import newest

ZERO = np.zeros(3)


def attitude(ms: int, system: int = 1) -> bytes:
    return Codec(Address(system, 1)).encode(AttitudeQuaternion(ms, IDENTITY, ZERO))


def position(ms: int) -> bytes:
    return Codec(Address(1, 1)).encode(LocalPosition(ms, ZERO, ZERO))


def inertial(us: int) -> bytes:
    return Codec(Address(1, 1)).encode(InertialSample(us, ZERO, ZERO))


ACK = Codec(Address(1, 1)).encode(CommandAck(GROUND, MavCommand.NAV_LAND, Result.ACCEPTED))
TEXT = Codec(Address(1, 1)).encode(StatusText(Severity.ERROR, "PreArm: no position"))


def delivered(*datagrams: bytes) -> list[tuple[bytes, int]]:
    return newest([(data, 0) for data in datagrams])


def test_only_the_newest_of_a_telemetry_stream_is_delivered():
    assert delivered(attitude(1), position(1), attitude(2), position(2), attitude(3)) == [
        (position(2), 3),
        (attitude(3), 0),
    ]


def test_acknowledgements_texts_and_inertial_samples_are_never_superseded():
    waiting = (ACK, attitude(1), TEXT, ACK, inertial(1), attitude(2), inertial(2), ACK)
    assert [data for data, _ in delivered(*waiting)] == [ACK, TEXT, ACK, inertial(1), attitude(2), inertial(2), ACK]


def test_one_drones_telemetry_does_not_supersede_anothers():
    assert len(delivered(attitude(1, system=1), attitude(1, system=2))) == 2


def test_a_datagram_of_several_packets_is_dropped_only_if_all_are_superseded():
    both = attitude(1) + position(1)
    assert delivered(both, attitude(2)) == [(both, 0), (attitude(2), 0)]
    assert delivered(both, attitude(2), position(2)) == [(attitude(2), 2), (position(2), 0)]
    assert delivered(attitude(1) + ACK, attitude(2))[0] == (attitude(1) + ACK, 0)


@given(st.lists(st.sampled_from([attitude(1), attitude(2), position(1), ACK, inertial(3), b"\xfdjunk"]), max_size=40))
def test_nothing_is_lost_uncounted_and_order_is_kept(datagrams):
    got = delivered(*datagrams)
    assert len(got) + sum(superseded for _, superseded in got) == len(datagrams)
    rest = iter(datagrams)
    assert all(data in rest for data, _ in got)
    for number in {decode_packet(data).message.__class__ for data in datagrams if data != b"\xfdjunk"}:
        last = [data for data in datagrams if data != b"\xfdjunk" and isinstance(decode_packet(data).message, number)]
        assert last[-1] in [data for data, _ in got]
