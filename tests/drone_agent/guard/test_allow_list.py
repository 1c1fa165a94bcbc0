"""Of all messages of MAVLink's dialect the bridge on a network passes those of its table; pymavlink makes the bytes."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as oracle

from drone_agent.guard import allow_list
from drone_agent.guard.allow_list import ALLOWED, ALLOWED_COMMANDS, MotorState, reject_reason
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from formation.messages import Datagram
from wire.link_messages import Address, Heartbeat, MavAutopilot, MavState
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter

SYSID = 1
FOREIGN = {
    "SERIAL_CONTROL", "FILE_TRANSFER_PROTOCOL", "SETUP_SIGNING", "PARAM_SET", "PARAM_EXT_SET", "MISSION_ITEM_INT",
    "MISSION_CLEAR_ALL", "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "HIL_SENSOR", "GPS_INPUT", "PLAY_TUNE",
    "SET_HOME_POSITION", "SET_ACTUATOR_CONTROL_TARGET", "LOG_ERASE", "TUNNEL", "CHANGE_OPERATOR_CONTROL", "LED_CONTROL",
    "FLASH" "_NOTHING",
} - {"FLASH_NOTHING"}  # fmt: skip


def sender() -> oracle.MAVLink:
    """A ground of pymavlink's."""
    return oracle.MAVLink(None, srcSystem=255, srcComponent=190)


def packet(number: int, target: int = SYSID, v1: bool = False, **values: float) -> bytes:
    """The message of that id with zeros for all that is not given, addressed to `target` where it has an address."""
    kind, fields = oracle.mavlink_map[number], []
    for name, array in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
        zero = b"" if array == "char" else 0
        default = target if name == "target_system" else [0] * length if length and array != "char" else zero
        fields.append(values.get(name, default))
    return bytes(kind(*fields).pack(sender(), force_mavlink1=v1))


def command(number: int, target: int = SYSID, **values: float) -> bytes:
    """COMMAND_LONG of that command."""
    return packet(76, target, command=number, **values)


def bridge(*, armed: bool = False, **config: object) -> GuardCore:
    """A bridge of drone 1, whose autopilot has been heard."""
    core = GuardCore(GuardConfig(body="b", **config), 0)
    beat = Heartbeat(MavAutopilot.PX4, 2, 128 if armed else 0, 0, MavState.ACTIVE)
    core.receive_autopilot(Codec(Address(SYSID, 1)).frames(beat), 1)
    core.tick(1)
    return core


def passed(core: GuardCore, data: bytes) -> list[int]:
    """The ids of what reaches the autopilot of the bytes that a ground sent."""
    core.receive_ground(Datagram(SYSID, data), 2)
    cutter = FrameCutter()
    own = {0, 111}  # the bridge's own heartbeat and TIMESYNC
    return [
        frame.number
        for datagram in core.tick(2).to_autopilot
        for frame in cutter.cut(datagram.data)
        if frame.source.system == 255 or frame.number not in own
    ]


@pytest.mark.parametrize("armed", [False, True])
def test_no_message_of_the_dialect_passes_that_is_not_in_the_table(armed: bool) -> None:
    core, table = bridge(armed=armed, insecure=True), {row.number for row in ALLOWED}
    found = {number for number in oracle.mavlink_map for number in passed(core, packet(number))}
    assert found <= table
    assert len(oracle.mavlink_map) > 250
    assert {oracle.mavlink_map[n].msgname for n in oracle.mavlink_map} >= FOREIGN
    assert not FOREIGN & {oracle.mavlink_map[n].msgname for n in found}


def test_no_id_that_no_dialect_has_passes() -> None:
    for number in (*range(0x10000, 0x10100), 0xFFFFFF, 8_000, 50_000):
        if number in oracle.mavlink_map:
            continue
        head = struct.pack("<BBBBBBBHB", 0xFD, 1, 0, 0, 0, 255, 190, number & 0xFFFF, number >> 16)
        assert passed(bridge(insecure=True), head + b"\1\0\0") == []
        assert reject_reason(2, number, b"\1", SYSID, armed=False) == allow_list.UNLISTED


def test_the_table_passes() -> None:
    """Where it is addressed to the drone, and the motors are off."""
    for row in ALLOWED:
        values = {"command": 512} if row.name.startswith("COMMAND_") and row.name != "COMMAND_ACK" else {}
        (frame,) = FrameCutter().cut(packet(row.number, **values))
        assert reject_reason(2, row.number, frame.payload, SYSID, armed=False) == "", row.name
        assert reject_reason(2, row.number, frame.payload, SYSID, armed=True) == (
            allow_list.ARMED if row.when is MotorState.DISARMED else ""
        )
        assert reject_reason(1, row.number, frame.payload, SYSID, armed=False) == allow_list.VERSION_1


def test_names_and_addresses_are_the_dialects() -> None:
    for row in ALLOWED:
        kind = oracle.mavlink_map[row.number]
        assert kind.msgname == row.name
        if row.target_at is not None:
            (frame,) = FrameCutter().cut(packet(row.number, 77))
            assert frame.payload.ljust(255, b"\0")[row.target_at] == 77
    for row in ALLOWED_COMMANDS[:-1]:  # the last is of development.xml
        name = row.name.partition(",")[0]
        assert oracle.enums["MAV_CMD"][row.number].name == f"MAV_CMD_{name}"


def test_no_command_passes_that_is_not_in_the_table() -> None:
    table = {row.number for row in ALLOWED_COMMANDS}
    for kind in (75, 76):
        for number in (*oracle.enums["MAV_CMD"], 0, 65_535):
            (frame,) = FrameCutter().cut(packet(kind, command=number, param1=1.0))
            reason = reject_reason(2, kind, frame.payload, SYSID, armed=False)
            assert (reason == "") is (number in table)


@pytest.mark.parametrize(
    ("words", "data", "armed", "passes"),
    [
        ("disarm to every system", command(400, 0, param2=21196.0), True, False),
        ("disarm to another system", command(400, 2, param2=21196.0), True, False),
        ("disarm to this one", command(400, param2=21196.0), True, True),
        ("arm", command(400, param1=1.0), False, True),
        ("arm past the checks", command(400, param1=1.0, param2=2989.0), False, False),
        ("arm past the checks, rounded up", command(400, param1=0.9, param2=2989.0), False, False),
        ("reboot in flight", command(246, param1=1.0), True, False),
        ("reboot on the floor", command(246, param1=1.0), False, True),
        ("parameters", packet(23, param_id=b"MAV_SYS_ID", param_value=9.0), False, False),
        ("a shell", packet(126, device=10, count=4), False, False),
        ("files", packet(110), False, False),
        ("another signing key", packet(256), False, False),
        ("mode by the old message", packet(11, base_mode=1, custom_mode=393216), True, True),
        ("mode of every system", packet(11, 0, base_mode=1, custom_mode=393216), True, False),
        ("MAVLink 1", packet(76, v1=True, command=21), True, False),
        ("a new origin in flight", packet(48, latitude=1), True, False),
    ],
)
def test_each_case_of_the_attacks(words: str, data: bytes, armed: bool, passes: bool) -> None:
    assert bool(passed(bridge(armed=armed, insecure=True), data)) is passes, words


def test_what_is_rejected_is_counted_and_reported() -> None:
    core = bridge(insecure=True)
    core.receive_ground(Datagram(SYSID, packet(256)), 2)
    events = core.tick(2).events
    assert any(allow_list.UNLISTED in event.text for event in events)


def test_on_one_machine_without_keys_everything_passes_as_ever() -> None:
    core = bridge()
    assert passed(core, packet(23, param_id=b"A", param_value=1.0)) == [23]
