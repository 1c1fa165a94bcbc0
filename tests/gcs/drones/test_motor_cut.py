"""A motor cut as one drone is asked for it: repeated until the drone's own heartbeat says that its motors are off."""

import pytest

from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink
from gcs.drones.stages import Trigger
from tests.gcs.link import MS, a_link, beat
from tests.gcs.link import Drone as Autopilot
from wire.link_messages import GROUND, CommandAck, CommandLong, MavCommand, Result


def _sent(drone: Drone, link: DroneLink, now_ms: int) -> list[tuple[int, float, float]]:
    """The commands that are sent at that time: number and first two parameters."""
    drone.pursue(now_ms * MS)
    return [(m.command, *m.params[:2]) for m in link.due(now_ms * MS) if isinstance(m, CommandLong)]


CUT = (400, 0.0, 21196.0)
ASKS_HEARTBEAT = (MavCommand.REQUEST_MESSAGE, 0.0, 0.0)


@pytest.mark.parametrize("result", [Result.ACCEPTED, Result.DENIED, Result.IN_PROGRESS])
def test_a_heartbeat_alone_ends_a_motor_cut_and_dates_it(result: Result) -> None:
    """It goes before all that is asked of a drone just met, and is never given up: 50 times, where 8 are the rule."""
    link, autopilot = a_link(), Autopilot()
    drone = Drone(0, link)
    autopilot.say(link, beat(armed=True), 0)
    _sent(drone, link, 5)
    drone.enter(Trigger.STOP, 10 * MS)
    assert _sent(drone, link, 10) == [CUT]
    autopilot.say(link, CommandAck(GROUND, 400, result), 12 * MS)  # of `arm`, asked for just before
    for ms in range(20, 500, 10):
        sent = _sent(drone, link, ms)
        assert CUT in sent
        assert (ASKS_HEARTBEAT in sent) == (ms == 20)
        assert drone.stopped_ns is None
    autopilot.say(link, beat(armed=False), 503 * MS)
    assert _sent(drone, link, 510) == []
    assert drone.stopped_ns == 503 * MS
    autopilot.say(link, beat(armed=False), 1503 * MS)
    assert _sent(drone, link, 1510) == []
    assert drone.stopped_ns == 503 * MS
    autopilot.say(link, beat(armed=True), 2503 * MS)  # another ground, or a pilot
    assert _sent(drone, link, 2510) == [CUT]
    assert drone.stopped_ns is None
