"""Why a drone's link and parameters do not allow arming; the rules are the autopilot model's."""

from collections.abc import Iterator

from formation.reasons import Reason, Reject
from gcs.drones.autopilot_model import HOVER_WITHIN, ParameterRule
from gcs.drones.link_state import DroneLink


def prearm_failures(link: DroneLink) -> Iterator[Reject]:
    """Every reason of this link's own not to arm."""
    if link.foreign_sysid is not None:
        yield Reason.FOREIGN_DRONE.of(link.name, link.foreign_sysid, link.sysid)
    if link.telemetry.heartbeat is None:
        return  # a missing heartbeat is safety's own refusal
    if link.model is None:
        yield Reason.UNKNOWN_AUTOPILOT.of(link.name, link.telemetry.heartbeat.autopilot.name)
        return
    unready = link.model.unready(link.telemetry)
    if unready:
        yield Reason.AUTOPILOT_UNREADY.of(link.name, unready)
    for name in link.awaiting_restart:
        yield Reason.AWAITS_RESTART.of(link.name, name, restart_text(link))
    for rule in link.model.rules:
        if rule.rejects(link.parameters.values.get(rule.name)):
            yield Reason.WRONG_PARAMETER.of(link.name, _complaint(link, rule))


def warnings(link: DroneLink, feeds_pose: bool) -> tuple[tuple[str, str], ...]:
    """What is not as wanted but does not keep the drone on the ground: parameters that were read, and what is wrong."""
    if link.model is None:
        return ()
    known, applying = link.parameters.values, (r for r in link.model.rules if feeds_pose or not r.external_pose)
    wrong = [r for r in applying if r.name in known and not r.holds(known[r.name]) and not r.rejects(known[r.name])]
    return tuple((rule.name, _complaint(link, rule)) for rule in wrong) + _hover_warning(link)


def _hover_warning(link: DroneLink) -> tuple[tuple[str, str], ...]:
    used, expected = link.hover_thrust_norm, link.profile.hover_thrust_norm
    if link.model is None or abs(used - expected) <= HOVER_WITHIN * expected:
        return ()
    name = link.model.table.hover_parameter
    return ((name, f"{name} is {used:.2f}, the profile {link.profile.name} hovers at {expected:.2f}"),)


def restart_text(link: DroneLink) -> str:
    """Why a parameter that was set right keeps its drone on the ground, and what to do."""
    return (
        f"was changed and counts from a restart, which was not seen: restart the autopilot of drone {link.sysid} (off "
        "for 3 s) while gcs run or gcs doctor runs; or, where it was, delete ...-restarts.toml beside the lab file"
    )


def _complaint(link: DroneLink, rule: ParameterRule) -> str:
    found = link.parameters.values.get(rule.name)
    if found is not None:
        return f"{rule.name} is {found:g}, wanted {rule.wanted}: {rule.why}"
    return f"{rule.name} is being read" if link.parameters.reading else f"{rule.name} could not be read: {rule.why}"
