"""`prismstereo.open`: a serial port, TCP, a recording, the simulated sensor; and the example that the README shows."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import prismstereo
from host.calibrated_source import Wall, eventually
from prismstereo.recording import Recorder
from prismstereo_calibration.model import Calibration
from prismstereo_device.link import Link, LinkLost, PortError
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.link.tcp import TcpServer
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import Rig

EXAMPLE = Path(__file__).parents[2] / "host" / "examples" / "obstacle.py"


def served(wall: Wall, link: Link, *, lossless: bool = False) -> Service:
    objects = FixedObjects({ObjectNumber.CALIBRATION: wall.content})
    return Service(wall, link, DeviceIdentity(b"serial-1", 7), objects=objects, lossless=lossless)


@pytest.mark.parametrize("kind", [PtyPort, TcpServer])
def test_a_port_and_an_address_are_opened_by_name(kind: type[PtyPort | TcpServer], small: Rig) -> None:
    with kind() as link, served(Wall(Calibration.nominal(small), 900.0), link):
        with prismstereo.open(link.name) as camera:
            frame = next(iter(camera))
            assert frame.depth_mm[60, 60] == pytest.approx(900.0, rel=5e-3)
        assert frame.points[60, 60, 2] == frame.depth_mm[60, 60]  # what is needed for it was fetched before


def test_a_recording_is_the_same_camera(tmp_path: Path, small: Rig) -> None:
    wall = Wall(Calibration.nominal(small), 900.0, frames=14)
    with (
        PtyPort() as link,
        served(wall, link, lossless=True),
        prismstereo.open(link.name, keep_all=True, queue_frames=1) as live,
        Recorder(live, tmp_path, views_hz=0.0) as recorder,
    ):
        sent = list(live)
    with prismstereo.open(recorder.path, keep_all=True) as camera:
        replayed = list(camera)
        depth_mm = replayed[-1].depth_mm
    assert type(camera) is type(live)
    assert len(replayed) >= 8  # a few were on their way when the recording began
    assert [frame.index for frame in replayed] == [frame.index for frame in sent[-len(replayed) :]]
    assert depth_mm[60, 60] == pytest.approx(900.0, rel=5e-3)


@pytest.mark.parametrize(
    ("target", "error"),
    [
        ("/dev/ttyNOWHERE", PortError),
        ("tcp:127.0.0.1:1", PortError),
        ("nowhere.mcap", DataError),
        ("simulated:nothing", UsageError),
    ],
)
def test_what_cannot_be_opened_is_an_error_of_ours(target: str, error: type[Exception]) -> None:
    with pytest.raises(error):
        prismstereo.open(target, timeout_s=0.5)


def test_a_file_that_is_no_recording_is_refused() -> None:
    with pytest.raises(DataError):
        prismstereo.open(__file__)


def test_a_camera_in_the_hands_of_somebody_else_is_given_back_when_nobody_answers() -> None:
    with PtyPort() as link:
        for _ in range(2):
            with pytest.raises(LinkLost):
                prismstereo.open(link.name, timeout_s=0.1)


def test_a_frame_that_waited_gives_up_its_place_to_the_newest(small: Rig) -> None:
    with (
        PtyPort() as link,
        served(Wall(Calibration.nominal(small), 900.0, period_s=0.01), link),
        prismstereo.open(link.name, queue_frames=1) as camera,
    ):
        first = camera.take(5.0)
        eventually(lambda: camera.statistics.frames > 20)
        newest = camera.take(5.0)
        assert first is not None
        assert newest is not None
        assert newest.index - first.index >= 15
        assert first.age_us > newest.age_us
        assert camera.statistics.not_taken >= 15


def test_the_example_of_the_readme_finds_the_wall_of_the_simulated_sensor_and_leaves_no_process_behind() -> None:
    example = subprocess.Popen(
        [sys.executable, str(EXAMPLE), "simulated:oak-1:plane:600"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert example.stdout is not None
        lines = [example.stdout.readline() for _ in range(2)]
        firmware = children_of(example.pid)
    finally:
        example.send_signal(signal.SIGKILL)  # not even a chance to close
        example.communicate(timeout=10)
    for line in lines:
        found = re.fullmatch(r"(\d+) mm ahead\n", line)
        assert found, lines
        assert float(found[1]) == pytest.approx(613, abs=6)  # from the virtual pinholes, a little behind the lens
    assert len(firmware) == 1
    eventually(lambda: not Path(f"/proc/{firmware[0]}/cmdline").exists(), timeout_s=20.0)


def children_of(pid: int) -> list[int]:
    if not sys.platform.startswith("linux"):
        pytest.skip("child processes are looked up in /proc")
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def test_the_simulated_sensor_ends_with_its_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped: list[str] = []

    class Stopped:
        """A device that never answers."""

        def __init__(self, sensor: str, **_: object) -> None:
            self.address = os.devnull + "-nothing"
            stopped.append(sensor)

        def stop(self) -> None:
            stopped.append("stopped")

    monkeypatch.setattr("prismstereo.simulated.SimulatedDevice", Stopped)
    with pytest.raises(PortError):
        prismstereo.open("simulated")
    assert stopped == ["twin:oak-1", "stopped"]
    with pytest.raises(UsageError):
        prismstereo.open("serial:")
