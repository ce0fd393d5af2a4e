from __future__ import annotations

import threading
import time

import pytest

from prismstereo.driver import StereoCamera
from prismstereo_device.framing import Deframer, Framer
from prismstereo_device.link import Link, LinkLost
from prismstereo_device.link.loopback import loopback
from prismstereo_device.protocol import Hello, HelloKind, HelloReply, Ping, Pong, read_control
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DeviceError


class Talker:
    """A camera by hand: takes one hello, answers by `make_body` of its nonce, then says and hears what `then` wants."""

    def __init__(self, link: Link, make_body, then=lambda talker: None) -> None:
        self.link = link
        self.nonce = 0
        self._make_body = make_body
        self._then = then
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        (packet,) = Deframer().feed(self.link.read(5.0))
        self.nonce = Hello.unpack(packet.payload).nonce
        self.link.write(Framer(0).encode(Channel.HELLO, self._make_body(self.nonce)))
        self._then(self)


@pytest.mark.parametrize(
    ("answer", "theirs"),
    [
        (lambda nonce: Hello(nonce, 2, 3, HelloKind.REFUSE).pack(), "2 to 3"),
        (lambda nonce: HelloReply(9, nonce, 512, b"serial-1", 1, bytes(8)).pack(), "9 to 9"),
    ],
    ids=["refused", "answered in another version"],
)
def test_another_version_is_one_error_that_names_both_ranges(answer, theirs: str) -> None:
    device, host = loopback()
    with device, host:
        talker = Talker(device, answer)
        with pytest.raises(DeviceError, match=rf"versions {theirs}, this program 1 to 1: update the older") as caught:
            StereoCamera(host, timeout_s=2.0)
        talker.thread.join()
    assert not isinstance(caught.value, LinkLost)


@pytest.mark.parametrize("body", [b"", b"\x02junk", Hello(12345).pack(), bytes(33)])
def test_an_answer_to_somebody_else_is_not_taken(body: bytes) -> None:
    device, host = loopback()
    with device, host:
        talker = Talker(device, lambda nonce: body)
        with pytest.raises(LinkLost, match=r"answered a hello within 0\.3 s \(\d+ bytes heard\)"):
            StereoCamera(host, timeout_s=0.3)
        talker.thread.join()


def test_a_ping_of_the_camera_is_answered() -> None:
    def ping(talker: Talker) -> None:
        talker.link.write(Framer(talker.nonce).encode(Channel.CTRL, Ping(5).pack()))
        deframer, deadline = Deframer(talker.nonce), time.monotonic() + 5
        while time.monotonic() < deadline and not answers:
            for packet in deframer.feed(talker.link.read(0.1)):
                message = read_control(packet.payload) if packet.channel == Channel.CTRL else None
                if isinstance(message, Pong):
                    answers.append(message.t_host_us)

    answers: list[int] = []
    device, host = loopback()
    with device:
        talker = Talker(device, lambda nonce: HelloReply(1, nonce, 512, b"serial-1", 1, bytes(8)).pack(), ping)
        with StereoCamera(host, timeout_s=2.0):
            talker.thread.join()
    assert answers == [5]
