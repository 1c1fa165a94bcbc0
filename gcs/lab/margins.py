"""Whether the lag of each vehicle can carry the lab's gains: `gcs check` and `gcs run` ask here."""

import sys

from formation.config import LabConfig, MocapConfig
from formation.vehicle.profile import PROFILES, VehicleProfile
from gcs.finding import Finding, Grade


def judge_margins(config: LabConfig) -> list[Finding]:
    """A failure for each kind of commanded vehicle that would not fly steadily; takes seconds for one not shipped."""
    kinds = {config.vehicles[i].profile: config.profile_of(config.vehicles[i]) for i in config.commanded}
    unknown = [kind for kind in kinds.values() if not _is_known(config, kind)]
    found: list[Finding] = []
    if unknown:
        from wire.process.progress import compile_all  # loads the control, which a check of usual vehicles does without

        compile_all("gcs", lambda: found.extend(each for kind in unknown for each in _judge(config, kind)), sys.stderr)
    return found


def _judge(config: LabConfig, kind: VehicleProfile) -> list[Finding]:
    from formation.control.margin import delay_margin, is_carried
    from formation.control.presets import preset_for

    gains = preset_for(config.control_preset, kind, config.mocap)
    if is_carried(kind, gains, config.mocap):
        return []
    key, value = "control_preset", f'"{config.control_preset}"'
    for k, own in enumerate(config.profiles):
        if own.name == kind.name:
            key, value = f"profiles[{k}].response_lag_s", f"{kind.response_lag_s:g}"
    wanted = "a shorter response_dead_time_s, response_lag_s or mocap.delay_s, or slower gains"
    why = f"would not fly steadily: {delay_margin(kind, gains, config.mocap)}"
    return [Finding(key, "delay", Grade.FAIL, value, wanted, why)]


def _is_known(config: LabConfig, kind: VehicleProfile) -> bool:
    """Whether it is a shipped vehicle with the gains and cameras that all of those are tested to carry."""
    usual = MocapConfig()
    is_usual = config.mocap.delay_s <= usual.delay_s and config.mocap.rate_hz >= usual.rate_hz
    return is_usual and config.control_preset == "default" and PROFILES.get(kind.name) == kind
