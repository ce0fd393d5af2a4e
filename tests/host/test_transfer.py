from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from host.small_device import Answering
from prismstereo.requests import OutcomeUnknown, Requests
from prismstereo.round_trip import RoundTrip
from prismstereo.transfer import ObjectTransfer
from prismstereo_device.framing import Packet
from prismstereo_device.link import LinkLost
from prismstereo_device.objects import Held, ObjectNumber, Progress, WriteStatus
from prismstereo_device.protocol import ReadRequest, WriteBegin, WriteCommit, WritePart, read_bulk_request
from prismstereo_device.wire import FIRST, LAST, REPLY, Channel, WireError
from prismstereo_hw.errors import DataError, DeviceError, UsageError

MEGABYTE = np.random.default_rng(11).bytes(1_000_000)
STILL = ObjectNumber.STILL
UPDATE = ObjectNumber.UPDATE
HURRY = 20.0  # so much faster than real time runs the clock of the requests


class Shelf:
    """A device that keeps objects, behind a line that loses packets and is cut, with a session change, now and then."""

    def __init__(
        self,
        content: bytes = b"",
        *,
        loss: float = 0.0,
        cuts: tuple[int, ...] = (),
        mtu: int = 4096,
        answering: Answering | None = None,
        patience_s: float = 5.0,
    ) -> None:
        self.device = answering or Answering({STILL: Held(7, content)} if content else {}, mtu)
        self.asked: list[object] = []
        self.cut = False
        self._random = np.random.default_rng(5)
        self._loss, self._cuts = loss, set(cuts)
        self._session = 0
        self.before: Callable[[int], None] = lambda asked: None
        self._stopping = threading.Event()
        self.requests = Requests(Channel.BULK, self._send, RoundTrip(), lambda: HURRY * time.monotonic())
        self.transfer = ObjectTransfer(self.requests, lambda: mtu, "the line", patience_s=patience_s)
        self._ticker = threading.Thread(target=self._tick)
        self._ticker.start()

    def _send(self, channel: Channel, payload: bytes, *, msg: int, session: int) -> bool:
        if session != self._session:
            return False
        self.asked.append(read_bulk_request(payload))
        self.before(len(self.asked))
        if len(self.asked) in self._cuts:
            self._cuts.discard(len(self.asked))
            self._session += 1
            self.device.begin_session()
            self.requests.begin_session(self._session)
        elif not self.cut and self._random.random() >= self._loss:
            reply = self.device.answer(channel, msg, payload)
            if reply is not None and self._random.random() >= self._loss:
                self.requests.take(Packet(channel, reply, FIRST | LAST | REPLY, msg=msg))
        return True

    def _tick(self) -> None:
        while not self._stopping.wait(0.001):
            self.requests.tick()

    def __enter__(self) -> Shelf:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._ticker.join()


@pytest.mark.parametrize("cuts", [(), tuple(range(13, 130, 13))], ids=["no cut", "cut at nine points"])
def test_an_object_is_read_in_parts(cuts: tuple[int, ...]) -> None:
    with Shelf(MEGABYTE[:500_000], cuts=cuts) as shelf:
        assert shelf.transfer.read(STILL) == MEGABYTE[:500_000]
        assert {request.version for request in shelf.asked[1:]} <= {0, 7}


def test_a_megabyte_is_read_over_a_line_that_loses_packets_and_is_cut_ten_times() -> None:
    cuts = tuple(int(at) for at in np.random.default_rng(1).choice(240, 10, replace=False) + 1)
    with Shelf(MEGABYTE, loss=0.02, cuts=cuts) as shelf:
        assert shelf.transfer.read(STILL) == MEGABYTE
        parts = sum(isinstance(request, ReadRequest) for request in shelf.asked)
        assert parts < 245 * 1.08 + 10 * 8 + 10  # what was there already is not asked for again


def test_a_megabyte_is_written_over_a_line_that_loses_packets_and_is_cut_ten_times() -> None:
    cuts = tuple(int(at) for at in np.random.default_rng(2).choice(240, 10, replace=False) + 1)
    with Shelf(loss=0.02, cuts=cuts) as shelf:
        shelf.before = lambda asked: seen.append(dict(shelf.device.committed))
        seen: list[dict[int, bytes]] = []
        shelf.transfer.write(UPDATE, MEGABYTE)
        assert shelf.device.committed == {UPDATE: MEGABYTE}
        assert all(held in ({}, {UPDATE: MEGABYTE}) for held in seen)  # never half of it
        assert sum(isinstance(request, WritePart) for request in shelf.asked) < 2 * 245


@pytest.mark.soak
def test_uploads_and_downloads_on_bad_lines() -> None:
    print("\nloss  cuts  read ok  written ok  packets per part")
    for loss in (0.0, 0.02, 0.1, 0.2):
        good = [0, 0]
        asked = 0
        for seed in range(10):
            cuts = tuple(int(at) for at in np.random.default_rng(seed).choice(240, 10, replace=False) + 1)
            with Shelf(MEGABYTE, loss=loss, cuts=cuts, patience_s=60.0) as shelf:
                good[0] += shelf.transfer.read(STILL) == MEGABYTE
                asked += len(shelf.asked)
            with Shelf(loss=loss, cuts=cuts, patience_s=60.0) as shelf:
                shelf.transfer.write(UPDATE, MEGABYTE)
                good[1] += shelf.device.committed == {UPDATE: MEGABYTE}
                asked += len(shelf.asked)
        print(f"{loss:4.2f}  10    {good[0]}/10    {good[1]}/10       {asked / (20 * 245):.2f}")
        assert good == [10, 10]


def test_a_session_with_smaller_packets_goes_on_with_smaller_parts() -> None:
    with Shelf(MEGABYTE[:100_000]) as shelf:

        def shrink(asked: int) -> None:
            if asked == 10:
                shelf.device.mtu = 512

        shelf.before = shrink
        assert shelf.transfer.read(STILL) == MEGABYTE[:100_000]


def test_an_object_larger_than_its_limit_is_refused() -> None:
    with Shelf(bytes(1001)) as shelf, pytest.raises(WireError, match="1001 bytes: at most 1000"):
        shelf.transfer.read(STILL, 1000)


def test_an_object_that_is_not_there_is_an_error_by_name() -> None:
    with Shelf() as shelf, pytest.raises(DataError, match="object 3 cannot be read from the line: no such object"):
        shelf.transfer.read(3)


def test_an_object_that_changes_while_it_is_read_is_read_anew_and_never_mixed() -> None:
    with Shelf(b"a" * 20_000, mtu=512) as shelf:

        def change(asked: int) -> None:
            if asked == 12:
                shelf.device.objects[STILL] = Held(8, b"b" * 15_000)

        shelf.before = change
        assert shelf.transfer.read(STILL) == b"b" * 15_000


def test_an_object_that_changes_all_the_time_is_given_up() -> None:
    with Shelf(b"a" * 20_000, mtu=512) as shelf:
        shelf.before = lambda asked: shelf.device.objects.update({STILL: Held(asked, b"a" * 20_000)})
        with pytest.raises(DataError, match="changed 3 times"):
            shelf.transfer.read(STILL)


def test_a_version_that_is_gone_is_an_error() -> None:
    with Shelf(b"a" * 500) as shelf, pytest.raises(DataError, match="version 6 of object 2 is no longer"):
        shelf.transfer.read(STILL, version=6)


def test_a_second_try_goes_on_where_the_first_was_cut() -> None:
    with Shelf(mtu=512, patience_s=0.1) as shelf:

        def cut(asked: int) -> None:
            shelf.cut = asked >= 100

        shelf.before = cut
        with pytest.raises(LinkLost, match="object 4 was not written to the line to its end: a request was sent"):
            shelf.transfer.write(UPDATE, MEGABYTE[:100_000])
        first = len(shelf.asked)
        shelf.before = lambda asked: setattr(shelf, "cut", False)
        shelf.transfer.write(UPDATE, MEGABYTE[:100_000])
        assert shelf.device.committed == {UPDATE: MEGABYTE[:100_000]}
        again = [request.offset for request in shelf.asked[first:] if isinstance(request, WritePart)]
        assert min(again) >= 90 * 502


def test_a_commit_whose_answer_is_lost_with_the_session_is_asked_again_and_done_once() -> None:
    with Shelf() as shelf:

        def lose(asked: int) -> None:
            if isinstance(shelf.asked[-1], WriteCommit) and not shelf.device.committed:
                shelf.device.answer(Channel.BULK, 0x1234, shelf.asked[-1].pack())
                shelf._cuts.add(asked)

        shelf.before = lose
        shelf.transfer.write(UPDATE, b"x" * 9000)
        assert shelf.device.committed == {UPDATE: b"x" * 9000}
        assert sum(isinstance(request, WriteBegin) for request in shelf.asked) == 1


class Refusing(Answering):
    """A shelf whose begin ends as it is told to."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self._progress = progress

    def _written(self, request: WriteBegin | WritePart | WriteCommit) -> Progress:
        return self._progress


@pytest.mark.parametrize(
    ("status", "error"),
    [
        (WriteStatus.NO_SUCH_OBJECT, UsageError),
        (WriteStatus.TOO_LARGE, UsageError),
        (WriteStatus.REFUSED, DataError),
        (WriteStatus.NO_ROOM, DeviceError),
    ],
)
def test_what_the_device_refuses_is_an_error_in_its_own_words(status: WriteStatus, error: type[Exception]) -> None:
    with (
        Shelf(answering=Refusing(Progress(status, why="its own words"))) as shelf,
        pytest.raises(error, match="object 1 of 3 bytes is not taken by the line: its own words"),
    ):
        shelf.transfer.write(ObjectNumber.CALIBRATION, b"abc")


def test_an_empty_object_is_not_written() -> None:
    with Shelf() as shelf, pytest.raises(UsageError, match="no bytes"):
        shelf.transfer.write(UPDATE, b"")


def test_a_transfer_that_is_told_of_the_end_waits_no_longer() -> None:
    with Shelf(b"a" * 500) as shelf:
        shelf.cut = True
        threading.Timer(0.05, lambda: shelf.requests.end(LinkLost("the camera is closed"))).start()
        with pytest.raises((LinkLost, OutcomeUnknown), match="the camera is closed"):
            shelf.transfer.read(STILL)
