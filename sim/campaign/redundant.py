"""Monitors without a control of their own: others are expected to contain what each one does, or it only warns.

No fault was found that does harm for want of one of them alone. Flown and contained without it: validator-flip,
validator-yaw-rate, keep-out, speed-limit, rule-lost. Flown, and as bad with it once all behind it are off:
rule-tilted-agreed, rule-too-close. Without setpoint-hold-off, 4
of 25 flights with noise, or a leap within bounds, did harm:
it is needed, and no fault is known that needs it in 95 % of flights. The others go by the order of limits and times
alone.
"""

from collections.abc import Mapping
from types import MappingProxyType

_WARNS = "only warns"
REDUNDANT: Mapping[str, str] = MappingProxyType(
    {
        "validator-flip": "two independent estimates must agree before motors are cut; autopilots fly by their own",
        "validator-yaw-rate": "slots are followed at limits.speed_m_s at most; autopilots know their own heading",
        "validator-stamp": "no frame leaves the mocap process stamped after its receipt; rules on age for late stamps",
        "setpoint-hold-off": "by luck of what the noise was: rule-lost lets go of it after 0.4 s",
        "stream-stale": "the autopilot's own time-out 0.1 s later (COM_OF_LOSS_T, GUID_TIMEOUT 0.2 s)",
        "keep-out": "the separation filter keeps clear of the last place; unseen, a drone levels and comes down there",
        "speed-limit": "references are slow; pose validator, separation filter and fence limit fast ones",
        "rule-unseen": "rule-lost 0.2 s later",
        "rule-lost": "the drone's own level flight and descent without a pose, and the keep-out about it",
        "rule-long-lost": "rule-lost of a drone; of an observed leader, rule-unseen holds until the battery's rule",
        "rule-outside-fence": "the fence that brakes demands, rule-far-outside",
        "rule-far-outside": "rule-outside-fence, rule-far-outside-agreed",
        "rule-far-outside-agreed": "rule-far-outside lets go of it half a metre outside all the same",
        "rule-too-close": "separation filter, rule-half-separation",
        "rule-half-separation": "separation filter, rule-too-close",
        "rule-position-error": "fence and its rules, rule-attitude-innovation",
        "rule-leader-position-error": "rule-not-offboard; followers come down no faster than their leader",
        "rule-tilted": "motor-failure in the drone, rule-tilted-agreed",
        "rule-tilted-agreed": "motor-failure in the drone, rule-tilted",
        "rule-silent": "a drone that hears nothing holds and lands by itself; one that says nothing is led as before",
        "rule-link-behind": _WARNS,
        "rule-link-behind-hold": "poses so old are unseen where autopilots are their own mocap; else the release",
        "rule-link-behind-release": "rule-lost where autopilots are their own mocap; else a late estimate cuts nothing",
        "rule-disarmed": "a drone that is disarmed has come down already, and the others keep clear of it",
        "rule-setpoints-late": _WARNS,
        "rule-setpoints-late-landing": "stale-setpoint in the drone, the bound on its rate of descent",
        "rule-setpoints-stale": "stale-setpoint in the drone",
        "rule-battery-low": _WARNS,
        "rule-battery-empty": "the autopilot's own landing, then rule-not-offboard",
        "rule-model-mismatch": _WARNS,
        "rule-frames-late": _WARNS,
        "rule-frames-lost": "rule-unseen and rule-lost, stream-stale in the drone",
        "rule-duplicate-sysid": _WARNS,
    }
)
"""By monitor, who stands behind it."""
