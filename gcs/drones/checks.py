"""Why a drone's link and parameters do not allow arming, as texts; the rules are the autopilot model's."""

from collections.abc import Iterator

from gcs.drones.autopilot_model import HOVER_WITHIN, ParameterRule
from gcs.drones.link_state import DroneLink


def prearm_failures(link: DroneLink) -> tuple[str, ...]:
    """Every reason of this link's own not to arm; empty when there is none."""
    return tuple(f"{link.name}: {reason}" for reason in _prearm_failures(link))


def _prearm_failures(link: DroneLink) -> Iterator[str]:
    if link.foreign_sysid is not None:
        yield f"drone {link.foreign_sysid} answers on the link of drone {link.sysid}"
    if link.telemetry.heartbeat is None:
        return  # a missing heartbeat is safety's own refusal
    if link.model is None:
        yield f"autopilot {link.telemetry.heartbeat.autopilot.name} is neither PX4 nor ArduPilot"
        return
    unready = link.model.unready(link.telemetry)
    if unready:
        yield unready
    for name in link.awaiting_restart:
        yield f"{name} {restart_text(link)}"
    for rule in link.model.rules:
        if rule.rejects(link.parameters.values.get(rule.name)):
            yield _complaint(link, rule)


def warnings(link: DroneLink, feeds_pose: bool) -> tuple[str, ...]:
    """What is not as wanted but does not keep the drone on the ground; only of parameters that were read."""
    if link.model is None:
        return ()
    known, applying = link.parameters.values, (r for r in link.model.rules if feeds_pose or not r.external_pose)
    wrong = [r for r in applying if r.name in known and not r.holds(known[r.name]) and not r.rejects(known[r.name])]
    return tuple(_complaint(link, rule) for rule in wrong) + _hover_warning(link)


def _hover_warning(link: DroneLink) -> tuple[str, ...]:
    used, expected = link.hover_thrust_norm, link.profile.hover_thrust_norm
    if link.model is None or abs(used - expected) <= HOVER_WITHIN * expected:
        return ()
    return (
        f"{link.model.table.hover_parameter} is {used:.2f}, the profile {link.profile.name} hovers at {expected:.2f}",
    )


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
