from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from host.counting import serve
from host.export_frames import WALL_MM, flat_calibration, frame_of, painted, pinhole_points_m, wall
from host.recorded import session_note, write_recording
from prismstereo.driver import StereoCamera
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.export.live import LiveFrames
from prismstereo.export.sources import RecordingSource
from prismstereo.recording.journal import Journal
from prismstereo.recording.output import FileOutput
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.decimate import Decimate
from prismstereo_device.filters.sheet import Sheet
from prismstereo_device.framing import Packet
from prismstereo_device.link.loopback import loopback
from prismstereo_device.protocol import PictureKind, calibration_hash, fragment, picture_fragments
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import RangeWish, Rig


@pytest.fixture(scope="module")
def flat(small: Rig) -> Calibration:
    return flat_calibration(small)


def test_a_cloud_has_the_points_of_the_pinhole_and_their_colours(flat: Calibration) -> None:
    made = rectification(flat)

    cloud = frame_of(flat).cloud(1e-3)

    np.testing.assert_allclose(cloud.points, pinhole_points_m(flat, wall(made)), rtol=2e-6, atol=1e-7)
    assert cloud.colours is not None
    np.testing.assert_array_equal(cloud.colours, painted(made)[20:].reshape(-1, 3)[:, ::-1])


def test_a_map_of_half_the_resolution_stands_in_the_same_space(flat: Calibration) -> None:
    large = frame_of(flat)
    sheet = Sheet(
        large.disparity.disparity_px,
        np.full(large.disparity.disparity_px.shape, 255, np.uint8),
        np.zeros(large.disparity.disparity_px.shape, np.uint8),
        large.disparity.window,
        None,
    )
    halved = Decimate(factor=2).apply(sheet)

    small = ExportFrame.of(1, 0, DisparityMap(halved.disparity_px, halved.window), large.left, Geometries(flat))

    assert (small.geometry.decimated, small.geometry.width) == (2, large.geometry.width // 2)
    assert small.geometry.baseline == pytest.approx(large.geometry.baseline, rel=1e-12)
    assert small.left is not None
    assert small.left.shape == (*small.depth.shape, 3)
    one, other = small.cloud().points, large.cloud().points
    np.testing.assert_allclose(one[:, 2], WALL_MM, rtol=2e-6)
    np.testing.assert_allclose(
        one.mean(axis=0), other.mean(axis=0), atol=1e-3
    )  # four pixels' middle is the large one's


def test_a_map_for_another_range_gets_the_principal_columns_of_that_range(flat: Calibration) -> None:
    wish = RangeWish(near_mm=500.0, far_mm=2000.0, labels=64)
    made = rectification(flat, wish, 64)
    disparity = np.full((made.height, made.width), 10.0, np.float32)

    geometry = Geometries(flat).of(DisparityMap(disparity, made.window))

    assert geometry.cx_px == pytest.approx(made.left.cx_px)
    assert geometry.cx_right_px - geometry.cx_px == pytest.approx(made.window.offset_px)
    assert made.left.cx_px != rectification(flat).left.cx_px


def test_depth_of_a_map_off_the_wire_considers_the_glass_of_its_calibration(small: Rig) -> None:
    behind_glass = Calibration.nominal(small)
    made = rectification(behind_glass)
    disparity = np.full((made.height, made.width), 30.0, np.float32)
    wired = replace(made.window, glass=None)

    frame = ExportFrame.of(0, 0, DisparityMap(disparity, wired), None, Geometries(behind_glass))

    np.testing.assert_array_equal(frame.depth, made.window.depth_map(disparity))
    np.testing.assert_allclose(made.window.scale_px / frame.inverse_px, frame.depth, rtol=1e-6)
    assert np.abs(frame.depth / made.window.depth(disparity) - 1).max() > 1e-4


def test_a_map_that_the_calibration_cannot_have_made_is_refused(flat: Calibration) -> None:
    frame = frame_of(flat)
    smaller = DisparityMap(frame.disparity.disparity_px[:-30], frame.disparity.window)
    nearer = replace(frame.disparity, window=replace(frame.disparity.window, scale_px=1234.0))

    for wrong in (smaller, nearer):
        with pytest.raises(DataError, match="none of this calibration's"):
            Geometries(flat).of(wrong)


def test_squares_of_unknown_size_are_no_metres(flat: Calibration) -> None:
    geometry = replace(frame_of(flat).geometry, unit="square")

    with pytest.raises(UsageError, match="--square-mm"):
        _ = geometry.baseline_m


def _recorded(path: Path, calibration: Calibration, *, sessions: int = 1, frames: int = 8) -> None:
    """Write a recording of sessions 10 s apart; every second frame has a picture, which comes two frames later."""
    content = flash.pack(calibration)
    named = calibration_hash(content)
    sent = frame_of(flash.unpack(content)).disparity
    left = painted(rectification(calibration))[..., 0]
    journal = Journal(FileOutput(path), 0.0)
    journal.calibrate(content)
    begin_us = time.monotonic_ns() // 1000

    def write(channel: Channel, of: int, packets: Iterator[tuple[int, int, bytes]]) -> None:
        for flags, number, payload in packets:
            journal.write(StoredPacket(Packet(channel, payload, flags, number, of, number), heard_us, session))

    for session in range(1, sessions + 1):
        journal.write(session_note(session, session, content))
        for index in range(frames):
            heard_us = begin_us + 10_000_000 * session + 1000 * index
            stamp_us = 1000 * index
            write(
                Channel.DISP,
                index,
                fragment(sent, frame=index, timestamp_us=stamp_us, calibration_hash=named, mtu=4096, bound=0),
            )
            if index >= 2 and index % 2:
                of, kind = index - 2, PictureKind.PREVIEW
                write(Channel.IMG, of, picture_fragments(left, kind=kind, frame=of, timestamp_us=1000 * of, mtu=4096))
    journal.sync(None)
    journal.finish()


def test_frames_of_a_recording_come_with_the_pictures_that_belong_to_them(flat: Calibration, tmp_path: Path) -> None:
    _recorded(tmp_path / "one.mcap", flat)
    source = RecordingSource(tmp_path / "one.mcap")

    frames = list(source.frames(1, 7))
    source.close()

    assert [frame.index for frame in frames] == [1, 2, 3, 4, 5, 6]
    assert [frame.left is not None for frame in frames] == [True, False, True, False, True, False]
    for frame in frames:
        assert frame.timestamp_ns - frames[0].timestamp_ns == (frame.index - 1) * 1_000_000
        np.testing.assert_allclose(np.nanmedian(frame.depth), WALL_MM, rtol=2e-3)  # sixteenths of a pixel
    assert abs(frames[0].timestamp_ns - time.time_ns()) < 60e9  # the wall clock


def test_every_session_of_a_recording_is_exported(flat: Calibration, tmp_path: Path) -> None:
    _recorded(tmp_path / "two.mcap", flat, sessions=2, frames=3)
    source = RecordingSource(tmp_path / "two.mcap")

    frames = list(source.frames())
    source.close()

    assert [frame.index for frame in frames] == [0, 1, 2, 0, 1, 2]
    assert frames[3].timestamp_ns - frames[0].timestamp_ns == pytest.approx(10e9, abs=1e6)


def test_a_recording_without_the_calibration_of_its_frames_says_so(small: Rig, tmp_path: Path) -> None:
    write_recording(tmp_path / "other.mcap", 2)
    source = RecordingSource(tmp_path / "other.mcap")
    with pytest.raises(DataError):  # its calibration is no calibration
        list(source.frames())
    source.close()


class _Sent:
    """A camera that sends given frames, and a preview of every second one."""

    def __init__(self, calibration: Calibration, count: int) -> None:
        self._content = flash.pack(calibration)
        self._frame = frame_of(flash.unpack(self._content))
        self._left = painted(rectification(calibration))[..., 0]
        self._indices = iter(range(count))

    def read(self) -> ProducedFrame | None:
        index = next(self._indices, None)
        if index is None:
            return None
        named = calibration_hash(self._content)
        return ProducedFrame(index, 1000 * index, None, self._frame.disparity, named, preview=self._left)


def test_frames_of_a_camera_come_as_they_are_received(flat: Calibration) -> None:
    device, host = loopback()
    with (
        serve(_Sent(flat, 8), device, calibration=flash.pack(flat), lossless=True),
        StereoCamera(host, keep_all=True) as camera,
    ):
        frames = list(LiveFrames(camera, lambda frame: frame.timestamp_us + 5, lambda: 0))

    assert [frame.index for frame in frames] == list(range(8))
    assert [frame.timestamp_ns for frame in frames] == [1000 * index + 5 for index in range(8)]
