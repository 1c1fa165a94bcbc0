"""Any lab that the judge accepts, looked at five times as finely as the judge does, and bodies one by one."""

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from formation.config import LabConfig
from formation.guidance.preview import expected_start, preview, trajectory_from
from formation.guidance.shape import configured
from gcs.finding import failed
from gcs.lab.judge import judge

INSIDE_M = 2e-3  # between two looks of the judge, 0.05 s apart, a way may bulge by so much


def metres(low: float, high: float):
    return st.floats(low, high).map(lambda x: round(x, 2))


points = st.tuples(metres(-2.0, 2.0), metres(-1.5, 1.5), metres(0.3, 2.0))
trajectories = st.fixed_dictionaries(
    {"kind": st.sampled_from(["hold", "line", "circle", "waypoints"])},
    optional={
        "length_m": metres(0.1, 4.0),
        "duration_s": metres(1.0, 20.0),
        "radius_m": metres(0.1, 2.0),
        "period_s": metres(1.0, 20.0),
        "speed_m_s": metres(0.1, 3.0),
        "yaw_rate_rad_s": metres(-1.5, 1.5),
        "laps": st.integers(1, 4),
    },
)
labs = st.fixed_dictionaries(
    {
        "trajectory": trajectories,
        "waypoints": st.lists(points, min_size=1, max_size=3),
        "spawn": st.tuples(metres(-1.5, 1.5), metres(-1.0, 1.0), st.just(0.0)),
        "yaw": metres(-3.0, 3.0),
        "offsets": st.lists(st.tuples(metres(-1.2, 1.2), metres(-1.2, 1.2), metres(-0.3, 0.5)), min_size=1, max_size=3),
        "altitude": metres(0.3, 2.2),
    }
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(labs)
def test_an_accepted_lab_stays_inside_apart_and_slow_enough(drawn) -> None:
    config = LabConfig.model_validate(
        {
            "leader": {
                "body": "lead", "sysid": 1, "spawn_lab_m": drawn["spawn"], "spawn_yaw_rad": drawn["yaw"],
                "trajectory": {**drawn["trajectory"], "waypoints_m": drawn["waypoints"]},
            },
            "followers": [
                {"body": f"f{k}", "sysid": 2 + k, "offset_m": offset} for k, offset in enumerate(drawn["offsets"])
            ],
            "flight": {"altitude_m": drawn["altitude"]},
        }
    )  # fmt: skip
    assume(not failed(judge(config)))
    start = expected_start(config)
    coarse = preview(trajectory_from(config, start), configured(config), start)
    ahead = preview(trajectory_from(config, start), configured(config), start, samples=5 * len(coarse.t_s))
    everybody = np.concatenate([ahead.leader[:, None, 0, :3], ahead.slots[:, :, 0]], axis=1)
    low, high = np.array(config.limits.fence.low_m), np.array(config.limits.fence.high_m)
    assert (everybody > low - INSIDE_M).all()
    assert (everybody < high + INSIDE_M).all()
    assert everybody[..., 2].min() > 0.0
    apart = np.linalg.norm(everybody[:, :, None] - everybody[:, None], axis=-1)
    apart[:, np.arange(apart.shape[1]), np.arange(apart.shape[1])] = np.inf
    assert apart.min() >= config.limits.min_separation_m - 1e-6
    speed = np.linalg.norm(np.diff(everybody, axis=0), axis=-1) / np.diff(ahead.t_s)[:, None]
    assert speed.max() <= config.limits.speed_m_s * 1.01
