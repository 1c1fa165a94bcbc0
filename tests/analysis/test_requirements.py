import pytest

from analysis.metrics import Latency, Summary, parse_requirement, unmet

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
