from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from host.counting import CALIBRATION, Counting, disparity, serve
from prismstereo.driver import StereoCamera
from prismstereo_device.link import Link, LinkLost, PortError
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.tcp import TcpServer
from prismstereo_device.protocol import calibration_hash
from prismstereo_hw.errors import DataError


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
        serve(Counting(40), port, lossless=True) as service,
        StereoCamera.open(port.name, keep_all=True) as camera,
    ):
        frames = list(camera)
        assert list(camera) == []
        statistics = camera.statistics
        assert service.statistics.sent == 40
    assert [frame.index for frame in frames] == list(range(40))
    assert [frame.timestamp_us for frame in frames] == [1000 * number for number in range(1, 41)]
    for frame in frames:
        sent = disparity(frame.index % 16)
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
        serve(source, pty, lossless=True),
        StereoCamera.open(pty.name, queue_frames=2, keep_all=True) as camera,
    ):
        time.sleep(0.5)
        assert camera.statistics.frames <= 2 + 3
        assert [frame.index for frame in camera] == list(range(30))
        assert camera.statistics.not_taken == 0


def test_a_slow_reader_loses_the_oldest_frames_and_they_are_counted(pty: Link) -> None:
    with (
        serve(Counting(30), pty, lossless=True) as service,
        StereoCamera.open(pty.name, queue_frames=4) as camera,
    ):
        deadline = time.monotonic() + 10
        while not service.ended or camera.statistics.frames < 30:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert [frame.index for frame in camera] == [26, 27, 28, 29]
        assert camera.statistics.not_taken == 26


def test_the_camera_says_who_it_is_and_hands_over_its_calibration(port: Link) -> None:
    with serve(Counting(0), port), StereoCamera.open(port.name) as camera:
        assert camera.identity.device_id == b"serial-1"
        assert (camera.identity.boot_id, camera.identity.mtu, camera.identity.version) == (77, 4096, 1)
        assert camera.identity.calibration_hash == calibration_hash(CALIBRATION)
        assert camera.calibration_bytes == CALIBRATION
        assert camera.calibration_bytes is camera.calibration_bytes


def test_the_calibration_is_fetched_while_frames_arrive(pty: Link) -> None:
    with (
        serve(Counting(60, period_s=0.005), pty, lossless=True),
        StereoCamera.open(pty.name, keep_all=True) as camera,
    ):
        frames = iter(camera)
        assert next(frames).index == 0
        assert camera.calibration_bytes == CALIBRATION
        assert [frame.index for frame in frames] == list(range(1, 60))


def test_a_camera_without_a_calibration_says_so(pty: Link) -> None:
    with (
        serve(Counting(0), pty, calibration=b""),
        StereoCamera.open(pty.name) as camera,
        pytest.raises(DataError, match="holds no calibration: calibrate it"),
    ):
        _ = camera.calibration_bytes


def test_bytes_that_are_no_calibration_are_refused_by_name(pty: Link) -> None:
    with (
        serve(Counting(0), pty),
        StereoCamera.open(pty.name) as camera,
        pytest.raises(DataError, match="flash"),
    ):
        _ = camera.calibration


def test_a_host_that_restarts_goes_on_with_the_stream(port: Link) -> None:
    with serve(Counting(10_000, period_s=0.003), port) as service:
        last = -1
        for _ in range(3):
            with StereoCamera.open(port.name) as camera:
                for frame, _ in zip(camera, range(4), strict=False):
                    assert frame.index > last
                    last = frame.index
        assert service.statistics.sessions == 3
        assert service.failure is None


def test_after_the_end_of_the_stream_a_new_host_is_told_at_once(pty: Link) -> None:
    with serve(Counting(2), pty, lossless=True):
        with StereoCamera.open(pty.name) as camera:
            assert len(list(camera)) == 2
        with StereoCamera.open(pty.name) as camera:
            assert list(camera) == []


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
    with serve(source, pty):
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


def test_frame_numbers_wrap_without_a_gap(pty: Link) -> None:
    first = (1 << 32) - 5
    with serve(Counting(10, first=first), pty, lossless=True), StereoCamera.open(pty.name, keep_all=True) as camera:
        assert [frame.index for frame in camera] == [(first + number) & 0xFFFF_FFFF for number in range(10)]
        assert camera.statistics.lost == 0


def test_the_cameras_clock_is_told_with_a_bound_that_holds(pty: Link) -> None:
    with serve(Counting(60, period_s=0.005), pty), StereoCamera.open(pty.name) as camera:
        for _ in camera:
            pass
        mapping = camera.clock
    assert mapping is not None  # both ends have the same clock here: the true offset is none
    assert abs(mapping.host_time_us(mapping.at_device_us) - mapping.at_device_us) <= mapping.bound_us + 1
