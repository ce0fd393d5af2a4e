"""Chores are done one after the other, and one that fails is not silent."""

from __future__ import annotations

import pytest

from prismstereo_device.control.chores import Chores


def test_chores_are_done_in_their_order_and_a_failed_one_is_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    done: list[int] = []

    def fail() -> None:
        raise ValueError("the disk is on fire")

    with Chores() as chores:
        chores.submit(done.append, 1)
        chores.submit(fail)
        chores.submit(done.append, 2)
    assert done == [1, 2]
    assert "a chore failed" in caplog.text
    assert "the disk is on fire" in caplog.text
