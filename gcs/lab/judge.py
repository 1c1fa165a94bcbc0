"""A lab judged as a whole: everything that its file alone decides, before anything is started. Pure."""

from formation.config import LabConfig
from formation.guidance.preview import Preview, expected_start, preview, trajectory_from
from formation.guidance.shape import configured
from gcs.finding import Finding
from gcs.lab.apart import judge_apart
from gcs.lab.keys import Keys
from gcs.lab.pace import judge_pace
from gcs.lab.room import judge_room
from gcs.lab.wiring import judge_wiring


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
        *judge_room(config, keys, ahead),
        *judge_apart(config, keys),
        *judge_pace(config, keys, ahead),
        *judge_wiring(config, keys),
    )
