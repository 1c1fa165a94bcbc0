"""`gcs metrics`: the ground's published state as OpenMetrics, for Prometheus and whatever draws it.

A process of its own, which asks nothing: it hears what the page hears. The client library serves, in its own thread.
"""

import asyncio
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric, StateSetMetricFamily
from prometheus_client.registry import Collector

from formation.codes import Phase, Severity
from formation.config import LinkConfig
from gcs.page.show import LOST_S
from wire import clock
from wire.ground_state import GroundState, decode
from wire.process.daemon import GROUND_REMEDY, EventSink, Precondition, Stop, beside, report_missing
from wire.security.protection import Protection
from wire.transport.zenoh_bus import ZenohBus

PREFIX = "formation"
DRONE = (
    ("armed", "Whether the motors may turn", "armed"),
    ("excluded", "Whether it takes no part in the flight", "excluded"),
    ("battery_ratio", "Charge, 0 to 1", "battery"),
    ("position_error_meters", "Distance from its reference", "error_m"),
    ("fence_margin_meters", "Distance to the nearest wall", "fence_margin_m"),
    ("pose_age_seconds", "Since the cameras saw it", "age_s"),
    ("heartbeat_age_seconds", "Since its last heartbeat", "heartbeat_age_s"),
    ("telemetry_behind_seconds", "Age of its telemetry when it is read", "link_behind_s"),
    ("setpoint_age_seconds", "Age of the setpoints that reach it", "setpoint_age_s"),
    ("packet_loss_ratio", "Share of its packets that are lost, 0 to 1", "loss"),
)
"""Of each drone: name, meaning, and the field of wire.ground_state.DroneState."""
COUNTED = (
    ("frames", "Frames of the cameras"), ("missed_frames", "Frames that never came, or too late"),
    ("rejected_frames", "Frames that were rejected"), ("lost_packets", "Packets of drones that never came"),
    ("bad_packets", "Packets of drones that could not be read"),
)  # fmt: skip


class StateMetrics(Collector):
    """The newest state as metrics while the ground is heard, else that it is not; none of a drone that are unknown."""

    def __init__(self, now_ns: Callable[[], int] = clock.monotonic_ns) -> None:
        self._now_ns, self._state_ns = now_ns, 0
        self._state: GroundState | None = None

    def receive(self, text: str) -> None:
        """Receive a published state; ValueError for one of another version."""
        self._state, self._state_ns = decode(text), self._now_ns()

    @property
    def up(self) -> bool:
        """Whether the ground is heard."""
        return self._state is not None and self._now_ns() - self._state_ns < LOST_S * 1e9

    def collect(self) -> Iterator[Metric]:
        """Everything, as it is at this moment."""
        state, up = self._state, self.up
        yield GaugeMetricFamily(f"{PREFIX}_ground_up", "Whether the ground is heard", value=up)
        if state is None or not up:
            return
        phases = {phase.name: phase is state.phase for phase in Phase}
        yield StateSetMetricFamily(f"{PREFIX}_phase", "Phase of the flight", value=phases)
        for name, about, field in DRONE:
            family = GaugeMetricFamily(f"{PREFIX}_drone_{name}", about, labels=["body", "sysid"])
            for drone in state.drones:
                if (value := getattr(drone, field)) is not None:
                    family.add_metric([drone.body, str(drone.sysid)], float(value))
            yield family
        for name, about in COUNTED:
            yield CounterMetricFamily(f"{PREFIX}_{name}", about, value=getattr(state.counters, name))
        yield CounterMetricFamily(f"{PREFIX}_cycles", "Control cycles", value=state.cycles.count)
        yield CounterMetricFamily(f"{PREFIX}_late_cycles", "Control cycles that were late", value=state.cycles.late)
        alarms = GaugeMetricFamily(f"{PREFIX}_alarms", "Alarms that go on", labels=["severity"])
        for severity in Severity:
            count = sum(alarm.goes_on and alarm.severity is severity for alarm in state.alarms)
            alarms.add_metric([severity.name.lower()], count)
        yield alarms
        if state.log.free_bytes is not None:
            yield GaugeMetricFamily(f"{PREFIX}_disk_free_bytes", "Free on the log's disk", value=state.log.free_bytes)


async def _report_ground(ground: Precondition, report: EventSink) -> None:
    """Report whenever the ground is waited for, and when it is there; for ever."""
    while True:
        await report_missing("metrics", [ground], report)
        while ground.is_there():
            await asyncio.sleep(LOST_S)


async def run(
    link: LinkConfig, lab: str, name: str, where: tuple[str, int], report: EventSink, protection: Protection
) -> None:
    """Serve the ground's state at http://HOST:PORT/metrics until SIGINT or SIGTERM; OSError: the port is taken."""
    metrics, registry, stop = StateMetrics(), CollectorRegistry(), Stop(report)
    registry.register(metrics)
    host, port = where
    server, thread = start_http_server(port, host, registry)
    ground = Precondition(f"ground {name!r}", lambda: metrics.up, GROUND_REMEDY)
    try:
        bus = await ZenohBus.open(link.joined, lab, protection=protection)
        try:
            bus.on_state(name, metrics.receive)
            async with beside(_report_ground(ground, report)):
                await stop.wait()
        finally:
            await bus.close()
    finally:
        server.shutdown()
        thread.join()
