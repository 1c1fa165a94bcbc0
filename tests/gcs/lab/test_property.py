"""Whatever lab is accepted is flown inside its fence, apart and within its speed: references computed here anew.

The oracle is written from the README's table of trajectories, and knows nothing of the code it judges.
"""

from itertools import pairwise

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from formation.config import LabConfig
from gcs.finding import failed
from gcs.lab.judge import judge
from tests.formation.oracles import guidance

INSIDE_M = 2e-3  # between two looks of the judge, 0.05 s apart, a way may bulge by so much


def turned(t, rate, ramp_s, duration_s):
    return np.array([guidance.ramped(at, rate, ramp_s, duration_s)[0] for at in t])


def legs(t, points, times):
    """From rest to rest through points at their times."""
    at = np.repeat(np.array(points[0], float)[None], len(t), axis=0)
    for a, b, t0, t1 in zip(points, points[1:], times, times[1:], strict=False):
        at += guidance.STEP(np.clip((t - t0) / (t1 - t0), 0.0, 1.0))[:, None] * (
            np.array(b, float) - np.array(a, float)
        )
    return at


def references(config: LabConfig):
    """Times (k), leader (k, 3) and slots (k, n, 3) for a leader that starts where the file says."""
    path = config.leader.trajectory
    start = np.array([*config.leader.spawn_lab_m[:2], config.flight.altitude_m])
    laps = path.laps
    if path.kind == "circle":
        laps = laps or max(1, round(path.duration_s / path.period_s))
        ramp_s = min(3.0, path.period_s / 4.0)
        duration_s = laps * path.period_s + ramp_s
        t = np.linspace(0.0, duration_s, 201)
        angle = turned(t, 2.0 * np.pi / path.period_s, ramp_s, duration_s)
        at = np.column_stack([path.radius_m * np.cos(angle), path.radius_m * np.sin(angle), np.full(len(t), start[2])])
    else:
        if path.kind == "waypoints":
            points = [start, *(path.waypoints_m * (laps or 1))]
            far = [np.linalg.norm(np.subtract(b, a)) for a, b in pairwise(points)]
            times = np.concatenate([[0.0], np.cumsum([max(1.875 * d / path.speed_m_s, 0.5) for d in far])])
        elif path.kind == "line":
            end = start + np.array([path.length_m, 0.0, 0.0])
            points = [start, end] if laps is None else [start, *[end, start] * laps]
            times = path.duration_s * np.arange(len(points))
        else:
            points, times = [start, start], np.array([0.0, path.duration_s])
        duration_s = float(times[-1])
        t = np.linspace(0.0, duration_s, 201)
        at = legs(t, points, times)
    yaw = config.leader.spawn_yaw_rad + turned(t, path.yaw_rate_rad_s, min(2.0, duration_s / 2.0), duration_s)
    c, s = np.cos(yaw), np.sin(yaw)
    slots = np.stack(
        [
            at + np.column_stack([c * x - s * y, s * x + c * y, np.full(len(t), z)])
            for x, y, z in (f.offset_m for f in config.followers)
        ],
        axis=1,
    )
    return t, at, slots


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
    t, leader, slots = references(config)
    everybody = np.concatenate([leader[:, None], slots], axis=1)
    low, high = np.array(config.limits.fence.low_m), np.array(config.limits.fence.high_m)
    assert (everybody > low - INSIDE_M).all()
    assert (everybody < high + INSIDE_M).all()
    assert everybody[..., 2].min() > 0.0
    apart = np.linalg.norm(everybody[:, :, None] - everybody[:, None], axis=-1)
    apart[:, np.arange(apart.shape[1]), np.arange(apart.shape[1])] = np.inf
    assert apart.min() >= config.limits.min_separation_m - 1e-6
    speed = np.linalg.norm(np.diff(everybody, axis=0), axis=-1) / np.diff(t)[:, None]
    assert speed.max() <= config.limits.speed_m_s * 1.01
