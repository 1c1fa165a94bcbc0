"""Whether a drone that has a signing key demands signatures on the network. Pure."""

from collections.abc import Iterator

from gcs.finding import Finding, Grade, unmeasured
from gcs.security.signing_probe import ProbeOutcome
from wire.link_messages import MavAutopilot

ALWAYS_UNSIGNED = {
    MavAutopilot.PX4: "HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION",
    MavAutopilot.ARDUPILOT: "RADIO_STATUS, RADIO; everything on its first serial port (USB)",
}
"""What firmwares accept unsigned, whatever their key: PX4's mavlink_sign_control.cpp, ArduPilot's GCS_Signing.cpp."""
_CHECK, _WANTED = "signature", "unsigned refused"


def check_signing(name: str, outcome: ProbeOutcome, *, is_bridged: bool) -> tuple[Finding, ...]:
    """Judge one drone by what it answered; is_bridged: a bridge stands between the network and its autopilot."""
    return tuple(_check(name, outcome, is_bridged))


def _check(name: str, outcome: ProbeOutcome, is_bridged: bool) -> Iterator[Finding]:
    if outcome.unsigned_answers:
        why = (
            "it has the key and obeys unsigned commands on this link: move the link to another port of the autopilot"
            if outcome.has_key
            else "whoever reaches this network commands it: `gcs keys install FILE --serial DEV:BAUD` gives it the key"
        )
        yield Finding(name, _CHECK, Grade.FAIL, "unsigned obeyed", _WANTED, why)
    elif outcome.demands_signatures:
        yield Finding(name, _CHECK, Grade.PASS, _WANTED, _WANTED)
    else:
        why = (
            "it answers signed commands neither: it is off, or has another key"
            if outcome.received
            else "nothing came from it"
        )
        yield unmeasured(name, _CHECK, _WANTED, why, Grade.FAIL)
    always = None if is_bridged or outcome.autopilot is None else ALWAYS_UNSIGNED.get(outcome.autopilot)
    if always is not None:
        why = "its firmware accepts these unsigned, whatever its key: only a bridge (`drone-agent --bridge`) ends them"
        yield Finding(name, "always accepted unsigned", Grade.WARN, always, "nothing", why)
