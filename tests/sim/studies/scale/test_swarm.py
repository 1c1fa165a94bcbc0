"""What a swarm's hover tells: whether it landed, and how near its drones came."""

import json
from dataclasses import replace

from sim.studies.scale.swarm import swarm


def test_four_drones_hover_land_and_stay_as_far_apart_as_their_slots() -> None:
    result = swarm(3, 2.0, lambda _text: None)
    assert (result.drones, result.outcome, result.is_good) == (4, "landed", True)
    assert 0.55 < result.separation_m < 0.85  # they stand 0.6 m or more from each other
    assert 0.0 < result.tick.least_us <= result.tick.p50_us <= result.tick.p99_us
    assert json.loads(result.to_json())["tick"]["count"] == result.tick.count > 500
    assert not replace(result, separation_m=0.19).is_good
    assert not replace(result, outcome="aborted").is_good
