from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from host.counting import CALIBRATION, Counting, disparity, serve
from host.small_device import SmallDevice
from prismstereo.driver import StereoCamera
from prismstereo_device.link import Link, LinkLost
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.protocol import fragment
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DeviceError


@pytest.fixture
def pty() -> Iterator[Link]:
    with PtyPort() as link:
        yield link


def test_a_camera_that_is_pulled_out_is_an_error_after_the_frames_that_came() -> None:
    port = PtyPort()
    source = Counting(5, then="compute")
    service = serve(source, port, lossless=True)
    service.start()
    with StereoCamera.open(port.name, keep_all=True, reconnect=False) as camera:
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
    service = serve(Counting(1000), device, lossless=True)
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
    with device, serve(source, device), StereoCamera(host, silence_s=0.8) as camera:
        frames = iter(camera)
        assert next(frames).index == 0
        time.sleep(1.1)
        source.let_go.set()
        assert list(frames) == []


def test_a_source_that_breaks_is_an_error_after_its_frames(pty: Link) -> None:
    with (
        serve(Counting(3, then="break"), pty, lossless=True),
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
        serve(Counting(40), device, lossless=True),
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
        sent = disparity(frame.index % 16).disparity_px
        lost = np.isnan(seen) & ~np.isnan(sent)
        np.testing.assert_array_equal(seen[~lost], sent[~lost])
        rows = np.flatnonzero(lost.any(1))
        assert len(set(rows // 16)) <= frame.missing_stripes
        assert frame.partial == bool(frame.missing_stripes)


def test_the_camera_is_told_what_share_of_its_packets_is_lost() -> None:
    device_end, host_end = loopback()
    with device_end, SmallDevice(device_end) as device, StereoCamera(host_end) as camera:
        deadline = time.monotonic() + 5
        for frame in range(60):
            packets = fragment(disparity(1), frame=frame, timestamp_us=frame, calibration_hash=bytes(8), mtu=512)
            for number, (flags, frag, payload) in enumerate(packets):
                device.send(Channel.DISP, payload, flags, frame, frag, lost=number % 5 == 4)
        while not device.acks or device.acks[-1].newest_frame != 59 or not device.acks[-1].loss_permille:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert 120 <= device.acks[-1].loss_permille <= 220
        assert camera.statistics.partial > 50
