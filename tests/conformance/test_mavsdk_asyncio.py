"""MAVSDK 4 (asyncio API) against the agent as a process over UDP."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard.offboard import Attitude
from mavsdk.plugins.param.param import ParamError
from mavsdk.plugins.telemetry.telemetry import FlightMode, LandedState

from tests.conformance.agent import START_S, agent

pytestmark = pytest.mark.processes
T = TypeVar("T")


@asynccontextmanager
async def connected(url: str) -> AsyncIterator[Any]:
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=START_S)
        assert system is not None, "MAVSDK found no autopilot"
        yield system


async def first(values: AsyncGenerator[T, None], wanted: Callable[[T], bool], wait_s: float = 30.0) -> T:
    """The first value that is wanted; TimeoutError."""
    try:
        async with asyncio.timeout(wait_s):
            async for value in values:
                if wanted(value):
                    return value
    finally:
        await values.aclose()
    raise AssertionError("the stream ended")


def test_a_flight_with_its_parameters_texts_and_rates(tmp_path: Path) -> None:
    async def flight(system: Any) -> None:
        action, telemetry, offboard = ActionAsync(system), TelemetryAsync(system), OffboardAsync(system)
        param = ParamAsync(system)
        assert (await InfoAsync(system).get_version()).flight_sw_major == 1
        assert len((await param.get_all_params()).float_params) > 40
        await param.set_param_int("NAV_DLL_ACT", 3)
        assert await param.get_param_int("NAV_DLL_ACT") == 3
        await param.set_param_float("MPC_LAND_SPEED", 0.65)
        assert await param.get_param_float("MPC_LAND_SPEED") == pytest.approx(0.65)
        with pytest.raises(ParamError):
            await param.get_param_float("NO_SUCH_PARAM")
        await first(telemetry.subscribe_health_all_ok(), lambda ok: ok)
        await action.set_takeoff_altitude(1.5)
        armed = asyncio.create_task(
            first(telemetry.subscribe_status_text(), lambda text: text.text == "Armed by external command")
        )
        await asyncio.sleep(0)
        await action.arm()
        await armed
        await action.takeoff()
        await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
        up = await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 1.4)
        assert up.relative_altitude_m == pytest.approx(1.5, abs=0.15)
        await telemetry.set_rate_attitude_quaternion(20.0)
        stamps: list[int] = []
        async with asyncio.timeout(20.0):
            async for q in telemetry.subscribe_attitude_quaternion():
                stamps.append(q.timestamp_us)
                if len(stamps) == 41:
                    break
        assert 40.0 / ((stamps[-1] - stamps[0]) * 1e-6) == pytest.approx(20.0, rel=0.05)
        await offboard.set_attitude(Attitude(0.0, -4.0, 0.0, 0.49))
        await offboard.start()
        # Nose down: forward, which is north.
        euler = await first(telemetry.subscribe_attitude_euler(), lambda e: abs(e.pitch_deg + 4.0) < 0.4)
        assert abs(euler.roll_deg) < 0.5
        await first(telemetry.subscribe_velocity_ned(), lambda v: v.north_m_s > 0.2)
        await offboard.stop()
        await action.land()
        await first(telemetry.subscribe_landed_state(), lambda state: state == LandedState.ON_GROUND)
        await first(telemetry.subscribe_armed(), lambda armed: not armed)

    async def body(url: str) -> None:
        async with connected(url) as system:
            await flight(system)

    with agent(tmp_path, "--link", "udp", "--profile", "px4_quad") as running:
        asyncio.run(body(running.mavsdk_url))
