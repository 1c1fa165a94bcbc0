"""A lab judged as a whole: everything that its file alone decides, before anything is started. Pure."""

from collections.abc import Iterator
from dataclasses import replace

from formation.config import LabConfig
from formation.guidance.preview import Preview, expected_start, preview, trajectory_from
from formation.guidance.shape import configured
from gcs.finding import Finding
from gcs.lab.exposed import judge_exposure
from gcs.lab.feasibility import judge_feasibility
from gcs.lab.flight_volume import judge_flight_volume
from gcs.lab.keys import Keys
from gcs.lab.separation import judge_separation
from gcs.lab.wiring import judge_trajectory_keys, judge_wiring


def foreseen(config: LabConfig) -> Preview:
    """The formation phase as the file has it: the configured shape, the leader where it is expected to start."""
    start = expected_start(config)
    return preview(trajectory_from(config, start), configured(config), start)


def judge(config: LabConfig) -> tuple[Finding, ...]:
    """Every refusal and every warning; the subject of each is a key of the file, `found` its value.

    A single field's own faults have been refused when the file was read (formation.config).
    """
    keys, ahead = Keys(config), foreseen(config)
    return (
        *judge_flight_volume(config, keys, ahead),
        *judge_separation(config, keys),
        *judge_feasibility(config, keys, ahead),
        *judge_wiring(config, keys),
        *judge_exposure(config, keys),
        *_choices(config),
    )


def _choices(config: LabConfig) -> Iterator[Finding]:
    """The further trajectories that the operator may choose, each judged in the place of the configured one."""
    for name in config.leader.trajectories if config.leader.sysid is not None else ():
        lab = config.flying(name)
        keys, ahead = Keys(lab), foreseen(lab)
        for finding in (
            *judge_flight_volume(lab, keys, ahead),
            *judge_feasibility(lab, keys, ahead),
            *judge_trajectory_keys(lab, keys),
        ):
            table, _, key = finding.subject.partition("leader.trajectory.")
            if key and not table:
                yield replace(finding, subject=f"leader.trajectories.{name}.{key}")
