"""The published state as OpenMetrics, read by Prometheus' own parser; a dashboard asks for what there is."""

import json
import re
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.openmetrics.exposition import generate_latest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from formation.messages import Phase, Verb
from gcs.metrics import StateMetrics
from tests.docs.manual_pages import ROOT
from tests.gcs.fakes import FakeLab, triangle
from wire.ground_state import encode

Samples = dict[tuple[str, str], float]


def scraped(metrics: StateMetrics) -> Samples:
    """As Prometheus has it: by name, and by the value of its only label beside the system id."""
    registry = CollectorRegistry()
    registry.register(metrics)
    samples: Samples = {}
    for family in text_string_to_metric_families(generate_latest(registry).decode()):
        for sample in family.samples:
            labels = [value for label, value in sample.labels.items() if label != "sysid"]
            samples[sample.name, "".join(labels)] = sample.value
    return samples


@pytest.fixture(scope="module")
def airborne() -> Samples:
    lab, metrics = FakeLab(triangle(leader={"body": "lead", "sysid": 1})), StateMetrics()
    lab.run(2.0)
    lab.command(Verb.ARM, Phase.ARMED)
    lab.run(3.0)
    metrics.receive(encode(lab.core.state(lab.now_ns)))
    return scraped(metrics)


def test_a_flight_is_there_with_its_phase_and_its_drones(airborne: Samples) -> None:
    assert airborne["formation_phase", "ARMED"] == 1.0
    assert airborne["formation_phase", "GROUND"] == 0.0
    assert airborne["formation_drone_armed", "left"] == 1.0
    assert airborne["formation_drone_pose_age_seconds", "left"] == pytest.approx(0.005, abs=0.02)
    assert airborne["formation_frames_total", ""] > 400


NOT_HEARD = {("formation_ground_up", ""): 0.0}


def test_before_a_ground_is_heard_there_is_nothing_else() -> None:
    assert scraped(StateMetrics()) == NOT_HEARD


def test_a_ground_that_is_gone_has_no_figures_until_it_is_heard_again() -> None:
    """The last state, served for ever, would show a room's screen a healthy lab."""
    now_ns, lab = [0], FakeLab(triangle())
    lab.run(1.0)
    metrics = StateMetrics(lambda: now_ns[0])
    for heard_s in (0.0, 60.0):
        now_ns[0] = round(heard_s * 1e9)
        metrics.receive(encode(lab.core.state(lab.now_ns)))
        assert scraped(metrics)["formation_ground_up", ""] == 1.0
        assert ("formation_drone_armed", "left") in scraped(metrics)
        now_ns[0] += 5_000_000_000
        assert scraped(metrics) == NOT_HEARD


def test_a_dashboard_asks_for_metrics_that_there_are(airborne: Samples) -> None:
    dashboard = json.loads(Path(ROOT, "contrib/grafana/formation.json").read_text(encoding="utf-8"))
    queries = " ".join(panel["targets"][0]["expr"] for panel in dashboard["panels"])
    unknown_here = {"formation_drone_battery_ratio", "formation_drone_setpoint_age_seconds"}
    assert set(re.findall(r"formation_\w+", queries)) <= {name for name, _ in airborne} | unknown_here
