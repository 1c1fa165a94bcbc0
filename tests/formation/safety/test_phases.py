import itertools

import pytest

from formation.messages import Phase
from formation.safety.phases import AIRBORNE, STREAMING, TABLE, Trigger, advance, allowed_from, table_markdown


def _fly(*triggers: Trigger) -> list[Phase]:
    phases = [Phase.GROUND]
    for trigger in triggers:
        after = advance(phases[-1], trigger)
        assert after is not None, f"{trigger} refused in {phases[-1].name}"
        phases.append(after)
    return phases


def test_whole_flight_goes_through_every_phase_and_back_to_ground():
    flight = _fly(
        Trigger.ARM,
        Trigger.TAKEOFF,
        Trigger.AT_HEIGHT,
        Trigger.START,
        Trigger.HOLD,
        Trigger.LAND,
        Trigger.DISARMED,
    )
    assert flight == [
        Phase.GROUND,
        Phase.ARMED,
        Phase.TAKEOFF,
        Phase.HOLD,
        Phase.FORMATION,
        Phase.HOLD,
        Phase.LAND,
        Phase.GROUND,
    ]


@pytest.mark.parametrize("phase", Phase)
def test_stop_works_from_anywhere_and_only_reset_leaves_stopped(phase):
    assert advance(phase, Trigger.STOP) is Phase.STOPPED
    leads_back = [trigger for trigger in Trigger if advance(Phase.STOPPED, trigger) not in (None, Phase.STOPPED)]
    assert leads_back == [Trigger.RESET]
    assert advance(Phase.STOPPED, Trigger.RESET) is Phase.GROUND


@pytest.mark.parametrize("phase", Phase)
def test_landing_means_something_in_every_phase_and_in_the_air_that_it_lands(phase):
    allowed = (Phase.LAND,) if phase in AIRBORNE else (Phase.LAND, Phase.GROUND, Phase.STOPPED)
    assert advance(phase, Trigger.LAND) in allowed


def test_motors_can_only_be_started_by_arming_on_the_ground():
    entering = {(p, t) for (p, t), after in TABLE.items() if p not in STREAMING and after in STREAMING}
    assert entering == {(Phase.GROUND, Trigger.ARM), (Phase.GROUND, Trigger.TAKE_CONTROL), (Phase.GROUND, Trigger.LAND)}


def test_only_takeoff_leaves_the_floor_and_drones_that_fly_already_are_taken_over_or_landed():
    leaving = {(p, t) for (p, t), after in TABLE.items() if p not in AIRBORNE and after in AIRBORNE}
    assert leaving == {
        (Phase.ARMED, Trigger.TAKEOFF),
        (Phase.GROUND, Trigger.TAKE_CONTROL),
        (Phase.GROUND, Trigger.LAND),
    }


def test_allowed_from_agrees_with_the_table():
    for phase, trigger in itertools.product(Phase, Trigger):
        assert (phase in allowed_from(trigger)) == (advance(phase, trigger) is not None)


def test_documented_table_has_every_cell():
    lines = table_markdown().splitlines()
    assert len(lines) == 2 + len(Phase)
    for line, phase in zip(lines[2:], Phase, strict=True):
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        assert cells[0] == phase.name
        assert cells[1:] == [
            after.name if (after := advance(phase, trigger)) is not None else "-" for trigger in Trigger
        ]
