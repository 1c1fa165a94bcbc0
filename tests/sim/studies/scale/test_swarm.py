"""What a swarm's hover tells: whether it landed, and how near its drones came."""

import json
from dataclasses import replace

from sim.studies.scale.swarm import Swarm, swarm


def test_four_drones_hover_land_and_stay_as_far_apart_as_their_slots() -> None:
    result = swarm(3, 2.0, lambda _text: None)
    assert (result.drones, result.outcome, result.is_good) == (4, "landed", True)
    assert result.separation_m is not None
    assert result.tick is not None
    assert "4 drones" in result.text
    assert 0.55 < result.separation_m < 0.85  # they stand 0.6 m or more from each other
    assert 0.0 < result.tick.least_us <= result.tick.p50_us <= result.tick.p99_us
    assert json.loads(result.to_json())["tick"]["count"] == result.tick.count > 500
    assert not replace(result, separation_m=0.19).is_good
    assert not replace(result, outcome="aborted").is_good


def test_who_never_took_off_has_no_figures() -> None:
    result = Swarm(2, "aborted", 1.0, None, 0.2, None, 5.0)
    assert not result.is_good
    assert "tick" not in result.text
    assert json.loads(result.to_json())["separation_m"] is None
