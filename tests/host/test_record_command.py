from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from host.command import in_process
from host.counting import Counting, serve
from host.recorded import write_recording
from prismstereo.cli import record, recover, replay
from prismstereo.driver import StereoCamera
from prismstereo.recording import Damage, Recorder, Recording, RecordingError
from prismstereo.recording import replay as opened
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.protocol import calibration_hash
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, ProducedFrame, Service
from prismstereo_hw import pfm
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin


def _recording(port: str, out: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "prismstereo", "record", "--port", port, "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait_for_file(out: Path) -> Path:
    deadline_s = time.monotonic() + 30
    while not (found := sorted(out.glob("*.mcap"))):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    return found[0]


def _last_us(path: Path) -> int:
    damage = Damage()
    with Recording(path) as recording:
        packets = list(recording.packets(damage))
    assert not damage.packets
    return max((packet.host_us for packet in packets), default=0)


@pytest.mark.parametrize("runs", [2, pytest.param(30, marks=pytest.mark.soak)])
def test_a_recorder_that_is_killed_leaves_a_file_that_opens_and_lacks_a_second_at_most(
    tmp_path: Path, runs: int
) -> None:
    rng, worst_s = random.Random(5), 0.0
    for run in range(0, runs, 2):
        with PtyPort() as one, PtyPort() as two, serve(_steady(), one), serve(_steady(), two):
            folders = [tmp_path / f"{run}-{side}" for side in "ab"]
            started = [_recording(link.name, out) for link, out in zip((one, two), folders, strict=True)]
            for out, process in zip(folders, started, strict=True):
                path = _wait_for_file(out)
                found_us = time.monotonic_ns() // 1000
                time.sleep(rng.uniform(0.2, 0.7 if runs == 2 else 3.0))
                process.kill()
                killed_us = time.monotonic_ns() // 1000
                process.wait()
                worst_s = max(worst_s, (killed_us - (_last_us(path) or found_us)) * 1e-6)
    assert worst_s <= 1.0, f"{worst_s:.2f} s before the kill are lost"
    if runs > 2:
        print(f"{runs} kills: every file opens, at most {worst_s:.2f} s are lost")


def _steady() -> Counting:
    return Counting(1_000_000, period_s=0.01)


@contextmanager
def _largest_file(size: int) -> Iterator[None]:
    """Let this process write no file beyond a size, as a quota does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.soak  # the limit holds for all of this process, and what runs beside it may have files, too
def test_a_full_disk_is_said_with_an_exit_code_and_the_file_opens(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, worst_s, runs = random.Random(6), 0.0, 30
    for run in range(runs):
        out = tmp_path / str(run)
        with PtyPort() as link, serve(Counting(1_000_000, period_s=0.005), link):
            with _largest_file(rng.randrange(1_200_000, 4_000_000)), pytest.raises(RecordingError) as told:
                in_process(record.command, "--port", link.name, "--out", out)
            ended_us = time.monotonic_ns() // 1000
        assert told.value.exit_code == 4
        assert "the recording ended early" in str(told.value)
        assert "File too large" in str(told.value)
        worst_s = max(worst_s, (ended_us - _last_us(next(out.glob("*.mcap")))) * 1e-6)
    assert worst_s <= 2.0  # the verb looks ten times a second, and closes the camera
    with capsys.disabled():
        print(f"{runs} full disks: every file opens, at most {worst_s:.2f} s before the verb's end are lost")


def test_a_recorder_that_is_asked_to_stop_writes_the_index(tmp_path: Path) -> None:
    def ask() -> None:
        until_s = time.monotonic() + 30
        while not list(tmp_path.glob("*.mcap")) and time.monotonic() < until_s:
            time.sleep(0.05)
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the verb's own takes its place while it records
    try:
        with PtyPort() as link, serve(_steady(), link):
            asking = threading.Thread(target=ask)
            asking.start()
            _, said = in_process(record.command, link.name, "--out", tmp_path, "--label", "a box", "--json")
            asking.join()
    finally:
        signal.signal(signal.SIGTERM, before)
    told = json.loads(said[said.index("{") :])
    assert (told["packets_dropped"], told["reason"]) == (0, None)
    with Recording(told["file"]) as recording:
        assert (recording.finished, recording.info["label"]) == (True, "a box")
        assert len(list(recording.packets())) == told["packets"]


class _Desk:
    """A source that has all that a camera can send: disparity, preview and raw frame of a small rig before a plane."""

    def __init__(self, rig: Rig, unit: Calibration, frames: int) -> None:
        self._frame = Twin(rig, facing_plane(rig, 800.0)).frame()
        self._pipeline = Pipeline(unit)
        self._named = calibration_hash(flash.pack(unit))
        self._frames = iter(range(frames))

    def read(self) -> ProducedFrame | None:
        index = next(self._frames, None)
        if index is None:
            return None
        time.sleep(0.05)
        found, pixels = self._pipeline.process(self._frame), self._frame.pixels
        stamp_us = time.monotonic_ns() // 1000
        return ProducedFrame(index, stamp_us, None, found, calibration_hash=self._named, preview=pixels, raw=pixels)


def test_raw_frames_are_kept_and_their_depth_computed_anew(tmp_path: Path, small: Rig) -> None:
    unit = Calibration.nominal(small)
    near, far = loopback()
    objects = FixedObjects({ObjectNumber.CALIBRATION: flash.pack(unit)})
    identity = DeviceIdentity(b"serial-1", 77)
    with (
        Service(_Desk(small, unit, 4), near, identity, objects=objects, lossless=True),
        StereoCamera(far, keep_all=True) as camera,
        Recorder(camera, tmp_path, views_hz=100) as recorder,
    ):
        live = {frame.index: frame.disparity.disparity_px for frame in camera}
        time.sleep(0.2)
    _views_are_right(recorder.path)
    code, said = in_process(replay.command, recorder.path, "--matcher", "tiles", "--out", tmp_path / "depth", "--json")
    done = json.loads(said)
    assert (code, done["packets_damaged"]) == (0, 0)
    assert len(done["frames"]) >= 2
    for frame in done["frames"]:
        again = pfm.read(tmp_path / "depth" / f"{frame['file']}_disparity.pfm")
        index = int(frame["file"].split("-")[1])
        np.testing.assert_allclose(np.where(np.isinf(again), np.nan, again), live[index], atol=1 / 32)


def _views_are_right(path: Path) -> None:
    """The pictures for other programs show what the replay gives: depth in millimetres, and the camera that it fits."""
    with path.open("rb") as file:
        views = [(channel.topic, one.data) for _, channel, one in make_reader(file, validate_crcs=True).iter_messages()]
    depths = [RawImage.FromString(data) for topic, data in views if topic == "/prismstereo/depth"]
    cameras = [CameraCalibration.FromString(data) for topic, data in views if topic == "/prismstereo/left/camera_info"]
    previews = [CompressedImage.FromString(data) for topic, data in views if topic == "/prismstereo/left/image_rect"]
    with opened(path, pace=None, keep_all=True) as camera:
        frames = list(camera)
        expected_mm = camera.depth(frames[-1])
    assert (len(cameras), cameras[0].width, cameras[0].height) == (1, depths[0].width, depths[0].height)
    assert cameras[0].P[0] == pytest.approx(cameras[0].K[4])
    shown = np.frombuffer(depths[-1].data, "<u2").reshape(depths[-1].height, depths[-1].width)
    known = np.isfinite(expected_mm) & (expected_mm < 65535)
    np.testing.assert_allclose(shown[known], expected_mm[known], atol=0.5)
    assert all(one.data.startswith(b"\xff\xd8") for one in previews)
    assert previews


def test_replay_says_whether_a_recording_is_whole_and_recover_mends_it(tmp_path: Path) -> None:
    packets = write_recording(tmp_path / "one.mcap", 20)
    code, said = in_process(replay.command, tmp_path / "one.mcap", "--json")
    told = json.loads(said)
    assert (code, told["whole"], told["frames"], told["frames_identical"]) == (0, True, 20, 20)
    content = bytearray((tmp_path / "one.mcap").read_bytes())
    content[content.index(packets[30].packet.payload) + 9] ^= 1
    (tmp_path / "flipped.mcap").write_bytes(content)
    code, said = in_process(replay.command, tmp_path / "flipped.mcap")
    assert code == 1
    assert "DAMAGED" in said
    assert "1 packets, 1 chunks" in said
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    code, said = in_process(recover.command, tmp_path / "cut.mcap", "-o", tmp_path / "mended.mcap", "--json")
    assert (code, json.loads(said)["packets_damaged"]) == (0, 1)
    assert in_process(replay.command, tmp_path / "mended.mcap")[0] == 0


def test_depth_is_computed_anew_of_raw_frames_only(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 2)
    with pytest.raises(UsageError, match="--out FOLDER"):
        in_process(replay.command, tmp_path / "one.mcap", "--matcher", "tiles")
    with pytest.raises(DataError, match="holds no raw frames to compute depth of: record with --raw"):
        in_process(replay.command, tmp_path / "one.mcap", "--out", tmp_path / "depth")
