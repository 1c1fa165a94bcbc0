"""Known errors in, known numbers out."""

import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.load import Flight, from_records
from analysis.metrics import Latency, Summary, parse_requirement, summarise, unmet
from analysis.plots.motion import leader_error
from analysis.plots.style import Missing
from analysis.tracking import track_leader
from formation.messages import Phase, Verb
from tests.analysis.synthetic_flight import END_S, LAB, METADATA, PHASES, Recipe, records

KEYS = [
    "scenario", "seed", "link", "duration_s", "followers", "formation_rms_m", "formation_max_m", "leader_rms_m",
    "leader_max_m", "vibration_m", "altitude_rms_m", "min_separation_m", "frames", "late_ticks", "law_failures",
    "mocap_ms", "latency_ms", "age_ms", "link_behind_ms", "realtime_factor", "command_hash", "mcap", "report",
    "outcome",
]  # fmt: skip


def fly(**recipe: object) -> Flight:
    return from_records(METADATA, records(Recipe(**recipe)))


def constant(x: float, y: float, z: float):
    return lambda t_s: np.array([[x, y, z], [x, y, z]])


def test_a_constant_error_in_the_frame_of_a_yawing_leader_is_its_length():
    summary = summarise(fly(error_lead=constant(0.003, -0.004, 0.012), leader_yaw_rate_rad_s=1.0))
    assert summary.formation_rms_m == pytest.approx(0.013, abs=1e-9)
    assert summary.formation_max_m == pytest.approx(0.013, abs=1e-9)
    assert summary.altitude_rms_m == pytest.approx(0.012, abs=1e-9)
    assert summary.vibration_m == pytest.approx(0.0, abs=1e-9)


def test_a_sine_vibrates_with_its_amplitude_and_has_its_rms():
    """2 Hz divides the 1 s window: the moving average vanishes and half peak-to-peak is the amplitude."""

    def shake(t_s: float):
        s = np.sin(2.0 * np.pi * 2.0 * t_s)
        return np.array([[0.02 * s, 0.01 * s, 0.0], [0.02 * s, 0.01 * s, 0.0]])

    summary = summarise(fly(error_lead=shake))
    assert summary.vibration_m == pytest.approx(0.015, rel=2e-3)
    assert summary.formation_rms_m == pytest.approx(np.hypot(0.02, 0.01) / np.sqrt(2.0), rel=2e-3)
    assert summary.formation_max_m == pytest.approx(np.hypot(0.02, 0.01), rel=1e-2)


def test_frames_before_the_slots_come_to_rest_are_not_scored():
    def late(t_s: float):
        return np.full((2, 3), 1.0 if 6.0 < t_s < 8.0 else 0.001)

    summary = summarise(fly(error_lead=late))
    assert summary.formation_max_m == pytest.approx(0.001 * np.sqrt(3.0), abs=1e-6)


def test_the_leaders_tracking_error_is_its_own_and_in_no_formation_error():
    """Wandering by 0.1 m about its reference with the followers held on it: 0.1 / sqrt(2) RMS, over whole periods."""
    summary = summarise(fly(leader_error=lambda t_s: np.array([0.1 * np.sin(np.pi * t_s), 0.0, 0.0])))
    assert summary.leader_rms_m == pytest.approx(0.1 / np.sqrt(2.0), rel=2e-3)
    assert summary.leader_max_m == pytest.approx(0.1, rel=1e-3)
    assert summary.formation_max_m == pytest.approx(0.0, abs=1e-9)


def test_the_leaders_tracking_error_counts_in_formation_alone_and_in_lab_axes():
    def far_outside(t_s: float):
        return np.array([0.03, 0.0, 0.04]) if 6.0 <= t_s < 16.0 else np.array([9.0, 0.0, 0.0])

    summary = summarise(fly(leader_error=far_outside, leader_yaw_rate_rad_s=1.0))
    assert summary.leader_max_m == pytest.approx(0.05, abs=1e-9)


def test_a_leader_that_is_only_observed_has_no_tracking_error():
    """Its column is gone from the references: what a follower is asked must not pass for the leader's reference."""
    lab = LAB.model_copy(update={"leader": LAB.leader.model_copy(update={"sysid": None})})
    flight = from_records({**METADATA, "lab": lab.model_dump_json()}, records(Recipe()))
    summary = summarise(flight)
    assert (summary.leader_rms_m, summary.leader_max_m) == (None, None)
    drawn = leader_error(flight, track_leader(flight))
    assert drawn == Missing("the leader is only observed, so it has no reference")


def test_separation_counts_only_while_airborne():
    """The followers are 0.8 m apart, and each 0.4 * sqrt(2) m from the leader."""
    summary = summarise(fly())
    assert summary.min_separation_m == pytest.approx(0.4 * np.sqrt(2.0), abs=1e-9)


def test_counts_and_latency():
    flight = fly()
    summary = summarise(flight)
    assert (summary.frames, summary.late_ticks, summary.followers) == (1000, 4, 2)
    assert summary.duration_s == pytest.approx(END_S, abs=0.02)
    ms = 1e3 * flight.timing["latency_s"]
    assert summary.latency_ms is not None
    assert summary.latency_ms.max == ms.max()
    assert summary.latency_ms.p50 == np.median(ms)
    assert summary.mocap_ms is not None
    assert summary.mocap_ms.p99 == pytest.approx(0.2)  # as the synthetic flight has it


def test_json_has_exactly_the_promised_keys():
    values = json.loads(summarise(fly()).to_json())
    assert list(values) == KEYS
    assert (values["scenario"], values["seed"], values["link"]) == ("synthetic", 7, "zenoh")
    assert values["realtime_factor"] is None


def test_an_empty_log_is_all_unknown():
    summary = summarise(from_records({}, []))
    assert (summary.formation_rms_m, summary.vibration_m, summary.min_separation_m) == (None, None, None)
    assert (summary.latency_ms, summary.age_ms) == (None, None)
    assert str(summary.outcome) == "aborted: the log holds no phases"
    json.loads(summary.to_json())


ENDED_BY_A_RULE = (*PHASES[:-2], (12.0, Phase.LAND, "mocap lost"), PHASES[-1])


@pytest.mark.parametrize(
    ("phases", "requests", "outcome"),
    [
        (PHASES, ((15.999, Verb.LAND),), "landed"),
        (PHASES[:-2], (), "aborted: the log ends in FORMATION"),
        (PHASES[:4], (), "held"),
        (PHASES[:2], (), "aborted: never took off"),
        ((*PHASES[:-2], (12.0, Phase.STOPPED, "operator")), (), "cut: operator"),
        (ENDED_BY_A_RULE, (), "aborted: mocap lost"),
        (  # `land` was asked for again while it came down, and on the ground
            (
                *ENDED_BY_A_RULE[:-1],
                (13.0, Phase.LAND, "operator: land"),
                (19.1, Phase.GROUND, "down"),
                (19.3, Phase.LAND, "operator: land"),
                (19.5, Phase.GROUND, "down"),
            ),
            ((13.0, Verb.LAND), (19.3, Verb.LAND)),
            "aborted: mocap lost",
        ),
    ],
)
def test_outcomes(phases, requests, outcome):
    assert str(summarise(fly(phases=phases, requests=requests)).outcome) == outcome


def test_a_log_that_was_not_closed_in_the_air_is_no_held_flight():
    killed = replace(fly(phases=PHASES[:4], requests=()), closed=False)
    assert str(summarise(killed).outcome).startswith("aborted: the log ends in HOLD, and its ground did not end it")


FLOWN = Summary(
    "line", 1, "udp", 20.0, 2, 0.004, 0.009, None, None, 0.001, 0.001, 0.55, 2000, 0, 0, None, Latency(1.0, 2.5, 9.0),
    None, None, 0.9, "", None, None, "landed",
)  # fmt: skip


@pytest.mark.parametrize(
    "text", ["formation_rms_m<0.005", " formation_max_m <= 9e-3 ", "latency_ms.p99<3", "frames>=2000"]
)
def test_what_is_reached(text: str) -> None:
    assert parse_requirement(text).unmet(FLOWN) is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("formation_rms_m<0.004", "formation_rms_m<0.004 is required, it is 0.004"),
        ("min_separation_m>0.6", "min_separation_m>0.6 is required, it is 0.55"),
        ("leader_rms_m<1", "leader_rms_m<1 is required, and not known of this flight"),
        ("age_ms.p99<50", "age_ms.p99<50 is required, and not known of this flight"),
    ],
)
def test_what_is_missed_or_not_known_is_told(text: str, why: str) -> None:
    assert unmet([parse_requirement("frames>1"), parse_requirement(text)], FLOWN) == (why,)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("formation_rms<1", "'formation_rms' is no number of a flight; known: seed, duration_s"),
        ("outcome<1", "'outcome' is no number"),
        ("formation_rms_m=1", "is not understood: a requirement is KEY<NUMBER"),
        ("formation_rms_m<5mm", "'5mm' is not a number"),
    ],
)
def test_what_is_none_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        parse_requirement(text)
