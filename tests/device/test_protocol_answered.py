"""At most once: whatever the line does, no request is run twice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prismstereo_device.protocol import AnsweredRequests, Verdict


class Counter:
    """A device with one command, *add one*, behind its memory of requests."""

    def __init__(self) -> None:
        self.memory = AnsweredRequests()
        self.runs: dict[int, int] = {}
        self.stale = 0

    def hear(self, request: int) -> bytes | None:
        """Take request number `request` (not wrapped); give what is answered."""
        verdict = self.memory.answer_to(request & 0xFFFF)
        if verdict is Verdict.STALE:
            self.stale += 1
            return b"stale"
        if verdict is Verdict.NEW:
            self.runs[request] = self.runs.get(request, 0) + 1
            answer = str(sum(self.runs.values())).encode()
            self.memory.keep(request & 0xFFFF, answer)
            return answer
        assert isinstance(verdict, bytes)
        return verdict


def line(requests: range, random: np.random.Generator, tries: int = 6) -> list[int]:
    """What arrives of requests that are each tried up to `tries` times: 20 % lost, 20 % doubled, shuffled among 40."""
    sent = [(number + 5.0 * attempt, number) for number in requests for attempt in range(tries)]
    arrived = []
    for when, number in sent:
        if random.random() < 0.2:
            continue
        for _ in range(1 + (random.random() < 0.2)):
            arrived.append((when + 40 * random.random(), number))
    return [number for _, number in sorted(arrived)]


@pytest.mark.parametrize("first", [1, 65_000, 1_000_000])
def test_a_thousand_commands_over_a_terrible_line_are_each_run_once_or_not_at_all(first: int) -> None:
    random, device = np.random.default_rng(9), Counter()
    requests = range(first, first + 1000)
    answers: dict[int, set[bytes]] = {}
    for number in line(requests, random):
        answer = device.hear(number)
        if answer is not None and random.random() > 0.2:
            answers.setdefault(number, set()).add(answer)
    assert set(device.runs.values()) == {1}
    assert len(device.runs) > 950
    for number, heard in answers.items():
        assert len(heard - {b"stale"}) == device.runs.get(number, 0) or heard == {b"stale"}


def test_what_a_host_reports_is_what_happened() -> None:
    random, device, ran = np.random.default_rng(10), Counter(), 0
    for number in range(1000):  # one command at a time, repeated until it is answered or given up
        reported = None
        for _ in range(3):
            if random.random() < 0.2:
                continue
            for _ in range(1 + (random.random() < 0.2)):
                answer = device.hear(number)
            if random.random() > 0.2:
                reported = answer
                break
        ran += reported is not None
        if reported is not None:
            assert device.runs[number] == 1
    assert set(device.runs.values()) == {1}
    assert device.stale == 0
    assert ran > 900


def test_a_late_duplicate_that_is_no_longer_kept_is_stale_and_not_run() -> None:
    device = Counter()
    for number in range(300):
        device.hear(number)
    assert device.hear(299 - 127) == b"173"  # one of the 128 that are kept
    assert device.hear(299 - 128) == b"stale"
    assert sum(device.runs.values()) == 300


def test_a_request_that_was_overtaken_by_less_than_32_is_still_new() -> None:
    memory = AnsweredRequests()
    assert memory.answer_to(100) is Verdict.NEW
    assert memory.answer_to(100 - 31) is Verdict.NEW
    assert memory.answer_to(100 - 32) is Verdict.STALE


def test_a_repeat_of_what_is_still_being_run_is_not_run_again() -> None:
    memory = AnsweredRequests()
    assert memory.answer_to(5) is Verdict.NEW
    assert memory.answer_to(5) is Verdict.UNDER_WAY
    memory.keep(5, b"done")
    assert memory.answer_to(5) == b"done"


def test_another_session_begins_with_numbers_of_its_own() -> None:
    memory = AnsweredRequests()
    memory.answer_to(500)
    memory.clear()
    memory.keep(500, b"an answer of the session before")
    assert memory.answer_to(3) is Verdict.NEW
    assert memory.answer_to(500) is Verdict.NEW


def test_numbers_wrap_and_old_answers_do_not_come_back_with_them() -> None:
    memory = AnsweredRequests()
    for number in range(0, 3 * 65536, 7):  # most requests are lost, so that few answers push others out
        if number % 3000 < 7:
            assert memory.answer_to(number & 0xFFFF) is Verdict.NEW
            memory.keep(number & 0xFFFF, b"answer")


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(-40, 60), min_size=1, max_size=300), st.integers(0, 65535))
def test_no_order_of_arrival_makes_a_request_run_twice(steps: list[int], first: int) -> None:
    device, newest = Counter(), first + 70_000
    for step in steps:
        newest = max(newest, newest + step)
        device.hear(newest + min(step, 0))
    assert set(device.runs.values()) == {1}
