"""What a drone's link, its clock and its parameters tell before a flight. Pure."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from formation.vehicle import VehicleProfile
from gcs.dialect import Dialect, ParameterRule
from gcs.doctor.finding import Finding, Fix, Grade, graded

LOSS, LOSS_MOST = 0.01, 0.05
ROUND_TRIP_S = 0.02
HOVER_FAIR, HOVER_MOST = 0.1, 0.25


@dataclass(frozen=True, slots=True)
class DroneReport:
    """What was learned of one drone; None or NaN where nothing was. `parameters` holds only what it answered.

    unhealthy: what the autopilot itself says it lacks, in words.
    """

    name: str
    sysid: int
    profile: VehicleProfile
    dialect: Dialect | None
    version: str
    parameters: Mapping[str, float]
    unhealthy: tuple[str, ...]
    loss: float
    round_trip_s: float
    clock_offset_s: float | None
    duplicate: bool
    foreign_sysid: int | None
    battery: float


def check_drone(report: DroneReport, feeds_pose: bool) -> tuple[Finding, ...]:
    """Judge one drone; feeds_pose: whether this ground sends it its pose."""
    return tuple(_check(report, feeds_pose))


def _check(report: DroneReport, feeds_pose: bool) -> Iterator[Finding]:
    name = report.name
    if report.foreign_sysid is not None:
        found = f"drone {report.foreign_sysid} answers"
        yield Finding(name, "sysid", Grade.FAIL, found, str(report.sysid), "wrong link, or wrong sysid")
    twice = "two drones" if report.duplicate else "one drone"
    why = "two drones have this sysid: change one (PX4 MAV_SYS_ID, ArduPilot SYSID_THISMAV)"
    yield graded(name, "sysid is its own", twice, "one drone", not report.duplicate, why)
    if report.dialect is None:
        yield Finding(name, "heartbeat", Grade.FAIL, "none", "PX4 or ArduPilot", "off, or not on this link")
        return
    yield Finding(name, "autopilot", Grade.PASS, f"{report.dialect.name} {report.version}".strip())
    yield from _check_link(report)
    for rule in report.dialect.rules:
        if feeds_pose or not rule.external_pose:
            yield _check_rule(report, rule)
    yield _check_hover(report, report.dialect)
    for lack in report.unhealthy:
        yield Finding(name, "own health", Grade.WARN, lack, "ready", "it would refuse to arm")
    if not math.isnan(report.battery):
        yield graded(name, "battery", f"{report.battery:.0%}", "over 50%", report.battery > 0.5, "charge it", True)


def _check_link(report: DroneReport) -> Iterator[Finding]:
    name = report.name
    found = f"{report.loss:.1%} lost"
    yield graded(
        name, "link", found, "under 1%", report.loss <= LOSS, "radio, or a busy machine", report.loss <= LOSS_MOST
    )
    if math.isnan(report.round_trip_s) or report.clock_offset_s is None:
        yield Finding(name, "clock", Grade.WARN, "no TIMESYNC", "answered", "ages of setpoints stay unknown")
        return
    found = f"{report.round_trip_s * 1e3:.1f} ms round trip, offset {report.clock_offset_s:+.3f} s"
    yield graded(name, "clock", found, "under 20 ms", report.round_trip_s <= ROUND_TRIP_S, "a slow link", fair=True)


def _check_rule(report: DroneReport, rule: ParameterRule) -> Finding:
    value = report.parameters.get(rule.name)
    grade = Grade.FAIL if rule.vital or rule.external_pose else Grade.WARN
    if value is None:
        return Finding(report.name, rule.name, grade, "not answered", rule.wanted, rule.why)
    if rule.holds(value):
        return Finding(report.name, rule.name, Grade.PASS, f"{value:g}", rule.wanted)
    fix = Fix(report.sysid, rule.name, rule.set_to)
    return Finding(report.name, rule.name, grade, f"{value:g}", rule.wanted, rule.why, fix)


def _check_hover(report: DroneReport, dialect: Dialect) -> Finding:
    """The autopilot's own hover thrust against the profile's: both are believed by somebody in flight."""
    name, wanted = dialect.hover_parameter, report.profile.hover_thrust_norm
    value = report.parameters.get(name)
    expected = f"{wanted:.2f} ({report.profile.name})"
    if value is None:
        return Finding(report.name, name, Grade.WARN, "not answered", expected, "the profile's is used")
    off = abs(value - wanted) / wanted
    grade = Grade.PASS if off <= HOVER_FAIR else Grade.WARN if off <= HOVER_MOST else Grade.FAIL
    why = "" if grade is Grade.PASS else "wrong hover thrust: it would sink or jump; weigh it, or identify a flight"
    fix = None if grade is Grade.PASS else Fix(report.sysid, name, round(wanted, 3))
    return Finding(report.name, name, grade, f"{value:.2f}", expected, why, fix)
