from __future__ import annotations

from itertools import permutations

from prismstereo_device.serving.schedule import TURN_OF, Schedule, Turn
from prismstereo_device.wire import Channel


def test_every_channel_has_its_turn() -> None:
    assert set(TURN_OF) == set(Channel)


def test_the_most_urgent_goes_first_in_whatever_order_things_came() -> None:
    for waiting in permutations((Turn.FRAME, Turn.CONTROL, Turn.REPORT)):
        assert Schedule().choose(waiting) is Turn.CONTROL


def test_nothing_waits_and_nothing_goes() -> None:
    assert Schedule().choose(()) is None


def test_every_fourth_packet_is_bulks_while_bulk_waits() -> None:
    schedule = Schedule()
    turns = [schedule.choose((Turn.FRAME, Turn.BULK)) for _ in range(400)]
    assert turns == [Turn.FRAME, Turn.FRAME, Turn.FRAME, Turn.BULK] * 100


def test_bulk_that_has_just_come_waits_for_three_packets_at_most() -> None:
    schedule = Schedule()
    for _ in range(100):
        schedule.choose((Turn.FRAME,))
    assert [schedule.choose((Turn.FRAME, Turn.BULK)) for _ in range(4)].index(Turn.BULK) == 3


def test_pictures_and_bulk_get_their_share_of_a_line_that_frames_fill() -> None:
    schedule = Schedule()
    turns = [schedule.choose((Turn.FRAME, Turn.PICTURE, Turn.BULK)) for _ in range(800)]
    assert turns.count(Turn.BULK) == 200
    assert 90 <= turns.count(Turn.PICTURE) <= 100


def test_no_flood_of_what_is_more_urgent_starves_anything_that_is_promised_a_share() -> None:
    schedule = Schedule()
    turns = [schedule.choose(tuple(Turn)) for _ in range(800)]
    assert turns.count(Turn.CONTROL) >= 500
    assert turns.count(Turn.BULK) == 200
