"""The stage table of one drone: what it must say whatever else is added to it."""

from gcs.drones.stages import MOTORS_OFF, ROWS, TABLE, Stage, Trigger
from tests.gcs.link import a_link


def leads_out(stage: Stage) -> set[Trigger]:
    """The triggers that lead from it to another stage."""
    return {trigger for (before, trigger), after in TABLE.items() if before is stage and after is not stage}


def test_a_stop_cuts_from_every_stage_and_a_cut_ends_only_where_a_flight_begins_or_all_are_down():
    assert all(TABLE[stage, Trigger.STOP] is Stage.CUT for stage in Stage)
    assert leads_out(Stage.CUT) == {Trigger.ARM, Trigger.JOIN, Trigger.REST, Trigger.DONE}


def test_a_drone_that_is_released_or_a_pilots_is_not_led_again_in_this_flight():
    anew = {Trigger.ARM, Trigger.JOIN, Trigger.REST}
    assert leads_out(Stage.PILOTED) == {*anew, Trigger.STOP}
    assert leads_out(Stage.RELEASED) == {*anew, Trigger.STOP, Trigger.CUT, Trigger.PILOT, Trigger.DONE}


def test_setpoints_stop_with_a_release_a_cut_or_a_pilot_and_motors_off_is_what_landings_end_with():
    assert {stage for stage in Stage if not ROWS[stage].streams} == {Stage.RELEASED, Stage.CUT, Stage.PILOTED}
    link = a_link()  # never armed
    reached = {stage for stage, row in ROWS.items() if row.reached is not None and row.reached(link)}
    assert reached == MOTORS_OFF
