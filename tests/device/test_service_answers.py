from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Iterator

import pytest

from device.service_host import IDENTITY, Counting, Host
from prismstereo_device.link import Link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import Held, ObjectNumber, Progress, WriteStatus
from prismstereo_device.protocol import (
    Capability,
    Command,
    CommandReply,
    CommandStatus,
    Ping,
    ReadReply,
    ReadRequest,
    ReadStatus,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    calibration_hash,
)
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import Service
from prismstereo_device.wire import REPLY, Channel

CALIBRATION = bytes(range(256)) * 40
OBJECTS = FixedObjects({ObjectNumber.CALIBRATION: CALIBRATION})


class Counter:
    """Counts how often each command ran; its answer is that number."""

    def __init__(self) -> None:
        self.runs: dict[str, int] = {}

    def answer(self, command: Command) -> CommandReply:
        self.runs[command.name] = self.runs.get(command.name, 0) + 1
        value = "x" * 5000 if command.name == "long" else self.runs[command.name]
        return CommandReply(CommandStatus.OK, value)


class Notebook:
    """One object that can be written; a commit waits until it is let go."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.commits = 0
        self._content = b"first"
        self._staged = bytearray()

    def read(self, obj: int) -> Held | None:
        return Held(len(self._content), self._content) if obj == ObjectNumber.CALIBRATION else None

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        return Progress(WriteStatus.OK, len(self._staged))

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        if offset > len(self._staged):
            return Progress(WriteStatus.GAP, len(self._staged))
        self._staged[offset:] = data
        return Progress(WriteStatus.OK, len(self._staged))

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        self.go.wait(10)
        self.commits += 1
        if hashlib.sha256(self._staged).digest() != sha256:
            return Progress(WriteStatus.MISMATCH)
        self._content, self._staged = bytes(self._staged), bytearray()
        return Progress(WriteStatus.OK, size)


@pytest.fixture
def line() -> Iterator[tuple[Link, Link]]:
    device, host = loopback()
    with device, host:
        yield device, host


def write_reply(host: Host, request: WriteBegin | WritePart, msg: int) -> WriteReply:
    return WriteReply.unpack(host.ask(Channel.BULK, request.pack(), msg))


def test_the_calibration_is_read_in_parts(line: tuple[Link, Link]) -> None:
    device, host_end = line
    content = b""
    with Service(Counting(0), device, IDENTITY, objects=OBJECTS):
        host = Host(host_end)
        host.meet()
        request = 65_530  # the numbers of requests wrap meanwhile
        while len(content) < len(CALIBRATION):
            request = (request + 1) & 0xFFFF
            host.say(Channel.BULK, ReadRequest(1, 0, len(content), 1000).pack(), msg=request)
            packet = host.hear_next(Channel.BULK)
            assert packet.flags & REPLY
            assert packet.msg == request
            content += ReadReply.unpack(packet.payload).data
    assert content == CALIBRATION


@pytest.mark.parametrize("objects", [None, OBJECTS])
def test_an_object_that_is_not_there_is_refused(line: tuple[Link, Link], objects: FixedObjects | None) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY, objects=objects):
        host = Host(host_end)
        host.meet()
        reply = ReadReply.unpack(host.ask(Channel.BULK, ReadRequest(2 if objects else 1, 0, 0, 100).pack(), 1))
        written = write_reply(host, WriteBegin(1, 5, bytes(32)), 2)
    assert reply.status is ReadStatus.NO_SUCH_OBJECT
    assert written.status is WriteStatus.NO_SUCH_OBJECT


def test_a_read_that_is_repeated_is_read_again(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY, objects=OBJECTS):
        host = Host(host_end)
        host.meet()
        replies = [ReadReply.unpack(host.ask(Channel.BULK, ReadRequest(1, 0, 7, 9).pack(), 4)) for _ in range(3)]
    assert [reply.data for reply in replies] == [CALIBRATION[7:16]] * 3


def test_a_command_that_is_repeated_runs_once_and_is_answered_each_time(line: tuple[Link, Link]) -> None:
    device, host_end = line
    counter = Counter()
    with Service(Counting(0), device, IDENTITY, commands=counter):
        host = Host(host_end)
        assert host.meet().capabilities == Capability.COMPACT | Capability.COMMANDS
        answers = [CommandReply.unpack(host.ask(Channel.CMD, Command("do", "step").pack(), 65_535)) for _ in range(3)]
        after = CommandReply.unpack(host.ask(Channel.CMD, Command("do", "step").pack(), 0))
    assert [answer.value for answer in answers] == [1, 1, 1]
    assert after.value == 2
    assert counter.runs == {"step": 2}


def test_a_command_from_long_ago_is_stale_and_does_not_run(line: tuple[Link, Link]) -> None:
    device, host_end = line
    counter = Counter()
    with Service(Counting(0), device, IDENTITY, commands=counter):
        host = Host(host_end)
        host.meet()
        host.ask(Channel.CMD, Command("do", "step").pack(), 10)
        late = CommandReply.unpack(host.ask(Channel.CMD, Command("do", "late").pack(), 65_514))  # 32 before
    assert late.status is CommandStatus.STALE
    assert counter.runs == {"step": 1}


def test_another_session_begins_its_numbers_anew(line: tuple[Link, Link]) -> None:
    device, host_end = line
    counter = Counter()
    with Service(Counting(0), device, IDENTITY, commands=counter):
        for nonce in (5, 6):
            host = Host(host_end, nonce)
            host.meet()
            host.ask(Channel.CMD, Command("do", "step").pack(), 9)
    assert counter.runs == {"step": 2}


def test_an_answer_that_fits_no_packet_is_a_failure_and_no_end(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY, commands=Counter()):
        host = Host(host_end)
        host.meet()
        assert (
            CommandReply.unpack(host.ask(Channel.CMD, Command("do", "long").pack(), 1)).status is CommandStatus.FAILED
        )
        assert CommandReply.unpack(host.ask(Channel.CMD, Command("do", "step").pack(), 2)).value == 1


def test_a_device_without_commands_knows_none(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY):
        host = Host(host_end)
        assert host.meet().capabilities == Capability.COMPACT
        reply = CommandReply.unpack(host.ask(Channel.CMD, Command("get", "gain").pack(), 1))
    assert reply.status is CommandStatus.UNKNOWN
    assert "gain" in reply.why


def test_an_object_is_written_and_named_at_the_next_hello(line: tuple[Link, Link]) -> None:
    device, host_end = line
    notebook = Notebook()
    notebook.go.set()
    content = b"second edition"
    sha256 = hashlib.sha256(content).digest()
    with Service(Counting(0), device, IDENTITY, objects=notebook):
        host = Host(host_end)
        assert host.meet().calibration_hash == calibration_hash(b"first")
        assert write_reply(host, WriteBegin(1, 14, sha256), 1) == WriteReply(WriteStatus.OK, 1, 0)
        assert write_reply(host, WritePart(1, sha256[:4], 7, b"edition"), 2) == WriteReply(WriteStatus.GAP, 1, 0)
        assert write_reply(host, WritePart(1, sha256[:4], 0, b"second "), 3).held == 7
        assert write_reply(host, WritePart(1, b"else", 7, b"edition"), 4).status is WriteStatus.NOT_BEGUN
        assert write_reply(host, WritePart(1, sha256[:4], 7, b"edition"), 5).held == 14
        assert write_reply(host, WriteCommit(1, 14, sha256), 6) == WriteReply(WriteStatus.OK, 1, 14)
        assert write_reply(host, WriteCommit(1, 14, sha256), 6) == WriteReply(WriteStatus.OK, 1, 14)
        assert notebook.commits == 1
        host.heard.clear()
        assert host.meet().calibration_hash == calibration_hash(content)


def test_a_part_of_a_write_that_another_session_began_is_refused(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY, objects=Notebook()):
        first = Host(host_end, nonce=5)
        first.meet()
        assert write_reply(first, WriteBegin(1, 4, b"name" * 8), 1).status is WriteStatus.OK
        second = Host(host_end, nonce=6)
        second.meet()
        assert write_reply(second, WritePart(1, b"name", 0, b"text"), 1).status is WriteStatus.NOT_BEGUN


def test_heartbeats_go_on_while_a_commit_takes_its_time(line: tuple[Link, Link]) -> None:
    device, host_end = line
    notebook = Notebook()
    sha256 = hashlib.sha256(b"").digest()
    with Service(Counting(0), device, IDENTITY, objects=notebook):
        host = Host(host_end)
        host.meet()
        for _ in range(3):  # the host asks again and again: one runs, the others are passed over in silence
            host.say(Channel.BULK, WriteCommit(1, 0, sha256).pack(), 7)
        begin = time.monotonic()
        host.ask(Channel.CTRL, Ping(1).pack(), 3)
        assert time.monotonic() - begin < 0.5
        assert not host.on(Channel.BULK)
        notebook.go.set()
        host.hear_until(lambda: bool(host.on(Channel.BULK)))
        host.ask(Channel.CTRL, Ping(1).pack(), 4)
    assert notebook.commits == 1


def test_what_an_earlier_session_asked_is_not_answered_to_the_next(line: tuple[Link, Link]) -> None:
    device, host_end = line
    notebook = Notebook()
    with Service(Counting(0), device, IDENTITY, objects=notebook):
        first = Host(host_end, nonce=5)
        first.meet()
        first.say(Channel.BULK, WriteCommit(1, 0, bytes(32)).pack(), 7)
        first.say(Channel.BULK, ReadRequest(1, 0, 0, 5).pack(), 8)
        first.ask(Channel.CTRL, Ping(1).pack(), 3)
        second = Host(host_end, nonce=6)
        second.meet()
        notebook.go.set()
        reply = ReadReply.unpack(second.ask(Channel.BULK, ReadRequest(1, 0, 1, 5).pack(), 7))
        second.ask(Channel.CTRL, Ping(1).pack(), 4)
    assert (reply.offset, reply.data) == (1, b"irst")
    assert len([packet for packet in second.heard if packet.channel == Channel.BULK]) <= 1
