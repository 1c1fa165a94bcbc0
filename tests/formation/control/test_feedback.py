"""The feedback of one axis by each law: by hand, and its rate as its derivative."""

import pytest

from formation.control.gains import AxisGains, CascadeGains, Gains, GeometricGains, Law, SlidingGains, axis_gains
from formation.control.law import feedback
from formation.maths.records import rows

E, E_RATE, E_ACC, MEMORY, BOOST, SPEED_M_S, DT_S = 0.2, -0.3, 0.5, 0.1, 1.3, 2.0, 0.01
CASCADE, GEOMETRIC = CascadeGains(2.0, 4.0, 1.5, 0.3), GeometricGains(kx=9.0, kv=5.0, ki=4.0, mix=2.0, bound=1e3)
SLIDING = SlidingGains(Law.CFC, c=4.0, p1=3.0, p2=0.5, eps=-0.2, smooth_m_s=0.06)
LAWS = [SLIDING, SlidingGains(Law.ISTSMC, c=1.0, p1=8.0, p2=0.1, eps=-0.49), CASCADE, GEOMETRIC]


def fed_back(gains: Gains, *numbers: float) -> tuple[float, ...]:
    """s, t_m, memory, the acceleration and its rate: of e, e', e'', memory, factor on p1, speed limit, step."""
    record = rows(AxisGains, [axis_gains(gains)])
    return feedback(record[0], *numbers)


@pytest.mark.parametrize(
    ("gains", "s", "t_m", "memory"),
    [
        # v = e' + 2 e; its integral of 1.5 v; t_m is 4 v + that + 0.3 v', v' = e'' + 2 e'
        (CASCADE, 0.1, 4.0 * 0.1 + 0.1015 + 0.3 * (0.5 - 0.6), 0.1015),
        # integral of e' + 2 e; t_m is 9 e + 5 e' + 4 of it
        (GEOMETRIC, 0.1, 1.8 - 1.5 + 0.404, 0.101),
        (GeometricGains(9.0, 5.0, 4.0, 2.0, 0.05), 0.1, 1.8 - 1.5 + 0.2, 0.05),
        (SlidingGains(Law.SMC, c=1.0, k=5.0), -0.1, -5.0, 0.1),
    ],
)
def test_the_laws_of_the_textbooks(gains: Gains, s: float, t_m: float, memory: float) -> None:
    c = gains.c if isinstance(gains, SlidingGains) else 0.0
    found = fed_back(gains, E, E_RATE, E_ACC, MEMORY, BOOST, SPEED_M_S, DT_S)
    assert found[:4] == pytest.approx((s, t_m, memory, -c * E_RATE - t_m))


@pytest.mark.parametrize(("gains", "left_out"), [(CASCADE, -0.3 * 2.0 * E_ACC), (GEOMETRIC, 0.0), (SLIDING, 0.0)])
def test_the_rate_is_what_the_feedback_changes_by_while_errors_go_on(gains: Gains, left_out: float) -> None:
    """Of a PID's own D nothing: the error's jerk is not known."""
    step_s, now = 1e-6, (E, E_RATE, E_ACC, MEMORY, BOOST, SPEED_M_S)
    _, _, _, before, rate = fed_back(gains, *now, 1e-12)
    memory = fed_back(gains, *now, step_s)[2]
    later = E + step_s * E_RATE, E_RATE + step_s * E_ACC, E_ACC
    after = fed_back(gains, *later, memory, BOOST, SPEED_M_S, 1e-12)[3]
    assert (after - before) / step_s == pytest.approx(rate + left_out, rel=1e-3)


@pytest.mark.parametrize(
    ("gains", "rate_1_s"), [(CASCADE, CASCADE.kp_position), (GEOMETRIC, 9.0 / 5.0), (SLIDING, 4.0)]
)
def test_an_error_counts_only_as_far_as_it_is_closed_at_the_speed_limit(gains: Gains, rate_1_s: float) -> None:
    def asked(e_m: float) -> float:
        return fed_back(gains, e_m, 0.0, 0.0, 0.0, 1.0, SPEED_M_S, 1e-12)[3]

    most_m = SPEED_M_S / rate_1_s
    assert asked(1000.0) == asked(1.01 * most_m) == pytest.approx(asked(most_m)) == pytest.approx(-asked(-1000.0))
    assert abs(asked(0.98 * most_m)) < 0.99 * abs(asked(most_m))


@pytest.mark.parametrize("gains", LAWS, ids=lambda g: type(g).__name__)
@pytest.mark.parametrize("scale", [0.4, 0.7])
def test_a_scale_scales_c_p1_p2_and_all_gains_by_their_dimension_in_time(gains: Gains, scale: float) -> None:
    """All times 1/scale, speeds the same: lengths grow by 1/scale, accelerations by scale, their rates by its square.

    So c, p1, kp, kv, mix go with scale (1/s), p2, ki, kx with its square (1/s^2), eps, kd and m/s not at all.
    """
    length = 1.0 / scale
    memory_here, memory_there = 0.2, 0.2 * (length if isinstance(gains, GeometricGains) else scale)
    for e, e_rate, e_acc, dt in ((0.05, -0.3, 0.7, 0.01), (-0.2, 0.4, 1.0, 0.02), (0.9, 0.1, -2.0, 0.01)):
        s, t_m, memory_here, back, rate = fed_back(gains, e, e_rate, e_acc, memory_here, 1.3, 2.0, dt)
        slow = (e * length, e_rate, e_acc * scale, memory_there, 1.3, 2.0, dt * length)
        other_s, other_t_m, memory_there, other_back, other_rate = fed_back(gains.scaled(scale), *slow)
        assert other_s == pytest.approx(s)
        assert (other_back, other_t_m) == pytest.approx((scale * back, scale * t_m))
        assert other_rate == pytest.approx(scale**2 * rate, rel=1e-6)
