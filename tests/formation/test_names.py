"""Which known name is meant by one that a user misspelt: the same words everywhere."""

import pytest

from formation.control.presets import preset
from formation.guidance.shape import shape_for
from formation.guidance.shape_request import ShapeRequest
from formation.names import meant, unknown
from formation.vehicle.profile import profile
from tests.gcs.bus import a_lab


@pytest.mark.parametrize(
    ("word", "near"),
    [("natnett", "natnet"), ("OptiTrack", "natnet"), ("QTM", "qualisys"), ("Vicon", "vicon"), ("chek", "check"),
     ("info", "check"), ("xyz", None), ("", None), ("v" * 10**6, None)],
)  # fmt: skip
def test_the_name_that_is_meant(word: str, near: str | None) -> None:
    known = ("natnet", "qualisys", "vicon", "check")
    assert meant(word, known) == (f": is {near} meant?" if near else "")
    assert unknown(word[:9], known).endswith("; known: natnet, qualisys, vicon, check")


def test_what_is_not_there_names_what_may_be_meant() -> None:
    with pytest.raises(ValueError, match=r"vehicle profile 'quad_25g': is quad_250g meant\?; known: paper_40g"):
        profile("quad_25g")
    with pytest.raises(ValueError, match=r"control preset 'defualt': is default meant\?"):
        preset("defualt")
    with pytest.raises(ValueError, match=r"no shape 'lien': is line meant\?"):
        shape_for(a_lab(), ShapeRequest("lien"))
