from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from host.calibrated_source import Wall, eventually
from prismstereo.camera_frame import CameraFrame
from prismstereo.driver import StereoCamera
from prismstereo.frame_pictures import FramePictures
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.protocol import (
    PictureKind,
    ReceivedFrame,
    ReceivedPicture,
    calibration_hash,
    picture_fragments,
)
from prismstereo_device.protocol.picture_head import PictureHead
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.rate_control import halved
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_device.wire import Channel
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import RangeWish, Rig

DEPTH_MM = 700.0


@pytest.fixture(scope="module")
def wall(small: Rig) -> Wall:
    return Wall(Calibration.nominal(small), DEPTH_MM)


@pytest.fixture(scope="module", params=[None, b'{"stamp_quality": "made"}'], ids=["clocked", "made"])
def camera(request: pytest.FixtureRequest, wall: Wall) -> Iterator[StereoCamera]:
    objects = {ObjectNumber.CALIBRATION: wall.content}
    if request.param is not None:
        objects[ObjectNumber.IDENTITY] = request.param
    device, host = loopback()
    service = Service(wall.again(), device, DeviceIdentity(b"serial-1", 7), objects=FixedObjects(objects))
    with device, service, StereoCamera(host, queue_frames=1) as opened:
        yield opened


def received(wall: Wall, disparity) -> ReceivedFrame:
    return ReceivedFrame(1, 0, disparity, calibration_hash(wall.content)[:4], None, 0)


def test_a_frame_has_its_depth_and_its_points_in_millimetres(camera: StereoCamera, wall: Wall) -> None:
    frame = camera.take(5.0)
    assert frame is not None
    known = np.isfinite(frame.depth_mm)
    assert frame.depth_mm is frame.depth_mm
    np.testing.assert_array_equal(known[8:], np.full((frame.height - 8, frame.width), fill_value=True))
    assert not known[:8].any()
    np.testing.assert_allclose(frame.depth_mm[known], DEPTH_MM, rtol=3e-3)  # disparities come in sixteenths
    row, column = 100, 40
    made, z = wall.geometry, float(frame.depth_mm[row, column])
    due = (column - made.left.cx_px) / made.focal_px * z, (row - made.cy_px) / made.focal_px * z, z
    np.testing.assert_allclose(frame.points[row, column], due, rtol=1e-5)
    assert len(frame.cloud().points) == np.count_nonzero(known)


def test_a_frame_of_half_the_size_has_the_same_points_between(camera: StereoCamera, wall: Wall) -> None:
    whole = CameraFrame.of(received(wall, wall.disparity), 1, camera=camera)
    half = CameraFrame.of(received(wall, halved(wall.disparity)), 1, camera=camera)
    assert (half.height, half.width) == (-(-whole.height // 2), -(-whole.width // 2))
    between = (whole.points[100:102, 40:42]).mean(axis=(0, 1))
    np.testing.assert_allclose(half.points[50, 20], between, rtol=1e-4, atol=1e-3)


def test_a_frame_grows_old_by_the_clock_that_its_camera_has(camera: StereoCamera) -> None:
    eventually(lambda: camera.clock is not None)
    for frame in camera:
        if frame.clock is not None:
            break
    made = camera.stamp_quality is not None
    age_us = frame.age_us
    since_heard_us = time.monotonic_ns() // 1000 - frame.heard_us
    if made:
        assert (frame.host_time_us, frame.host_time_bound_us) == (None, None)
        assert abs(age_us - since_heard_us) < 50_000
    else:
        assert frame.host_time_us is not None
        assert frame.host_time_bound_us is not None
        assert (
            abs(frame.host_time_us - frame.timestamp_us) <= frame.host_time_bound_us + 1
        )  # one clock at both ends here
        assert age_us >= frame.heard_us - frame.timestamp_us - frame.host_time_bound_us
    time.sleep(0.05)
    assert frame.age_us >= age_us + 50_000


def test_what_comes_beside_a_frame_belongs_to_it(camera: StereoCamera, wall: Wall) -> None:
    for frame in camera:
        picture = frame.picture(PictureKind.PREVIEW, timeout_s=2.0)
        if picture is not None:  # the newest wins: not every frame has one
            break
    assert picture.head.frame == frame.index
    assert frame.preview is not None
    assert np.abs(frame.preview.astype(int) - wall.preview).mean() < 4  # as JPEG
    cloud = frame.cloud()
    assert cloud.colours is not None
    assert frame.picture(PictureKind.CONFIDENCE, timeout_s=2.0) is not None or frame.confidence is None
    for later in camera:
        if later.picture(PictureKind.CONFIDENCE, timeout_s=2.0) is not None:
            break
    told = later.confidence
    assert told is not None
    columns = np.arange(later.width)
    np.testing.assert_array_equal(told[60], (columns // 4 * 4) % 251)


def test_frames_reach_an_iteration_and_callbacks_at_once(camera: StereoCamera) -> None:
    seen: list[tuple[int, bool]] = []

    def call(frame: CameraFrame) -> None:
        seen.append((frame.index, bool(np.isfinite(frame.depth_mm).any())))  # asks the camera, in its own thread

    with camera.on_frame(call) as calls:
        eventually(lambda: len(seen) >= 3)
        assert calls.running
    count = len(seen)
    time.sleep(0.08)
    assert len(seen) == count
    assert not calls.running
    assert all(depth for _, depth in seen)
    assert camera.take(2.0) is not None


def test_packets_can_be_tapped_with_their_time_and_session(camera: StereoCamera) -> None:
    taken: list[tuple[int, int, int]] = []
    before_us = time.monotonic_ns() // 1000

    def tap(packet, heard_us: int, session: int) -> None:
        taken.append((packet.channel, heard_us, session))

    camera.on_packet.append(tap)
    eventually(lambda: {channel for channel, _, _ in taken} >= {Channel.DISP, Channel.IMG})
    camera.on_packet.remove(tap)
    assert all(before_us <= heard_us <= time.monotonic_ns() // 1000 for _, heard_us, _ in taken)
    assert {session for _, _, session in taken} == {camera.session} == {1}


def test_a_frame_of_no_camera_has_only_its_disparity(wall: Wall) -> None:
    frame = CameraFrame.of(received(wall, wall.disparity), 1)
    assert (frame.preview, frame.zones, frame.host_time_us) == (None, None, None)
    with pytest.raises(UsageError, match="frame 1 is of no open camera"):
        _ = frame.depth_mm


class OtherUnit:
    """A camera whose calibration is in squares of its board."""

    def __init__(self, wall: Wall) -> None:
        self._geometry = replace(wall.geometry, unit="square")

    def rectification(self, frame: ReceivedFrame):
        return self._geometry


def test_depth_in_another_unit_is_not_given_out_as_millimetres(wall: Wall) -> None:
    frame = CameraFrame.of(received(wall, wall.disparity), 1, camera=OtherUnit(wall))
    with pytest.raises(UsageError, match=r"is in square, not in mm: use camera\.depth"):
        _ = frame.depth_mm


def test_a_map_that_no_calibration_of_the_camera_makes_is_refused(camera: StereoCamera, wall: Wall) -> None:
    narrow = replace(wall.disparity, disparity_px=wall.disparity.disparity_px[:, :-1])
    with pytest.raises(DataError, match=f"its calibration makes {wall.geometry.width}x{wall.geometry.height}"):
        camera.rectification(received(wall, narrow))


def a_picture(index: int) -> ReceivedPicture:
    pixels = np.zeros((8, 8), np.uint8)
    _, _, payload = next(
        iter(picture_fragments(pixels, kind=PictureKind.PREVIEW, frame=index, timestamp_us=0, mtu=512))
    )
    return ReceivedPicture(PictureHead.unpack(payload), b"")


def test_a_picture_is_waited_for_only_as_long_as_it_can_come() -> None:
    pictures = FramePictures(kept=2)
    begin_s = time.monotonic()
    assert pictures.picture(Channel.IMG, 1, 5, timeout_s=0.05) is None
    assert time.monotonic() - begin_s >= 0.05
    pictures.put(1, a_picture((1 << 32) - 1))
    pictures.put(1, a_picture(1))  # frame numbers go on after 2^32 - 1
    assert pictures.picture(Channel.IMG, 1, (1 << 32) - 1) is not None
    begin_s = time.monotonic()
    assert pictures.picture(Channel.IMG, 1, 0, timeout_s=5.0) is None
    pictures.put(2, a_picture(0))
    assert pictures.picture(Channel.IMG, 1, 2, timeout_s=5.0) is None
    assert time.monotonic() - begin_s < 1.0
    assert pictures.picture(Channel.IMG, 1, (1 << 32) - 1) is None  # two are kept


def test_zones_are_found_by_their_frame() -> None:
    pictures = FramePictures()
    zones = ZoneDistances(7, 900, np.array([[400]], np.uint16))
    pictures.put_zones(1, zones)
    assert pictures.zones(1, 7) is zones
    assert pictures.zones(1, 6) is None
    assert pictures.zones(2, 7) is None


def test_the_geometry_of_a_map_of_another_range_is_that_ranges_own(
    camera: StereoCamera, wall: Wall, small: Rig
) -> None:
    wished = rectification(Calibration.nominal(small), RangeWish(near_mm=600.0, far_mm=2000.0, labels=64), 64)
    steps = np.ones((wished.height, wished.width), np.float32)
    found = camera.rectification(received(wall, DisparityMap(steps, replace(wished.window, glass=None))))
    assert found.left.cx_px == pytest.approx(wished.left.cx_px, abs=0.51)  # columns are chosen to a whole one
    assert found.left.cx_px - found.right.cx_px == pytest.approx(-wished.window.offset_px, abs=1e-3)
    assert abs(wished.window.offset_px - wall.geometry.window.offset_px) > 1.0
