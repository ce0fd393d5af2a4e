from __future__ import annotations

import numpy as np

from prismstereo.line_loss import LineLoss
from prismstereo_device.framing import Packet
from prismstereo_device.wire import Channel


def test_a_tenth_of_the_packets_lost_is_a_hundred_permille_also_at_a_wrap_of_their_numbers() -> None:
    loss, arrives = LineLoss(), np.random.default_rng(3).random(70_000) > 0.1
    permilles = []
    for number in np.flatnonzero(arrives):
        loss.count(Packet(Channel.DISP, b"", seq=int(number) & 0xFFFF))
        if number % 1000 == 999:
            permilles.append(loss.permille(0, number * 0.001))
    assert max(abs(permille - 100) for permille in permilles[3:]) <= 25


def test_what_was_lost_long_ago_is_forgotten() -> None:
    loss = LineLoss()
    loss.permille(0, 0.0)
    for number in range(0, 100, 2):
        loss.count(Packet(Channel.DISP, b"", seq=number))
    assert loss.permille(0, 1.0) == round(1000 * 49 / 99)
    for step in range(1, 20):
        loss.count(Packet(Channel.DISP, b"", seq=98 + step))
        permille = loss.permille(0, 1.0 + step * 0.5)
    assert permille == 0


def test_damage_that_leaves_no_gap_counts_too_and_a_new_session_is_no_gap() -> None:
    loss = LineLoss()
    loss.permille(0, 0.0)
    for number in range(90):
        loss.count(Packet(Channel.CTRL, b"", seq=number))
    assert loss.permille(10, 1.0) == 100
    loss.begin_session()
    for number in range(100):
        loss.count(Packet(Channel.CTRL, b"", seq=number))
    assert loss.permille(10, 1.5) == 50


def test_a_packet_that_comes_twice_or_late_is_no_loss() -> None:
    loss = LineLoss()
    loss.permille(0, 0.0)
    for number in (0, 1, 1, 2, 0, 3):
        loss.count(Packet(Channel.DISP, b"", seq=number))
    assert loss.permille(0, 1.0) == 0
