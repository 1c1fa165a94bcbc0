"""Which frames were lost, by their numbers."""

import pytest

from mocap.sources.numbered import NumberedFrames
from tests.mocap.sources.recorded_feed import kept


@pytest.mark.parametrize(
    ("numbers", "seqs", "lost"),
    [
        ([5, 6, 7, 8], [0, 1, 2, 3], 0),
        ([5, 6, 9, 10], [0, 1, 4, 5], 2),
        ([100, 110, 120, 150, 160], [0, 1, 2, 5, 6], 2),  # 10 camera frames to one that is sent
        ([5, 6, 6, 7], [0, 1, None, 2], 0),
        ([900, 901, 1, 2, 3], [0, 1, -899, -898, -897], 0),  # the server was started again
        ([1, 2, 900_000, 900_001], [0, 1, 899_999, 900_000], 0),
        ([5, 6, 8, 7, 9, 10], [0, 1, 3, 2, 4, 5], 1),  # one was overtaken
        ([100, 110, 130, 120, 140], [0, 1, 3, 2, 4], 1),
        ([100, 110, 9_000_000, 120], [0, 1, 899_990, 2], 0),  # a stray of another publisher
    ],
)
def test_gaps_count_and_new_starts_do_not(numbers, seqs, lost):
    count = NumberedFrames("", (), kept("vicon").feed())
    assert [count.number(number) for number in numbers] == seqs
    assert count.lost == lost


def test_a_slower_stream_is_no_loss_for_long():
    count = NumberedFrames("", (), kept("vicon").feed())
    for number in range(100):
        count.number(number)
    for number in range(101, 400, 2):
        count.number(number)
    lost = count.lost
    assert lost <= 64
    for number in range(401, 600, 2):
        count.number(number)
    assert count.lost == lost
