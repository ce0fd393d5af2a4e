from __future__ import annotations

import heapq
import itertools
from concurrent.futures import Future

import numpy as np
import pytest

from host.small_device import Answering
from prismstereo.requests import NotSent, OutcomeUnknown, Requests
from prismstereo.round_trip import RoundTrip
from prismstereo_device.framing import Packet
from prismstereo_device.link import LinkLost
from prismstereo_device.protocol import Command, CommandReply, CommandStatus
from prismstereo_device.wire import FIRST, LAST, REPLY, Channel

CMD = Channel.CMD


class BadLine:
    """Requests and a device, with a line between them that loses, doubles and reorders; time runs only in `run`."""

    def __init__(
        self, seed: int = 1, *, loss: float = 0.0, twice: float = 0.0, delays_s: tuple[float, float] = (0.01, 0.01)
    ):
        self.now_s = 100.0
        self.device = Answering()
        self.requests = Requests(CMD, self._to_device, RoundTrip(), lambda: self.now_s)
        self.session = 0
        self.cut = False
        self.carried = 0
        self._random = np.random.default_rng(seed)
        self._loss, self._twice, self._delays_s = loss, twice, delays_s
        self._order = itertools.count()
        self._under_way: list[tuple[float, int, int, bool, int, bytes]] = []

    def _to_device(self, channel: Channel, payload: bytes, *, msg: int, session: int) -> bool:
        if session != self.session:
            return False
        self._carry(to_host=False, msg=msg, payload=payload)
        return True

    def _carry(self, *, to_host: bool, msg: int, payload: bytes) -> None:
        self.carried += 1
        for _ in range(1 + (self._random.random() < self._twice)):
            if not self.cut and self._random.random() >= self._loss:
                due_s = self.now_s + self._random.uniform(*self._delays_s)
                heapq.heappush(self._under_way, (due_s, next(self._order), self.session, to_host, msg, payload))

    def ask(self, number: int, timeout_s: float = 5.0) -> Future[bytes]:
        return self.requests.ask(Command("do", "count", number).pack(), timeout_s)

    def begin_session(self) -> None:
        """Both ends go on in another session; what is under way has the check sum of the old one."""
        self.session += 1
        self.device.begin_session()
        self.requests.begin_session(self.session)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += 0.001
            while self._under_way and self._under_way[0][0] <= self.now_s:
                _, _, session, to_host, msg, payload = heapq.heappop(self._under_way)
                if session != self.session:
                    continue
                if to_host:
                    self.requests.take(Packet(CMD, payload, FIRST | LAST | REPLY, msg=msg))
                elif (reply := self.device.answer(CMD, msg, payload)) is not None:
                    self._carry(to_host=True, msg=msg, payload=reply)
            if self.requests.tick() < self.now_s:
                continue


def told(outcome: Future[bytes]) -> str:
    """What the asker is told: done, unknown, or never sent."""
    if isinstance(outcome.exception(0), OutcomeUnknown):
        return "unknown"
    if outcome.exception(0) is not None:
        return "not sent"
    return CommandReply.unpack(outcome.result(0)).status.name


def test_a_request_is_answered_at_the_first_try_on_a_good_line() -> None:
    line = BadLine()
    outcome = line.ask(7)
    line.run(0.05)
    assert (told(outcome), line.device.ran, line.requests.repeated) == ("OK", [7], 0)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_thousand_commands_on_a_terrible_line_run_once_at_most_and_their_outcome_is_true(seed: int) -> None:
    line = BadLine(seed, loss=0.2, twice=0.2, delays_s=(0.001, 0.03))
    outcomes: dict[int, Future[bytes]] = {}
    for number in range(1000):
        while line.requests.room == 0:
            line.run(0.01)
        outcomes[number] = line.ask(number)
        if number % 250 == 125:
            line.begin_session()
    line.run(10.0)
    ran = line.device.ran
    assert len(ran) == len(set(ran))
    assert all(outcome.done() for outcome in outcomes.values())
    assert not [number for number, outcome in outcomes.items() if told(outcome) == "OK" and number not in ran]
    assert not [number for number, outcome in outcomes.items() if told(outcome) == CommandStatus.STALE.name]
    unknown = [number for number, outcome in outcomes.items() if told(outcome) == "unknown"]
    assert len(unknown) <= 4 * 32  # those that were out when a session ended
    assert len(ran) >= 1000 - len(unknown)


@pytest.mark.soak
def test_forty_thousand_commands_on_terrible_lines() -> None:
    print("\nloss  doubled  reordered ms  commands  ran  ran twice  unknown  wrongly told  packets per command")
    for seed, loss in itertools.product(range(10), (0.05, 0.1, 0.2, 0.3)):
        line = BadLine(seed, loss=loss, twice=0.2, delays_s=(0.001, 0.04))
        outcomes = []
        for number in range(1000):
            while line.requests.room == 0:
                line.run(0.01)
            outcomes.append(line.ask(number, 20.0))
            if number % 300 == 150:
                line.begin_session()
        line.run(25.0)
        ran = line.device.ran
        wrong = sum(told(outcome) == "OK" and number not in set(ran) for number, outcome in enumerate(outcomes))
        unknown = sum(told(outcome) == "unknown" for outcome in outcomes)
        twice = len(ran) - len(set(ran))
        print(
            f"{loss:4.2f}  0.20     1-40          1000      {len(ran)}  {twice}  {unknown}  {wrong}  {line.carried / 1000:.2f}"
        )
        assert (twice, wrong) == (0, 0)


def test_a_session_that_ends_within_a_command_leaves_it_unknown_and_does_not_run_it_again() -> None:
    line = BadLine()
    outcome = line.ask(1)
    line.run(0.012)  # it has arrived and was run, its answer is under way
    assert line.device.ran == [1]
    line.begin_session()
    line.run(3.0)
    assert told(outcome) == "unknown"
    assert "may or may not have been run" in str(outcome.exception(0))
    assert line.device.ran == [1]


def test_a_command_that_could_not_be_sent_goes_out_in_the_next_session() -> None:
    line = BadLine()
    line.session = 1  # the connection is in a session that the requests do not know of yet
    outcome = line.ask(5)
    line.run(1.0)
    assert line.device.ran == []
    line.requests.begin_session(1)
    line.run(0.1)
    assert (told(outcome), line.device.ran) == ("OK", [5])


def test_a_command_that_never_left_is_told_so() -> None:
    line = BadLine()
    line.session = 1
    outcome = line.ask(5, timeout_s=0.5)
    line.run(0.6)
    assert isinstance(outcome.exception(0), NotSent)
    assert isinstance(outcome.exception(0), LinkLost)


def test_a_silent_line_makes_the_asker_patient_and_the_first_quick_answer_ends_that() -> None:
    line = BadLine()
    line.ask(0)
    line.run(0.1)
    line.cut = True
    outcome = line.ask(1, timeout_s=10.0)
    line.run(6.0)
    assert 8 <= line.requests.repeated <= 12  # 50, 100, 200, 400, 800 ms, and then one a second
    line.cut = False
    line.run(1.1)
    assert told(outcome) == "OK"
    before = line.requests.repeated
    line.ask(2)
    line.run(0.1)
    line.cut = True
    line.ask(3)
    line.run(0.16)
    assert line.requests.repeated - before == 2


def test_many_overdue_requests_do_not_fill_the_line() -> None:
    line = BadLine()
    line.ask(0)
    line.run(0.1)
    line.cut = True
    for number in range(32):
        line.ask(number)
    assert line.requests.room == 0
    line.run(1.0)
    # 50 ms of patience, an eighth of it apart, doubling: 8 + 8 + 8 + 8 and half of the next
    assert line.requests.repeated <= 40


def test_no_more_than_32_numbers_are_out_however_old_the_oldest_is() -> None:
    line = BadLine()
    line.cut = True
    first = line.ask(0)
    line.cut = False
    for number in range(1, 32):
        line.ask(number)
    line.run(0.05)
    assert line.device.ran == list(range(1, 32))
    assert line.requests.room == 0  # a 33rd number would make the first one stale
    line.run(1.0)
    assert (told(first), line.requests.room) == ("OK", 32)


def test_numbers_wrap_without_a_loss() -> None:
    line = BadLine()
    for number in range(200):
        outcome = line.ask(number)
        line.run(0.025)
        assert told(outcome) == "OK"
    assert line.device.ran == list(range(200))


def test_an_end_lets_nobody_wait() -> None:
    line = BadLine()
    line.cut = True
    sent = line.ask(1)
    line.requests.end(LinkLost("the camera is closed"))
    after = line.ask(2)
    assert told(sent) == "unknown"
    with pytest.raises(LinkLost, match="the camera is closed"):
        after.result(0)
