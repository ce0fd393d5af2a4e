"""Both ends of a service under test: sources of numbered frames, and a host by hand that says what it is told to say."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Deframer, Framer, Packet
from prismstereo_device.link import Link
from prismstereo_device.protocol import (
    Capability,
    FrameAck,
    FrameAssembler,
    Health,
    Hello,
    HelloReply,
    PictureAssembler,
    ReceivedFrame,
    ReceivedPicture,
    read_hello,
)
from prismstereo_device.serving.service import DeviceIdentity
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DeviceError

IDENTITY = DeviceIdentity(b"serial-1", 77)
PICTURES = (Channel.IMG, Channel.RAW, Channel.REASON, Channel.CONFIDENCE)


def disparity(seed: int = 0, height: int = 64, width: int = 80) -> DisparityMap:
    """Noise, unlike at every seed: no codec makes it small."""
    steps = np.random.default_rng(seed).integers(0, 4000, (height, width), dtype=np.uint16)
    return DisparityMap.from_fixed_point(steps, DisparityWindow(256, -1.0, 5000.0))


def smooth(seed: int, height: int, width: int) -> DisparityMap:
    """A slanted, rippled surface with sub-pixel noise and holes: some 1.5 bits a pixel, as what a matcher finds."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    steps = 800 + 1.2 * rows + 0.4 * columns + 60 * np.sin(columns / 50) + rng.normal(0, 0.7, (height, width))
    holes = np.sin(rows / 23) * np.cos(columns / 31) > 0.9
    fixed = np.where(holes, 0, np.rint(steps)).astype(np.uint16)
    return DisparityMap.from_fixed_point(fixed, DisparityWindow(256, -1.0, 5000.0))


class Counting:
    """A source of numbered frames, as fast as they are asked for, or one each `period_s`; `first` is the first number."""

    def __init__(self, frames: int, period_s: float = 0.0, first: int = 0) -> None:
        self.made = 0
        self._frames = frames
        self._period_s = period_s
        self._first = first

    def read(self) -> ProducedFrame | None:
        if self.made == self._frames:
            return None
        time.sleep(self._period_s)
        self.made += 1
        return self.frame(self.made - 1)

    def frame(self, number: int) -> ProducedFrame:
        return ProducedFrame(self._first + number, (number + 1) * 1000, None, disparity(number))


class Repeating(Counting):
    """The same frame with other numbers: what the frame is made of costs nothing."""

    def __init__(self, frame: ProducedFrame, frames: int, period_s: float = 0.0, first: int = 0) -> None:
        super().__init__(frames, period_s, first)
        self._frame = frame

    def frame(self, number: int) -> ProducedFrame:
        return replace(self._frame, index=self._first + number, timestamp_us=(number + 1) * 1000)


class Blocking(Counting):
    """A source that computes until it is let go."""

    def __init__(self) -> None:
        super().__init__(0)
        self.go = threading.Event()

    def read(self) -> None:
        self.go.wait(20)


class Breaking(Counting):
    """A source that fails after its frames."""

    def read(self) -> ProducedFrame | None:
        if self.made == self._frames:
            raise DeviceError("the sensor was pulled out")
        return super().read()


class Host:
    """The other end, by hand: says what it is told to say and keeps what it hears."""

    def __init__(self, link: Link, nonce: int = 5, capabilities: Capability = Capability.COMPACT) -> None:
        self.link = link
        self.nonce = nonce
        self.capabilities = capabilities
        self.framer = Framer(nonce)
        self.deframer = Deframer(nonce)
        self.assembler = FrameAssembler()
        self.picture_assembler = PictureAssembler()
        self.heard: list[Packet] = []
        self.frames: list[ReceivedFrame] = []
        self.pictures: list[ReceivedPicture] = []

    def say(self, channel: Channel, body: bytes, msg: int = 0) -> None:
        self.link.write(self.framer.encode(channel, body, msg=msg))

    def hear(self) -> list[Packet]:
        packets = self.deframer.feed(self.link.read(0.02))
        self.heard += packets
        for packet in packets:
            if packet.channel == Channel.DISP:
                self.frames += self.assembler.feed(packet)
            elif packet.channel in PICTURES:
                self.pictures += self.picture_assembler.feed(packet)
        return packets

    def acknowledge(self, room: int = 3, loss_permille: int = 0) -> None:
        newest = self.assembler.newest_started
        if newest is not None:
            self.say(Channel.CTRL, FrameAck(newest, room, loss_permille).pack())

    def hear_until(self, found: Callable[[], bool], timeout_s: float = 5.0, *, acknowledge: bool = False) -> None:
        deadline = time.monotonic() + timeout_s
        while not found():
            assert time.monotonic() < deadline, "the service did not say it in time"
            self.hear()
            if acknowledge:
                self.acknowledge()

    def hear_next(self, channel: Channel) -> Packet:
        self.heard.clear()
        self.hear_until(lambda: bool(self.on(channel)))
        return next(packet for packet in self.heard if packet.channel == channel)

    def on(self, channel: Channel) -> list[bytes]:
        return [packet.payload for packet in self.heard if packet.channel == channel]

    def hear_answer(self, channel: Channel, msg: int) -> bytes:
        """Wait for the answer with this number."""

        def answers() -> list[bytes]:
            return [packet.payload for packet in self.heard if packet.channel == channel and packet.msg == msg]

        self.hear_until(lambda: bool(answers()))
        return answers()[-1]

    def ask(self, channel: Channel, body: bytes, msg: int) -> bytes:
        """Send a request and give the answer that has its number; what was heard before is forgotten."""
        self.heard.clear()
        self.say(channel, body, msg)
        return self.hear_answer(channel, msg)

    def meet(self) -> HelloReply:
        self.say(Channel.HELLO, Hello(self.nonce, capabilities=self.capabilities).pack())
        self.hear_until(lambda: bool(self.on(Channel.HELLO)))
        reply = read_hello(self.on(Channel.HELLO)[-1])
        assert isinstance(reply, HelloReply)
        return reply

    def health(self) -> list[Health]:
        return [Health.unpack(body) for body in self.on(Channel.HEALTH)]
