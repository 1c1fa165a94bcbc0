import pytest
from pydantic import ValidationError

from formation.config import LabConfig
from formation.vehicle import PAPER_40G


def lab(**changes: object) -> LabConfig:
    followers = [{"body": "b", "sysid": 2, "offset_m": (-0.4, 0.0, 0.0)}]
    return LabConfig.model_validate({"leader": {"body": "a", "sysid": 1}, "followers": followers, **changes})


def test_a_lab_may_name_a_vehicle_of_its_own():
    own = PAPER_40G.model_copy(update={"name": "ours", "mass_kg": 0.05})
    config = lab(profiles=[own.model_dump()], leader={"body": "a", "sysid": 1, "profile": "ours"})
    assert [config.profile_of(v).mass_kg for v in config.vehicles] == [0.05, 0.04]


def test_an_unknown_profile_is_refused_with_the_known_ones():
    with pytest.raises(ValidationError, match=r"unknown vehicle profile 'nope'; known: paper_40g, px4_quad"):
        lab(leader={"body": "a", "profile": "nope"})


@pytest.mark.parametrize(
    ("leader", "named"), [({"body": "b"}, "share a body name"), ({"body": "a", "sysid": 2}, "share a sysid")]
)
def test_no_two_vehicles_share_a_name(leader, named):
    with pytest.raises(ValidationError, match=named):
        lab(leader=leader)


@pytest.mark.parametrize(
    ("leader", "links"),
    [
        ({"body": "a", "sysid": 1}, "zenoh"),
        ({"body": "a"}, "zenoh"),
        ({"body": "a", "sysid": 1, "link": "udp:127.0.0.1:14540"}, "udp and zenoh"),
    ],
)
def test_the_links_told_are_those_that_drones_are_on(leader, links):
    assert lab(leader=leader).link_kinds == links


@pytest.mark.parametrize("name", ["../../x", "a/b", "", "..", "a b", "[/]", "<b>", "x\x1b[2J", "a\n", "x" * 65, "**"])
def test_a_name_is_what_may_stand_in_a_path_a_key_and_a_page(name):
    """A body `../../x` wrote its drone's logs outside their folder."""
    wrong = (
        {"leader": {"body": name}},
        {"name": name},
        {"control_preset": name},
        {"formation": {"shapes": {name: [{"offset_m": (-0.4, 0.0, 0.0)}]}}},
        {"profiles": [{**PAPER_40G.model_dump(), "name": name}]},
    )
    for values in wrong:
        with pytest.raises(ValidationError, match="not a name"):
            lab(**values)


def test_a_name_of_letters_digits_dots_and_dashes_is_taken():
    assert lab(name="Room-3_b.2", leader={"body": "x" * 64}).name == "Room-3_b.2"
