"""The delay margin: the search alone, and its hover against a point mass of the oracles' own."""

import numpy as np
import pytest

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig, MocapConfig
from formation.control import margin
from formation.control.margin import DelayMargin, delay_margin, held, kicked_hover
from formation.control.presets import preset_for
from formation.control.stack import ControlStack
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.messages import LabFrame
from formation.vehicle.profile import PAPER_40G, PX4_QUAD, VehicleProfile
from tests.formation.oracles.plant import Plant

CAMERAS = MocapConfig(rate_hz=80.0, delay_s=0.012)
DEFAULT = {body.name: preset_for("default", body, CAMERAS) for body in (PAPER_40G, PX4_QUAD)}
T0 = 10**9


@pytest.mark.parametrize("body", [PAPER_40G, PX4_QUAD], ids=lambda b: b.name)
def test_the_kicked_hover_is_a_point_mass_behind_a_longer_dead_time(body: VehicleProfile) -> None:
    """Starts at (0, 0, 1) with 0.3 and 0.15 m/s; attitude and thrust answer 25 ms later than is believed; no drag."""
    body = body.model_copy(update={"drag_n_s_m": (0.0, 0.0, 0.0)})
    late = body.model_copy(update={"response_dead_time_s": body.response_dead_time_s + 0.025,
                                   "thrust_dead_time_s": body.thrust_dead_time_s + 0.025})  # fmt: skip
    config = LabConfig(
        leader=LeaderConfig(body="L", profile=body.name),
        followers=(FollowerConfig(body="A", sysid=1, profile=body.name, offset_m=(1.0, 0.0, 0.0)),),
        limits=LimitsConfig(fence=Fence(low_m=(-1e3,) * 3, high_m=(1e3,) * 3), speed_m_s=100.0),
        mocap=CAMERAS,
    )
    gains = DEFAULT[body.name]
    stack, plan = (
        ControlStack(config, (body, body), gains),
        Plan((Setpoint(Mode.LAB, (0.0, 0.0, 1.0), 0.0),), configured(config)),
    )
    plant, hover, expected = Plant(late, T0, np.array([0.0, 0.0, 1.0])), np.array([body.hover_thrust_norm]), []
    plant.vel = np.array([0.3, 0.15, 0.0])
    for k in range(40):
        t_ns, now_ns = T0 + k * 12_500_000, T0 + k * 12_500_000 + 12_000_000
        expected.append(plant.pos)
        pos, q = np.array([[5.0, 5.0, 0.0], plant.pos]), np.array([[1.0, 0.0, 0.0, 0.0], upright(plant.force)])
        target = stack.step(
            now_ns, LabFrame(k, t_ns, ("L", "A"), pos, q, np.ones(2, dtype=np.bool_)), plan, hover
        ).target
        plant.send(now_ns, target.q_lab_from_flu[0], target.rate_flu_rad_s[0], float(target.thrust_norm[0]))
        plant.advance(t_ns, t_ns + 12_500_000)
    path = kicked_hover(body, gains, CAMERAS, 0.025, 0.5)
    np.testing.assert_allclose(path, expected, atol=1e-9)


def upright(force: np.ndarray) -> np.ndarray:
    """The shortest turn from lab z to the force, as a quaternion: (1 + z.f, z x f), normalised."""
    f = force / np.linalg.norm(force)
    q = np.array([1.0 + f[2], -f[1], f[0], 0.0])
    return q / np.linalg.norm(q)


def test_the_margin_is_found_by_bisection_to_two_milliseconds(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(margin, "held", lambda body, gains, mocap, late_s: asked.append(late_s) or late_s <= 0.0731)
    found = delay_margin(PX4_QUAD, DEFAULT["px4_quad"], CAMERAS)
    assert 0.0711 <= found.margin_s <= 0.0731
    assert asked[0] == 0.0
    assert max(asked) < 0.2
    assert len(asked) == 1 + 7  # 200 ms halved seven times is under 2 ms
    assert found.loop_s == pytest.approx(0.012 + 0.11 + 0.06)
    assert (found.vehicle, found.preset) == ("px4_quad", "default")


def test_what_is_not_held_without_further_delay_has_no_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(margin, "held", lambda *_: False)
    assert delay_margin(PX4_QUAD, DEFAULT["px4_quad"], CAMERAS).margin_s == -0.002


@pytest.mark.parametrize(("late_m", "early_m", "expected"), [
    (0.09, 5.0, True), (0.11, 0.0, False), (-0.11, 0.0, False), (np.inf, 0.0, False),
])  # fmt: skip
def test_held_is_within_ten_centimetres_in_the_last_two_seconds_on_every_axis(
    monkeypatch: pytest.MonkeyPatch, late_m: float, early_m: float, expected: bool
) -> None:
    for axis in range(3):
        path = np.tile([0.0, 0.0, 1.0], (480, 1))  # 6 s at 80 Hz; the last two seconds are 160 frames
        path[319, axis] += early_m
        path[320, axis] += late_m
        monkeypatch.setattr(margin, "kicked_hover", lambda *args, path=path: path)
        assert held(PX4_QUAD, DEFAULT["px4_quad"], CAMERAS, 0.0) is expected


def test_a_tenth_of_the_loop_is_needed_and_told() -> None:
    assert DelayMargin("v", "p", 0.2, 0.021).carried
    assert not DelayMargin("v", "p", 0.2, 0.019).carried
    told = "preset p on v: camera to attitude 200 ms, delay margin 30 ms, needed 20 ms"
    assert str(DelayMargin("v", "p", 0.2, 0.03)) == told
    assert "delay margin none" in str(DelayMargin("v", "p", 0.2, -0.002))


def test_what_flies_far_away_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(margin, "KICK_M_S", 1e5)
    path = kicked_hover(PAPER_40G, DEFAULT["paper_40g"], CAMERAS, 0.0, 0.1)
    assert np.isinf(path[-1]).all()
