"""What a drone's own link and parameters say against arming it."""

from gcs.drones import checks
from gcs.drones.checks import warnings
from gcs.drones.link_state import DroneLink
from tests.gcs.fakes import COPTER_PARAMETERS, PX4_PARAMETERS
from tests.gcs.link import MS, Drone, a_link, beat, tell
from wire.link_messages import EkfStatus, MavAutopilot


def prearm_failures(link: DroneLink) -> tuple[str, ...]:
    return tuple(reject.text for reject in checks.prearm_failures(link))


def test_vital_parameters_keep_a_drone_on_the_ground():
    link = a_link()
    assert prearm_failures(link) == ()  # a missing heartbeat is told by safety itself
    autopilot = MavAutopilot.ARDUPILOT
    Drone().say(link, beat(autopilot))
    assert prearm_failures(link) == ("left: no estimator report yet", "left: GUID_OPTIONS is being read",
                                "left: GUID_TIMEOUT is being read")  # fmt: skip
    Drone().say(link, EkfStatus(0x10, ardupilot=True))
    tell(link, {**COPTER_PARAMETERS, "GUID_OPTIONS": 0}, autopilot)
    assert prearm_failures(link) == (
        "left: GUID_OPTIONS is 0, wanted thrust (bit 8): without it our thrust is read as a climb rate",
    )
    # ArduCopter 4.7's default, with which its SITL drifted 5 m.
    tell(link, {**COPTER_PARAMETERS, "GUID_TIMEOUT": 3.0}, autopilot)
    assert [text.split(",")[0] for text in prearm_failures(link)] == ["left: GUID_TIMEOUT is 3"]
    tell(link, COPTER_PARAMETERS, autopilot)
    assert prearm_failures(link) == ()
    for flags in (0, 0x400, 0x410):
        Drone().say(link, EkfStatus(flags, ardupilot=True))
        assert prearm_failures(link) == ("left: estimator has no position yet",)


def test_vital_parameters_that_stay_silent_are_reported_as_unread():
    link = a_link()
    Drone().say(link, beat())
    for ms in range(0, 20_000, 50):
        link.due(ms * MS)
    assert prearm_failures(link) == (
        "left: COM_OF_LOSS_T could not be read: how long it flies on after our setpoints stop",
    )


def test_a_velocity_taken_from_gps_is_reported_where_the_pose_is_ours():
    """ArduCopter 4.7 refuses to arm so: "EK3 sources require GPS"."""
    link = a_link()
    Drone().say(link, beat(MavAutopilot.ARDUPILOT))
    tell(link, {**COPTER_PARAMETERS, "EK3_SRC1_VELXY": 3.0}, MavAutopilot.ARDUPILOT)
    assert [name for name, _ in warnings(link, feeds_pose=True)] == ["EK3_SRC1_VELXY"]
    assert warnings(link, feeds_pose=False) == ()


def test_an_autopilot_of_another_kind_is_a_prearm_failure():
    link = a_link()
    Drone().say(link, beat(MavAutopilot.GENERIC))
    assert prearm_failures(link) == ("left: autopilot GENERIC is neither PX4 nor ArduPilot",)


def test_lesser_parameters_only_warn_and_external_pose_ones_only_where_the_pose_is_ours():
    link = a_link()
    Drone().say(link, beat())
    tell(link, {**PX4_PARAMETERS, "EKF2_EV_CTRL": 0, "COM_OBL_RC_ACT": 0, "MPC_THR_HOVER": 0.3}, MavAutopilot.PX4)
    assert prearm_failures(link) == ()
    ours, not_ours = warnings(link, feeds_pose=True), warnings(link, feeds_pose=False)
    assert [name for name, _ in ours] == ["COM_OBL_RC_ACT", "EKF2_EV_CTRL", "MPC_THR_HOVER"]
    assert [name for name, _ in not_ours] == ["COM_OBL_RC_ACT", "MPC_THR_HOVER"]
