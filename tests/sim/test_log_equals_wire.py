"""What the log says was commanded is what went over the wire, after every limit and correction."""

import numpy as np

from analysis.links import from_ground
from analysis.load import from_records
from drone_agent.simulation.inertial import InertialError
from formation import topics
from formation.messages import AttitudeTarget
from sim.faults.fault import Family, Fault
from sim.lockstep import metadata
from sim.proof.flight import fly
from sim.proof.labs import scenario
from sim.world import T0_NS
from tests.wire.messages import decode_packet
from wire.link_messages import Address, AttitudeSetpoint, MessageId
from wire.logs.mcap_read import Entry
from wire.mavlink.codec import Codec
from wire.schema import schema_of

LEANS = InertialError(bias_flu_m_s2=(0.2, -0.15, 0.0))
JUMP = Fault(family=Family.JUMP, body="f2", after_s=2.5, for_s=0.5, severity=0.5)
GROUND = Codec(Address(255, 190))
SETPOINTS = frozenset({MessageId.SET_ATTITUDE_TARGET})


def test_every_setpoint_to_leaning_autopilots_is_the_logged_target() -> None:
    flight = scenario("circle")
    vehicles = tuple(v.model_copy(update={"inertial_error": LEANS}) for v in flight.vehicles)
    flight = flight.model_copy(update={"vehicles": vehicles, "faults": (JUMP,)})
    entries: list[Entry] = []
    fly(flight, 5, lambda topic, message, t_ns: entries.append(Entry(topic, t_ns, message)))
    log = from_records(metadata(flight, 5, "memory", T0_NS), entries)
    schema = schema_of(AttitudeTarget)
    recorded = [entry.message for entry in entries if entry.topic is topics.TARGET]
    targets = {target.t_ns // 1_000_000: schema.decode(schema.encode(target)) for target in recorded}
    rows = {flight.lab.vehicles[i].sysid: row for row, i in enumerate(flight.lab.commanded)}
    setpoints = [(sysid, m) for _, sysid, m in from_ground(log, SETPOINTS) if isinstance(m, AttitudeSetpoint)]
    for sysid, sent in setpoints:
        logged, row = targets[sent.t_boot_ms], rows[sysid]
        assert not logged.held_off[row]
        again = as_sent(logged, row, sent)
        np.testing.assert_array_equal(sent.q_lab_from_flu, again.q_lab_from_flu)
        np.testing.assert_array_equal(sent.rate_flu_rad_s, again.rate_flu_rad_s)
        assert sent.thrust_norm == again.thrust_norm
    assert len(setpoints) > 1000
    assert sum(int(target.held_off.sum()) for target in recorded) > 10


def as_sent(logged: AttitudeTarget, row: int, sent: AttitudeSetpoint) -> AttitudeSetpoint:
    """The logged target of one drone after the rounding of SET_ATTITUDE_TARGET's float32 fields."""
    q, rate, thrust = logged.q_lab_from_flu[row], logged.rate_flu_rad_s[row], float(logged.thrust_norm[row])
    data = GROUND.encode(AttitudeSetpoint(sent.target, sent.t_boot_ms, q, rate, thrust, sent.ignore))
    message = decode_packet(data).message
    assert isinstance(message, AttitudeSetpoint)
    return message
