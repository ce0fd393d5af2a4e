from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from prismstereo.driver import StereoCamera
from prismstereo.reading import ObjectReader
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Deframer, Framer, Packet
from prismstereo_device.link import Link, LinkLost, PortError
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.tcp import TcpServer
from prismstereo_device.protocol import (
    Hello,
    HelloKind,
    HelloReply,
    Ping,
    Pong,
    ReadRequest,
    answer_read,
    calibration_hash,
    read_control,
)
from prismstereo_device.service import DeviceIdentity, ProducedFrame, Service
from prismstereo_device.wire import FIRST, LAST, REPLY, Channel, WireError
from prismstereo_hw.errors import DataError, DeviceError

IDENTITY = DeviceIdentity(b"serial-1", 77)
CALIBRATION = bytes(range(256)) * 60


def disparity(seed: int, height: int = 96, width: int = 80) -> DisparityMap:
    steps = np.random.default_rng(seed).integers(0, 4000, (height, width), dtype=np.uint16)
    return DisparityMap.from_fixed_point(steps, DisparityWindow(256, -1.0, 5000.0))


class Counting:
    """A source of numbered frames; after the last one it ends, or breaks, or computes on until it is let go."""

    def __init__(self, frames: int, *, period_s: float = 0.0, then: str = "end") -> None:
        self.let_go = threading.Event()
        self._frames = frames
        self._made = 0
        self._period_s = period_s
        self._then = then

    def read(self) -> ProducedFrame | None:
        time.sleep(self._period_s)
        if self._made < self._frames:
            self._made += 1
            return ProducedFrame(self._made - 1, self._made * 1000, 120, disparity(self._made - 1))
        if self._then == "break":
            raise DeviceError("the sensor was pulled out")
        if self._then == "compute":
            self.let_go.wait(20)
        return None


@pytest.fixture(params=["pty", "tcp"])
def port(request: pytest.FixtureRequest) -> Iterator[Link]:
    """The camera's end of a line that a host can open by name."""
    with PtyPort() if request.param == "pty" else TcpServer() as link:
        yield link


@pytest.fixture
def pty() -> Iterator[Link]:
    with PtyPort() as link:
        yield link


def test_every_frame_sent_is_received_bit_by_bit_and_the_iteration_ends(port: Link) -> None:
    with (
        Service(Counting(40), port, IDENTITY, CALIBRATION, lossless=True) as service,
        StereoCamera.open(port.name, keep_all=True) as camera,
    ):
        frames = list(camera)
        assert list(camera) == []
        statistics = camera.statistics
        assert service.statistics.sent == 40
    assert [frame.index for frame in frames] == list(range(40))
    assert [frame.timestamp_us for frame in frames] == [1000 * number for number in range(1, 41)]
    for frame in frames:
        sent = disparity(frame.index)
        np.testing.assert_array_equal(frame.disparity.disparity_px, sent.disparity_px)
        assert frame.disparity.window == sent.window
        assert (frame.lens_position, frame.partial) == (120, False)
        assert frame.calibration_hash == calibration_hash(CALIBRATION)[:4]
    assert (statistics.frames, statistics.partial, statistics.lost, statistics.not_taken) == (40, 0, 0, 0)
    assert (statistics.line.bad, statistics.line.oversize, statistics.malformed) == (0, 0, 0)
    assert statistics.health is not None
    assert statistics.health.frames_sent == 40
    assert statistics.round_trip_us is not None
    assert 0 < statistics.round_trip_us < 5_000_000


def test_a_slow_reader_that_keeps_all_makes_the_camera_wait(pty: Link) -> None:
    source = Counting(30)
    with (
        Service(source, pty, IDENTITY, lossless=True),
        StereoCamera.open(pty.name, queue_frames=2, keep_all=True) as camera,
    ):
        time.sleep(0.5)
        assert camera.statistics.frames <= 2 + 3
        assert [frame.index for frame in camera] == list(range(30))
        assert camera.statistics.not_taken == 0


def test_a_slow_reader_loses_the_oldest_frames_and_they_are_counted(pty: Link) -> None:
    with (
        Service(Counting(30), pty, IDENTITY, lossless=True) as service,
        StereoCamera.open(pty.name, queue_frames=4) as camera,
    ):
        deadline = time.monotonic() + 10
        while not service.ended or camera.statistics.frames < 30:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert [frame.index for frame in camera] == [26, 27, 28, 29]
        assert camera.statistics.not_taken == 26


def test_the_camera_says_who_it_is_and_hands_over_its_calibration(port: Link) -> None:
    with Service(Counting(0), port, IDENTITY, CALIBRATION), StereoCamera.open(port.name) as camera:
        assert camera.identity.device_id == b"serial-1"
        assert (camera.identity.boot_id, camera.identity.mtu, camera.identity.version) == (77, 4096, 1)
        assert camera.identity.calibration_hash == calibration_hash(CALIBRATION)
        assert camera.calibration_bytes == CALIBRATION
        assert camera.calibration_bytes is camera.calibration_bytes


def test_the_calibration_is_fetched_while_frames_arrive(pty: Link) -> None:
    with (
        Service(Counting(60, period_s=0.005), pty, IDENTITY, CALIBRATION, lossless=True),
        StereoCamera.open(pty.name, keep_all=True) as camera,
    ):
        frames = iter(camera)
        assert next(frames).index == 0
        assert camera.calibration_bytes == CALIBRATION
        assert [frame.index for frame in frames] == list(range(1, 60))


def test_a_camera_without_a_calibration_says_so(pty: Link) -> None:
    with (
        Service(Counting(0), pty, IDENTITY),
        StereoCamera.open(pty.name) as camera,
        pytest.raises(DataError, match="holds no calibration: calibrate it"),
    ):
        _ = camera.calibration_bytes


def test_bytes_that_are_no_calibration_are_refused_by_name(pty: Link) -> None:
    with (
        Service(Counting(0), pty, IDENTITY, CALIBRATION),
        StereoCamera.open(pty.name) as camera,
        pytest.raises(DataError, match="flash"),
    ):
        _ = camera.calibration


def test_a_camera_that_is_pulled_out_is_an_error_after_the_frames_that_came() -> None:
    port = PtyPort()
    source = Counting(5, then="compute")
    service = Service(source, port, IDENTITY, lossless=True)
    service.start()
    with StereoCamera.open(port.name, keep_all=True) as camera:
        frames = iter(camera)
        indices = [next(frames).index for _ in range(5)]
        source.let_go.set()
        service.stop()
        port.close()
        with pytest.raises(LinkLost, match=rf"{port.name} was lost after 5 frames"):
            next(frames)
        with pytest.raises(LinkLost, match="was lost"):
            list(camera)
    assert indices == [0, 1, 2, 3, 4]


def test_a_camera_that_falls_silent_in_a_frame_is_an_error_after_what_came_of_it() -> None:
    device, host = loopback(capacity=20_000)
    service = Service(Counting(1000), device, IDENTITY, lossless=True)
    service.start()
    with device, StereoCamera(host, silence_s=0.4, keep_all=True) as camera:
        received = [next(iter(camera)).index]
        service.stop()
        begin = time.monotonic()
        with pytest.raises(LinkLost, match=r"loopback was lost after \d+ frames: nothing was heard for 0.4 s"):
            received.extend(frame.index for frame in camera)
        assert time.monotonic() - begin < 2.0
        assert camera.statistics.frames == len(received)
    assert received == list(range(len(received)))


def test_a_camera_whose_computer_is_busy_is_not_lost() -> None:
    device, host = loopback()
    source = Counting(1, then="compute")
    with device, Service(source, device, IDENTITY), StereoCamera(host, silence_s=1.5) as camera:
        frames = iter(camera)
        assert next(frames).index == 0
        time.sleep(2.0)
        source.let_go.set()
        assert list(frames) == []


def test_a_source_that_breaks_is_an_error_after_its_frames(pty: Link) -> None:
    with (
        Service(Counting(3, then="break"), pty, IDENTITY, lossless=True),
        StereoCamera.open(pty.name, keep_all=True) as camera,
    ):
        frames = iter(camera)
        assert [next(frames).index for _ in range(3)] == [0, 1, 2]
        with pytest.raises(DeviceError, match="broke after 3 frames"):
            next(frames)


class Noisy(Link):
    """A line that adds bytes of its own, and swaps some, on the way to the host."""

    def __init__(self, inner: Link, garbage_each: int, flips: float) -> None:
        super().__init__(inner.name, inner.mtu)
        self._inner = inner
        self._each = garbage_each
        self._flips = flips
        self._random = np.random.default_rng(4)
        self._reads = 0

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        self._reads += bool(data)
        if data and self._each and self._reads % self._each == 0:
            return self._random.bytes(200) + data
        if data and self._flips:
            array = np.frombuffer(data, np.uint8)
            return np.where(self._random.random(array.size) < self._flips, array ^ 0x10, array).tobytes()
        return data

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        return self._inner.write(data, timeout_s)

    def close(self) -> None:
        self._inner.close()


@pytest.mark.parametrize(("garbage_each", "flips"), [(7, 0.0), (0, 1e-5)], ids=["garbage", "flipped bits"])
def test_frames_go_on_over_a_bad_line_and_what_is_wrong_is_counted(garbage_each: int, flips: float) -> None:
    device, host = loopback(mtu=1024)
    with (
        device,
        Service(Counting(40), device, IDENTITY, CALIBRATION, lossless=True),
        StereoCamera(Noisy(host, garbage_each, flips), keep_all=True) as camera,
    ):
        frames = list(camera)
        assert camera.calibration_bytes == CALIBRATION
        statistics = camera.statistics
    assert statistics.line.bad + statistics.line.oversize > 0
    assert statistics.partial > 0 or statistics.lost > 0
    assert statistics.frames + statistics.lost >= 38  # a gap at either end is no gap
    for frame in frames:
        seen = frame.disparity.disparity_px
        sent = disparity(frame.index).disparity_px
        lost = np.isnan(seen) & ~np.isnan(sent)
        np.testing.assert_array_equal(seen[~lost], sent[~lost])
        rows = np.flatnonzero(lost.any(1))
        assert len(set(rows // 16)) <= frame.missing_stripes
        assert frame.partial == bool(frame.missing_stripes)


def test_a_host_that_restarts_goes_on_with_the_stream(port: Link) -> None:
    with Service(Counting(10_000, period_s=0.003), port, IDENTITY) as service:
        last = -1
        for _ in range(3):
            with StereoCamera.open(port.name) as camera:
                for frame, _ in zip(camera, range(4), strict=False):
                    assert frame.index > last
                    last = frame.index
        assert service.statistics.sessions == 3
        assert service.failure is None


def test_after_the_end_of_the_stream_a_new_host_is_told_at_once(pty: Link) -> None:
    with Service(Counting(2), pty, IDENTITY, lossless=True):
        with StereoCamera.open(pty.name) as camera:
            assert len(list(camera)) == 2
        with StereoCamera.open(pty.name) as camera:
            assert list(camera) == []


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


def test_a_port_where_nobody_answers_is_given_back(pty: Link) -> None:
    for _ in range(2):  # a port that was kept would be busy the second time
        with pytest.raises(LinkLost, match=r"nothing on .* answered a hello"):
            StereoCamera.open(pty.name, timeout_s=0.1)


@pytest.mark.parametrize("port", ["/dev/ttyNOWHERE", "tcp:127.0.0.1:1", "tcp:nowhere"])
def test_a_port_that_leads_nowhere_is_an_error(port: str) -> None:
    with pytest.raises(PortError, match=r": (the ports of|this computer has|check the address|write tcp)"):
        StereoCamera.open(port, timeout_s=0.5)


def test_closing_ends_an_iteration_in_another_thread(pty: Link) -> None:
    source = Counting(1, then="compute")
    with Service(source, pty, IDENTITY):
        camera = StereoCamera.open(pty.name)
        counts: list[int] = []
        reader = threading.Thread(target=lambda: counts.append(len(list(camera))))
        reader.start()
        time.sleep(0.2)
        camera.close()
        camera.close()
        reader.join(5)
        assert counts == [1]
        source.let_go.set()


class Shelf:
    """An object and its reader, with a line between them that loses every `lose`-th request."""

    def __init__(self, content: bytes, lose: int = 0) -> None:
        self.content = content
        self.version = 1
        self.asked = 0
        self._lose = lose
        self.reader = ObjectReader(self._send)

    def _send(self, channel: Channel, payload: bytes, flags: int = 0, msg: int = 0) -> None:
        assert channel is Channel.BULK
        self.asked += 1
        if self._lose and self.asked % self._lose == 0:
            return
        reply = answer_read(ReadRequest.unpack(payload), self.content, self.version, 240)
        self.reader.answer(Packet(channel, reply.pack(), FIRST | LAST | REPLY, msg=msg))
        self.reader.answer(Packet(channel, reply.pack(), FIRST | LAST | REPLY, msg=msg))  # and once more, late


def test_an_object_is_read_over_a_line_that_loses_requests() -> None:
    shelf = Shelf(CALIBRATION[:1000], lose=3)
    assert shelf.reader.read(1, 1000, "the line") == CALIBRATION[:1000]
    assert shelf.asked == 7  # five parts, two requests lost


def test_an_object_larger_than_its_limit_is_refused() -> None:
    with pytest.raises(WireError, match="1001 bytes: at most 1000"):
        Shelf(bytes(1001)).reader.read(1, 1000, "the line")


def test_an_object_that_changes_while_it_is_read_is_read_anew() -> None:
    class Changing(Shelf):
        def _send(self, channel: Channel, payload: bytes, flags: int = 0, msg: int = 0) -> None:
            if self.asked == 1:
                self.content, self.version = b"b" * 400, 2
            super()._send(channel, payload, flags, msg)

    assert Changing(b"a" * 500).reader.read(1, 1000, "the line") == b"b" * 400


def test_a_reader_that_is_told_of_the_end_waits_no_longer() -> None:
    shelf = Shelf(b"a" * 500, lose=1)
    threading.Timer(0.1, shelf.reader.end).start()
    begin = time.monotonic()
    with pytest.raises(LinkLost, match="the line did not give bytes 0"):
        shelf.reader.read(1, 1000, "the line")
    assert time.monotonic() - begin < 1.0
