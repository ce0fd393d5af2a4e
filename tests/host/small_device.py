"""A camera of the least kind, for the tests of the desk: it meets, answers pings, counts commands, keeps objects."""

from __future__ import annotations

import threading
import time

from prismstereo_device.framing import Deframer, Framer, Packet
from prismstereo_device.link import Link, LinkLost
from prismstereo_device.objects import Held, Progress, WriteStatus
from prismstereo_device.protocol import (
    AnsweredRequests,
    Capability,
    Command,
    CommandReply,
    CommandStatus,
    FrameAck,
    Hello,
    HelloReply,
    Ping,
    Pong,
    ReadRequest,
    Verdict,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    answer_read,
    calibration_hash,
    read_bulk_request,
    read_control,
)
from prismstereo_device.wire import FIRST, LAST, REPLY, Channel

ABLE = Capability.COMMANDS | Capability.WRITE | Capability.STILL


class Answering:
    """Answers commands and object requests at most once per session, as bytes to bytes; `ran` are the values that were run."""

    def __init__(self, objects: dict[int, Held] | None = None, mtu: int = 4096) -> None:
        self.ran: list[object] = []
        self.objects = objects or {}
        self.committed: dict[int, bytes] = {}
        self.mtu = mtu
        self._commands, self._bulk = AnsweredRequests(), AnsweredRequests()
        self._staged: dict[int, tuple[bytes, bytearray]] = {}

    def begin_session(self) -> None:
        self._commands.clear()
        self._bulk.clear()

    def answer(self, channel: int, msg: int, body: bytes) -> bytes | None:
        known = self._commands if channel == Channel.CMD else self._bulk
        verdict = known.answer_to(msg)
        if isinstance(verdict, bytes):
            return verdict
        if verdict is not Verdict.NEW:
            return CommandReply(CommandStatus.STALE, why="too old").pack() if channel == Channel.CMD else None
        reply = self.command(Command.unpack(body)).pack() if channel == Channel.CMD else self._object(body)
        known.keep(msg, reply)
        return reply

    def command(self, command: Command) -> CommandReply:
        self.ran.append(command.value)
        if command.name == "unheard_of":
            return CommandReply(CommandStatus.UNKNOWN, why="no setting 'unheard_of': ask for identity")
        if command.name == "broken":
            return CommandReply(CommandStatus.FAILED, why="the sensor did not answer")
        return CommandReply(CommandStatus.OK, command.value)

    def _object(self, body: bytes) -> bytes:
        request = read_bulk_request(body)
        if isinstance(request, ReadRequest):
            held = self.objects.get(request.obj)
            version, content = (held.version, held.content) if held else (0, None)
            return answer_read(request, content, version, self.mtu).pack()
        progress = self._written(request)
        return WriteReply(progress.status, request.obj, progress.held, progress.why).pack()

    def _written(self, request: WriteBegin | WritePart | WriteCommit) -> Progress:
        sha256, content = self._staged.get(request.obj, (b"", bytearray()))
        if isinstance(request, WritePart):
            if sha256[:4] != request.sha256_start:
                return Progress(WriteStatus.NOT_BEGUN)
            if request.offset > len(content):
                return Progress(WriteStatus.GAP, len(content))
            content += request.data[len(content) - request.offset :]
            return Progress(WriteStatus.OK, len(content))
        if isinstance(request, WriteCommit):
            if sha256 != request.sha256:
                done = request.obj in self.committed
                return Progress(WriteStatus.OK if done else WriteStatus.NOT_BEGUN)
            self.committed[request.obj] = bytes(content)
            del self._staged[request.obj]
            return Progress(WriteStatus.OK, len(content))
        if sha256 != request.sha256:
            self._staged[request.obj] = (request.sha256, content := bytearray())
        return Progress(WriteStatus.OK, len(content))


class SmallDevice:
    """A thread that serves one link until it is stopped or the link is closed; `mute` makes it deaf and dumb."""

    def __init__(
        self, link: Link, boot_id: int = 1, *, device_id: bytes = b"serial-1", answering: Answering | None = None
    ):
        self.answering = answering or Answering()
        self.mute = threading.Event()
        self.hellos = self.sessions = self.pings = 0
        self.acks: list[FrameAck] = []
        self._link = link
        self._boot_id = boot_id
        self._device_id = device_id
        self._nonce = 0
        self._deframer, self._framer = Deframer(), Framer(0)
        self._sending = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def send(
        self,
        channel: Channel,
        payload: bytes,
        flags: int = FIRST | LAST,
        msg: int = 0,
        frag: int = 0,
        *,
        lost: bool = False,
    ) -> None:
        with self._sending:
            data = self._framer.encode(channel, payload, flags=flags, msg=msg, frag=frag)
            if not lost:
                self._link.write(data)

    def reboot(self, boot_id: int) -> None:
        """Forget everything, as a device does that starts anew."""
        with self._sending:
            self._boot_id, self._nonce = boot_id, 0
            self._deframer.adopt(0)
            self.answering.begin_session()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()

    def __enter__(self) -> SmallDevice:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                data = self._link.read(0.02)
                for packet in self._deframer.feed(data) if not self.mute.is_set() else ():
                    self._handle(packet)
        except LinkLost:
            return

    def _handle(self, packet: Packet) -> None:
        if packet.channel == Channel.HELLO:
            self._meet(Hello.unpack(packet.payload))
        elif packet.channel == Channel.CTRL:
            message = read_control(packet.payload)
            if isinstance(message, Ping):
                self.pings += 1
                now_us = time.monotonic_ns() // 1000
                self.send(
                    Channel.CTRL, Pong(message.t_host_us, now_us, now_us).pack(), FIRST | LAST | REPLY, packet.msg
                )
            elif isinstance(message, FrameAck):
                self.acks.append(message)
        elif packet.channel in (Channel.CMD, Channel.BULK):
            reply = self.answering.answer(packet.channel, packet.msg, packet.payload)
            if reply is not None:
                self.send(Channel(packet.channel), reply, FIRST | LAST | REPLY, packet.msg)

    def _meet(self, hello: Hello) -> None:
        self.hellos += 1
        if hello.nonce != self._nonce:
            self.sessions += 1
            self._nonce = hello.nonce
            self._deframer.adopt(hello.nonce)
            self._framer = Framer(hello.nonce)
            self.answering.begin_session()
        held = self.answering.objects.get(1)
        named = calibration_hash(held.content if held else b"")
        reply = HelloReply(1, hello.nonce, self._link.mtu, self._device_id, self._boot_id, named, ABLE)
        self.send(Channel.HELLO, reply.pack(), FIRST | LAST | REPLY)
