"""The answers to what a host asks: commands at once, objects in a thread of their own, each request run once at most."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from prismstereo_device.framing import Packet
from prismstereo_device.objects import ObjectNumber, Objects, Progress, WriteStatus
from prismstereo_device.protocol.answered import Verdict
from prismstereo_device.protocol.bulk import (
    BulkRequest,
    ReadRequest,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    answer_read,
    read_bulk_request,
)
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus
from prismstereo_device.protocol.hello import calibration_hash
from prismstereo_device.serving.session import Session
from prismstereo_device.wire import LIMITS

__all__ = ["BulkAnswers", "Commands", "NoCommands", "answer_command"]

logger = logging.getLogger(__name__)

_JOIN_S = 10.0
_REFRESH_S = 1.0
_READ_AGAIN = (
    b""  # kept instead of a read's bytes: reading again changes nothing, and 128 answers would be half a megabyte
)
_STALE = CommandReply(
    CommandStatus.STALE, why="too old to know whether it was run; not run now: ask what is in force, then send it anew"
).pack()


class Commands(Protocol):
    """Whatever runs commands: within some milliseconds, and without raising."""

    def answer(self, command: Command) -> CommandReply:
        """Run a command, or say why not."""
        ...


class NoCommands:
    """A device that knows no command."""

    def answer(self, command: Command) -> CommandReply:
        """Say that there is no such thing."""
        return CommandReply(
            CommandStatus.UNKNOWN, why=f"{command.name} is not known here: this device takes no commands"
        )


def answer_command(packet: Packet, session: Session, commands: Commands) -> bytes | None:
    """Give the answer's body, from memory where the request is repeated; None while it is being run. Raises WireError."""
    command = Command.unpack(packet.payload)
    verdict = session.commands.answer_to(packet.msg)
    if isinstance(verdict, bytes):
        return verdict
    if verdict is Verdict.UNDER_WAY:
        return None
    if verdict is Verdict.STALE:
        return _STALE
    body = commands.answer(command).pack()
    if len(body) > LIMITS.payload:
        logger.error("the answer to %s %s has %d bytes", command.verb, command.name, len(body))
        body = CommandReply(CommandStatus.FAILED, why=f"the value of {command.name} does not fit one packet").pack()
    session.commands.keep(packet.msg, body)
    return body


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request that waits for its answer."""

    session: Session
    msg: int
    request: BulkRequest


class BulkAnswers:
    """Reads and writes objects for a host, one request after the other, in a thread that may take its time.

    `objects` is touched by that thread alone. `post(session, body, msg)` sends an answer.
    """

    def __init__(self, objects: Objects, mtu: int, post: Callable[[Session, bytes, int], None]) -> None:
        self._objects = objects
        self._mtu = mtu
        self._post = post
        self._asked: queue.Queue[_Asked | None] = queue.Queue(2 * LIMITS.requests_outstanding)
        self._begun: dict[int, tuple[Session, bytes]] = {}  # SHA-256 of what is being written, by object
        self._calibration_version: int | None = None
        self._calibration_hash = bytes(8)
        self._look_at_calibration()
        self._thread = threading.Thread(target=self._run, name="prismstereo-objects", daemon=True)

    @property
    def calibration_hash(self) -> bytes:
        """Name, 8 bytes, of the calibration that was there a second ago at most; zeros where there is none."""
        return self._calibration_hash

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def stop(self) -> None:
        """End, after the request at hand; waits for 10 s at most."""
        if self._thread.ident is not None:
            self._drop_waiting()
            self._asked.put(None)
            self._thread.join(_JOIN_S)

    def ask(self, packet: Packet, session: Session) -> None:
        """Take a request; one too many, or too old, is not answered: the host asks again. Raises WireError."""
        request = read_bulk_request(packet.payload)
        if self._asked.full():
            return
        verdict = session.bulk.answer_to(packet.msg)
        if verdict is Verdict.NEW or (verdict == _READ_AGAIN and isinstance(request, ReadRequest)):
            self._asked.put(_Asked(session, packet.msg, request))
        elif isinstance(verdict, bytes) and verdict != _READ_AGAIN:
            self._post(session, verdict, packet.msg)

    def end_session(self) -> None:
        """Forget what an earlier session asked and is not begun."""
        self._drop_waiting()

    def _drop_waiting(self) -> None:
        try:
            while True:
                self._asked.get_nowait()
        except queue.Empty:
            return

    def _run(self) -> None:
        while True:
            try:
                asked = self._asked.get(timeout=_REFRESH_S)
            except queue.Empty:
                self._look_at_calibration()
                continue
            if asked is None:
                return
            self._answer(asked)

    def _answer(self, asked: _Asked) -> None:
        if isinstance(asked.request, ReadRequest):
            held = self._objects.read(asked.request.obj)
            content, version = (None, 0) if held is None else (held.content, held.version)
            asked.session.bulk.keep(asked.msg, _READ_AGAIN)
            self._post(asked.session, answer_read(asked.request, content, version, self._mtu).pack(), asked.msg)
            return
        progress = self._written(asked.request, asked.session)
        body = WriteReply(progress.status, asked.request.obj, progress.held, progress.why).pack()
        asked.session.bulk.keep(asked.msg, body)
        self._post(asked.session, body, asked.msg)

    def _written(self, request: WriteBegin | WritePart | WriteCommit, session: Session) -> Progress:
        match request:
            case WritePart():
                begun_in, sha256 = self._begun.get(request.obj, (None, b""))
                if begun_in is not session or sha256[: len(request.sha256_start)] != request.sha256_start:
                    return Progress(
                        WriteStatus.NOT_BEGUN, why="this part belongs to no write of this session: begin it"
                    )
                return self._objects.write(request.obj, request.offset, request.data)
            case WriteCommit():
                progress = self._objects.commit(request.obj, request.size, request.sha256)
                self._look_at_calibration()
                return progress
            case WriteBegin():
                progress = self._objects.begin(request.obj, request.size, request.sha256)
                if progress.status is WriteStatus.OK:
                    self._begun[request.obj] = session, request.sha256
                return progress

    def _look_at_calibration(self) -> None:
        held = self._objects.read(ObjectNumber.CALIBRATION)
        version = None if held is None else held.version
        if version != self._calibration_version or version is None:
            self._calibration_version = version
            self._calibration_hash = calibration_hash(b"" if held is None else held.content)
