"""Checks of a drone's link, clock, parameters and signing key before a flight. Pure."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from formation.vehicle.profile import VehicleProfile
from gcs.drones.autopilot_model import HOVER_WITHIN, GroundModel, ParameterRule
from gcs.finding import Finding, Fix, Grade, Refit, graded, unmeasured
from gcs.security.signing_probe import ProbeOutcome
from wire.config_file import dump_profile
from wire.link_messages import MavAutopilot

PACKETS_LEAST = 50  # below it one lost packet would be two per cent, and a twin might not have spoken
LOSS, LOSS_MOST = 0.01, 0.05
ROUND_TRIP_S = 0.02
HOVER_MOST = 0.25
ALWAYS_UNSIGNED = {
    MavAutopilot.PX4: "HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION",
    MavAutopilot.ARDUPILOT: "RADIO_STATUS, RADIO; everything on its first serial port (USB)",
}
"""What firmwares accept unsigned, whatever their key: PX4's mavlink_sign_control.cpp, ArduPilot's GCS_Signing.cpp."""
SIGNATURE, UNSIGNED_REJECTED = "signature", "unsigned refused"


@dataclass(frozen=True, slots=True)
class DroneReport:
    """What was learned of one drone; None or NaN where nothing was. `parameters` holds only what it answered.

    packets: how many came from it. unhealthy: what the autopilot reports as missing; None where it reported
    nothing. awaiting_restart: parameters that are right by now and were not when it booted, each with why.
    """

    name: str
    sysid: int
    profile: VehicleProfile
    model: GroundModel | None
    version: str
    parameters: Mapping[str, float]
    unhealthy: tuple[str, ...] | None
    packets: int
    loss: float
    round_trip_s: float
    clock_offset_s: float | None
    duplicate: bool
    foreign_sysid: int | None
    battery: float
    awaiting_restart: tuple[tuple[str, str], ...] = ()


def check_drone(report: DroneReport, feeds_pose: bool) -> tuple[Finding, ...]:
    """Judge one drone; feeds_pose: whether this ground sends it its pose."""
    return tuple(_check(report, feeds_pose))


def _check(report: DroneReport, feeds_pose: bool) -> Iterator[Finding]:
    name = report.name
    if report.foreign_sysid is not None:
        found = f"drone {report.foreign_sysid} answers"
        yield Finding(name, "sysid", Grade.FAIL, found, str(report.sysid), "wrong link, or wrong sysid")
    yield _check_own(report)
    if report.model is None:
        yield Finding(name, "heartbeat", Grade.FAIL, "none", "PX4 or ArduPilot", "off, or not on this link")
        return
    yield Finding(name, "autopilot", Grade.PASS, f"{report.model.name} {report.version or '(version not reported)'}")
    yield from _check_link(report)
    for rule in report.model.rules:
        if feeds_pose or not rule.external_pose:
            yield _check_rule(report, rule)
    for parameter, why in report.awaiting_restart:
        yield Finding(name, f"restart for {parameter}", Grade.FAIL, "not restarted", "restarted", f"it {why}")
    yield _check_hover(report, report.model)
    yield from _check_health(report)
    if math.isnan(report.battery):
        yield unmeasured(
            name, "battery", "over 50%", "it reports no charge: the ground cannot land it before the battery is empty"
        )
    else:
        yield graded(name, "battery", f"{report.battery:.0%}", "over 50%", report.battery > 0.5, "charge it", True)


def _check_own(report: DroneReport) -> Finding:
    """Whether only one drone uses the sysid; unmeasured below PACKETS_LEAST packets."""
    check, wanted = "sysid is its own", "one drone"
    if report.duplicate:
        why = "two drones have this sysid: change one (PX4 MAV_SYS_ID, ArduPilot SYSID_THISMAV)"
        return Finding(report.name, check, Grade.FAIL, "two drones", wanted, why)
    if not report.packets:
        return unmeasured(report.name, check, wanted, "nothing was heard of it", Grade.FAIL)
    if report.packets < PACKETS_LEAST:
        return unmeasured(report.name, check, wanted, f"only {report.packets} packets came from it")
    return Finding(report.name, check, Grade.PASS, wanted, wanted)


def _check_health(report: DroneReport) -> Iterator[Finding]:
    check, wanted = "own health", "ready"
    if report.unhealthy is None:
        yield unmeasured(report.name, check, wanted, "MAVSDK did not hear it say")
    elif not report.unhealthy:
        yield Finding(report.name, check, Grade.PASS, wanted, wanted)
    for lack in report.unhealthy or ():
        yield Finding(report.name, check, Grade.WARN, lack, wanted, "it would refuse to arm")


def _check_link(report: DroneReport) -> Iterator[Finding]:
    name, found = report.name, f"{report.loss:.1%} lost"
    if report.packets < PACKETS_LEAST:
        yield unmeasured(name, "link", "under 1% lost", f"only {report.packets} packets came from it")
    else:
        well, fair = report.loss <= LOSS, report.loss <= LOSS_MOST
        yield graded(name, "link", found, "under 1%", well, "radio, or a busy machine", fair)
    if math.isnan(report.round_trip_s) or report.clock_offset_s is None:
        yield Finding(name, "clock", Grade.WARN, "no TIMESYNC", "answered", "ages of setpoints stay unknown")
        return
    found = f"{report.round_trip_s * 1e3:.1f} ms round trip, offset {report.clock_offset_s:+.3f} s"
    yield graded(name, "clock", found, "under 20 ms", report.round_trip_s <= ROUND_TRIP_S, "a slow link", fair=True)


def _check_rule(report: DroneReport, rule: ParameterRule) -> Finding:
    value = report.parameters.get(rule.name)
    grade = Grade.FAIL if rule.rejects(value) or rule.external_pose else Grade.WARN
    if value is None:
        return Finding(report.name, rule.name, grade, "not answered", rule.wanted, rule.why)
    if rule.holds(value):
        return Finding(report.name, rule.name, Grade.PASS, f"{value:g}", rule.wanted)
    fix = Fix(report.sysid, rule.name, rule.set_to)
    return Finding(report.name, rule.name, grade, f"{value:g}", rule.wanted, rule.why, fix)


def _check_hover(report: DroneReport, model: GroundModel) -> Finding:
    """The autopilot's own hover thrust against the profile's: both are believed by somebody in flight.

    It is never written: an autopilot learns it by flying, and what has been flown knows better than a profile.
    """
    name, wanted = model.table.hover_parameter, report.profile.hover_thrust_norm
    value = report.parameters.get(name)
    expected = f"{wanted:.2f} ({report.profile.name})"
    if value is None:
        return Finding(report.name, name, Grade.WARN, "not answered", expected, "the profile's is used")
    off = abs(value - wanted) / wanted
    found = f"{value:.2f}"
    if off <= HOVER_WITHIN:
        return Finding(report.name, name, Grade.PASS, found, expected)
    if not model.hover_measured(value):
        why = f"{model.name}'s default, never measured: the profile's is used, and the autopilot's own flying is off"
        return Finding(report.name, name, Grade.WARN, found, expected, why)
    grade = Grade.WARN if off <= HOVER_MOST else Grade.FAIL
    refit = refitted(report.profile, value, report.sysid)
    why = (
        "the autopilot's own is flown, so the profile is wrong for this drone: change the profile (--fix offers one), "
        "or measure its mass and identify a flight"
    )
    return Finding(report.name, name, grade, found, expected, why, refit=refit)


def refitted(profile: VehicleProfile, hover_norm: float, sysid: int) -> Refit:
    """The profile with the thrust that makes it hover at `hover_norm`; its mass, its curve and all else stay."""
    share = (1.0 - profile.thrust_curve) * hover_norm + profile.thrust_curve * hover_norm**2
    name = f"{profile.name}_{sysid}"
    fitting = profile.model_copy(update={"name": name, "thrust_max_n": float(f"{profile.weight_n / share:.4g}")})
    return Refit(sysid, name, dump_profile(fitting))


def check_signing(name: str, outcome: ProbeOutcome, *, is_bridged: bool) -> Iterator[Finding]:
    """Judge one drone by what it answered; is_bridged: a bridge stands between the network and its autopilot."""
    if outcome.unsigned_answers:
        why = (
            "it has the key and obeys unsigned commands on this link: move the link to another port of the autopilot"
            if outcome.has_key
            else "whoever reaches this network commands it: `gcs keys install FILE --serial DEV:BAUD` gives it the key"
        )
        yield Finding(name, SIGNATURE, Grade.FAIL, "unsigned obeyed", UNSIGNED_REJECTED, why)
    elif outcome.demands_signatures:
        yield Finding(name, SIGNATURE, Grade.PASS, UNSIGNED_REJECTED, UNSIGNED_REJECTED)
    else:
        why = (
            "it answers signed commands neither: it is off, or has another key"
            if outcome.received
            else "nothing came from it"
        )
        yield unmeasured(name, SIGNATURE, UNSIGNED_REJECTED, why, Grade.FAIL)
    always = None if is_bridged or outcome.autopilot is None else ALWAYS_UNSIGNED.get(outcome.autopilot)
    if always is not None:
        why = "its firmware accepts these unsigned, whatever its key: only a bridge (`drone-agent --bridge`) ends them"
        yield Finding(name, "always accepted unsigned", Grade.WARN, always, "nothing", why)
