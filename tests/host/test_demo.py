import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from host.command import complaint_of, prismstereo, result_of
from prismstereo.driver import StereoCamera
from prismstereo.simulated import SimulatedDevice
from prismstereo_device.link import LinkLost
from prismstereo_hw import pfm
from prismstereo_hw.files import read_picture


def test_the_demo_sends_every_frame_through_the_firmware_and_measures_true_depth(tmp_path: Path) -> None:
    result = result_of("demo", "--headless", "--frames", 3, "-o", tmp_path)

    assert result["frames_sent"] == result["frames_received"] == 3
    assert result["bad_packets"] == 0
    assert result["disparity_error_px"] < 0.15
    assert result["depth_error_mm"] < 5.0
    disparity = pfm.read(tmp_path / "disparity.pfm")
    assert disparity.shape == (720, 640)
    assert read_picture(tmp_path / "depth.png").shape[:2] == (720, 732)
    header = (tmp_path / "cloud.ply").read_bytes()[:400].decode("ascii", "replace")
    assert f"element vertex {result['points']}" in header
    assert np.count_nonzero(np.isfinite(disparity)) >= result["points"] > 200_000


def test_a_device_that_vanishes_in_the_middle_is_named_and_what_came_before_is_kept(tmp_path: Path) -> None:
    with SimulatedDevice("twin:oak-1:plane:600", frames=500, lossless=False) as device:
        host = subprocess.Popen(
            [sys.executable, "-m", "prismstereo", "demo", "--port", device.address, "--frames", "400", "-o", str(tmp_path)],
            stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert host.stderr is not None
        seen = ""
        while "frames received: " not in seen:  # at least one frame has come
            seen += host.stderr.readline()
        device._process.send_signal(signal.SIGKILL)
        _, rest = host.communicate(timeout=60)

    assert host.returncode == 3
    assert re.search(r"error: .*" + re.escape(device.address), rest), rest
    assert pfm.read(tmp_path / "disparity.pfm").shape == (720, 640)


def test_the_driver_delivers_the_frames_so_far_and_then_says_that_the_device_is_gone() -> None:
    with (
        SimulatedDevice("twin:oak-1:plane:600", frames=500, lossless=False) as device,
        StereoCamera.open(device.address, timeout_s=30, reconnect=False) as camera,
    ):
        frames = iter(camera)
        first = next(frames)
        device._process.send_signal(signal.SIGKILL)
        with pytest.raises(LinkLost, match="frame"):
            for _ in frames:
                pass

    assert first.disparity.density > 0.5


def test_a_port_that_does_not_exist_is_a_device_error_with_a_mend() -> None:
    assert "/dev/no-such-port" in complaint_of(3, "demo", "--port", "/dev/no-such-port")
    assert "/dev/no-such-port" in complaint_of(3, "devices", "/dev/no-such-port")


def test_a_running_sensor_tells_who_it_is() -> None:
    with SimulatedDevice("twin:pi-camera-v2:plane:600", frames=1) as device:
        result = result_of("devices", device.address)

    assert result["rig"] == "pi-camera-v2"
    assert result["baseline_mm"] == pytest.approx(49.93, abs=0.1)
    assert result["range_min_mm"] < 450


def test_the_firmware_refuses_what_it_cannot_run_in_one_line() -> None:
    module = "prismstereo_device"

    assert "no sensor 'radar'" in complaint_of(2, "--sensor", "radar", module=module)
    assert "no rig 'nothing'" in complaint_of(2, "--sensor", "twin:nothing", module=module)
    assert "nothing to replay" in complaint_of(4, "--sensor", "replay:/no/such/folder", module=module)
    assert "no matcher 'magic'" in complaint_of(2, "--sensor", "twin:oak-1", "--matcher", "magic", module=module)
    assert "tcp:HOST:PORT" in complaint_of(2, "--sensor", "twin:oak-1", "--link", "tcp:nowhere", module=module)


def test_the_demo_over_tcp_works_where_there_are_no_pseudo_terminals() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "prismstereo_device", "--sensor", "twin:oak-1:plane:600", "--link", "tcp:127.0.0.1:0",
         "--frames", "2", "--lossless"], stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split('"')[3]
        with StereoCamera.open(address, timeout_s=30, keep_all=True) as camera:
            received = [frame.index for frame in camera]
    finally:
        process.terminate()
        process.communicate(timeout=20)

    assert received == [0, 1]


def test_doctor_finds_this_installation_in_order() -> None:
    result = result_of("doctor")

    assert result["ok"] is True


def test_devices_lists_ports_and_ends_well() -> None:
    assert prismstereo("devices").returncode == 0
