from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from host.counting import Counting, serve
from host.small_device import SmallDevice
from prismstereo.driver import StereoCamera
from prismstereo.events import CameraEvent, CameraState, EventKind
from prismstereo.requests import OutcomeUnknown
from prismstereo_device.link import Link, LinkLost, PortError
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.tcp import TcpServer
from prismstereo_device.serving.service import DeviceIdentity
from prismstereo_hw.errors import DeviceError


def wait_for(happened: Callable[[], object], seconds: float) -> float:
    """Wait until something holds and return how long that took; fails when it takes too long."""
    begin_s = time.monotonic()
    while not happened():
        assert time.monotonic() - begin_s < seconds, f"not within {seconds} s"
        time.sleep(0.005)
    return time.monotonic() - begin_s


def nowhere() -> Link:
    raise PortError("there is no other port")


def kinds(events: list[CameraEvent]) -> list[EventKind]:
    return [event.kind for event in events]


@pytest.fixture
def line() -> Iterator[tuple[SmallDevice, StereoCamera, list[CameraEvent]]]:
    """A small device and a camera on it that may be met anew, and what the camera tells."""
    device_end, host_end = loopback()
    events: list[CameraEvent] = []
    with device_end, SmallDevice(device_end) as device, StereoCamera(host_end, reopen=nowhere) as camera:
        camera.on_event.append(events.append)
        wait_for(lambda: device.pings, 1.0)
        yield device, camera, events


def test_a_silent_camera_is_called_in_the_same_session_and_runs_what_it_was_told_in_the_silence_once(line) -> None:
    device, camera, events = line
    device.mute.set()
    wait_for(lambda: camera.state is CameraState.SILENT, 1.5)
    answers: list[object] = []
    asker = threading.Thread(target=lambda: answers.append(camera.set("count", 5)))
    asker.start()
    time.sleep(0.1)
    device.mute.clear()
    asker.join(3.0)
    assert (answers, device.answering.ran) == ([5], [5])
    assert (kinds(events), device.sessions) == ([EventKind.SILENT, EventKind.HEARD], 1)
    assert (camera.state, camera.statistics.sessions) == (CameraState.CONNECTED, 1)


def test_a_line_with_nothing_to_say_is_never_called_silent(line) -> None:
    device, _, events = line
    time.sleep(0.9)
    assert (events, device.hellos) == ([], 1)


def test_a_camera_that_starts_anew_within_a_command_gets_a_new_session_and_does_not_run_it_again(line) -> None:
    device, camera, events = line
    answer = device.answering.answer

    def run_and_start_anew(channel: int, msg: int, body: bytes) -> None:
        answer(channel, msg, body)
        device.answering.answer = answer
        device.reboot(2)

    device.answering.answer = run_and_start_anew
    begin_s = time.monotonic()
    with pytest.raises(OutcomeUnknown, match="may or may not have been run"):
        camera.set("count", 1)
    assert time.monotonic() - begin_s < 2.0
    wait_for(lambda: EventKind.REBOOTED in kinds(events), 0.5)
    assert device.answering.ran == [1]
    assert camera.set("count", 2) == 2
    assert device.answering.ran == [1, 2]
    assert (camera.statistics.sessions, camera.statistics.reboots, camera.statistics.replugs) == (2, 1, 0)
    assert (camera.identity.boot_id, camera.state) == (2, CameraState.CONNECTED)


def test_without_leave_to_reconnect_a_camera_that_starts_anew_is_lost() -> None:
    device_end, host_end = loopback()
    with device_end, SmallDevice(device_end) as device, StereoCamera(host_end) as camera:
        device.reboot(2)
        with pytest.raises(LinkLost, match="loopback was lost after 0 frames: it has started anew"):
            list(camera)
        assert camera.state is CameraState.ENDED


def test_another_camera_on_the_same_port_is_an_error_by_name() -> None:
    device_end, host_end = loopback()
    second_end, other_end = loopback()
    with (
        second_end,
        SmallDevice(second_end, device_id=b"serial-2"),
        SmallDevice(device_end),
        StereoCamera(host_end, reopen=lambda: other_end) as camera,
    ):
        device_end.close()
        with pytest.raises(DeviceError, match="has the sensor 73657269616c2d32, it was 73657269616c2d31: open it"):
            list(camera)


class Dying(Link):
    """A line that carries nothing while it is dead."""

    def __init__(self, inner: Link) -> None:
        super().__init__(inner.name, inner.mtu)
        self._inner = inner
        self.dead = threading.Event()

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        return b"" if self.dead.is_set() else data

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        return len(data) if self.dead.is_set() else self._inner.write(data, timeout_s)

    def close(self) -> None:
        self._inner.close()


def test_a_line_that_was_dead_for_a_second_streams_again_within_one() -> None:
    device_end, host_end = loopback(mtu=512)
    dying = Dying(host_end)
    with device_end, serve(Counting(10_000, period_s=0.02), device_end), StereoCamera(dying) as camera:
        frames = iter(camera)
        next(frames)
        dying.dead.set()
        time.sleep(1.0)
        dying.dead.clear()
        before = camera.statistics.frames
        assert wait_for(lambda: camera.statistics.frames > before + 1, 3.0) < 1.0
        assert camera.statistics.sessions == 1
        assert next(frames).session == 1


@pytest.fixture
def port(tmp_path: Path) -> Path:
    """Where the camera's port is, whenever it is plugged in."""
    return tmp_path / "camera"


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else 0


def replug(port: Path, times: int) -> list[float]:
    """Pull the camera out and plug it in again, and return how long each time it took until it answered."""
    waits_s: list[float] = []
    before = threading.active_count(), descriptors()
    link = PtyPort(port)
    device = SmallDevice(link)
    with StereoCamera.open(str(port)) as camera:
        for count in range(1, times + 1):
            device.stop()
            link.close()
            wait_for(lambda: camera.state is CameraState.SEARCHING, 3.0)
            link = PtyPort(port)
            device = SmallDevice(link)
            waits_s.append(wait_for(lambda count=count: camera.statistics.replugs == count, 5.0))
            assert camera.set("count", count) == count
            assert threading.active_count() == before[0] + 3
        assert (camera.statistics.sessions, camera.statistics.reboots) == (times + 1, 0)
    device.stop()
    link.close()
    assert (threading.active_count(), descriptors()) == before
    return waits_s


def test_a_camera_that_is_replugged_comes_back_and_nothing_is_leaked(port: Path) -> None:
    assert max(replug(port, 3)) < 3.0


@pytest.mark.soak
def test_a_hundred_replugs_are_a_hundred_recoveries(port: Path) -> None:
    waits_s = sorted(replug(port, 100))
    print(f"\nreplugs 100, recoveries {len(waits_s)}, median {waits_s[50]:.3f} s, longest {waits_s[-1]:.3f} s")
    assert len(waits_s) == 100
    assert waits_s[-1] < 3.0


def test_the_iteration_goes_on_after_a_replug_and_frames_say_in_which_session_they_came(port: Path) -> None:
    with PtyPort(port) as link, serve(Counting(10_000, period_s=0.01), link):
        camera = StereoCamera.open(str(port))
        frames = iter(camera)
        first = next(frames)
    with (
        camera,
        PtyPort(port) as link,
        serve(Counting(10_000, period_s=0.01), link, identity=DeviceIdentity(b"serial-1", 78)),
    ):
        frame = next(frame for frame in frames if frame.session == 2)
        assert (first.session, frame.index < 1000) == (1, True)
        statistics = camera.statistics
    assert (statistics.sessions, statistics.reboots, statistics.replugs) == (2, 1, 1)
    assert statistics.lost < 1000  # numbers that begin anew are no gap


def test_a_tcp_camera_that_is_served_anew_is_found_again() -> None:
    with TcpServer() as server, SmallDevice(server):
        camera = StereoCamera.open(server.name)
        number = server.port
    with camera:
        wait_for(lambda: camera.state is CameraState.SEARCHING, 3.0)
        with TcpServer(port=number) as server, SmallDevice(server, boot_id=2):
            wait_for(lambda: camera.statistics.replugs == 1, 5.0)
            assert camera.get("rate_hz") is None


def test_a_camera_that_is_searched_for_can_be_closed_at_once(port: Path) -> None:
    with PtyPort(port) as link, SmallDevice(link):
        camera = StereoCamera.open(str(port))
    wait_for(lambda: camera.state is CameraState.SEARCHING, 3.0)
    begin_s = time.monotonic()
    camera.close()
    assert time.monotonic() - begin_s < 1.0
    assert camera.state is CameraState.ENDED
    with pytest.raises(LinkLost, match="was closed: open it again"):
        camera.get("rate_hz")
