"""Draining a capture, and what is in its buffers."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.video_device import Shutter
from prismstereo_device.sensors.capture import CaptureThread
from prismstereo_device.sensors.pixel_formats import PIXEL_FORMATS, pixels, planar_pixels
from prismstereo_hw.errors import DeviceError, ImageError

GREYS = [np.full((4, 6), 10 * n, np.uint8) for n in range(9)]


def test_the_newest_frame_is_given_and_the_others_are_counted() -> None:
    shutter = Shutter(GREYS)
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(1)
    assert (first := thread.newest(5.0)).number == 0
    shutter.let_through(4)
    newest = thread.newest(5.0)
    assert (newest.number, int(newest.content[0, 0])) == (4, 40)
    assert newest.timestamp_us >= first.timestamp_us
    shutter.end()
    thread.close()
    assert shutter.released
    assert thread.next_number == 5


def test_a_frame_is_given_once() -> None:
    shutter = Shutter(GREYS)
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(1)
    thread.newest(5.0)
    with pytest.raises(DeviceError, match=r"the camera gave no frame for 0\.05 s: check its cable"):
        thread.newest(0.05)
    shutter.end()
    thread.close()


def test_the_last_frame_comes_before_the_news_that_the_camera_went_away() -> None:
    shutter = Shutter(GREYS[:3])
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(3)
    shutter.end()
    assert int(thread.newest(5.0).content[0, 0]) == 20
    with pytest.raises(DeviceError, match="the camera stopped giving frames: check its cable and its power"):
        thread.newest(5.0)
    thread.close()
    assert shutter.released


def test_an_error_inside_opencv_is_the_end_of_a_camera_and_not_of_the_program() -> None:
    class Torn(Shutter):
        def retrieve(self) -> tuple[bool, np.ndarray[tuple[int, ...], np.dtype[np.uint8]]]:
            cv2.cvtColor(np.zeros((2, 2, 5), np.uint8), cv2.COLOR_BGR2GRAY)
            return True, GREYS[0]

    shutter = Torn(GREYS)
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(1)
    with pytest.raises(DeviceError, match="the camera failed in OpenCV"):
        thread.newest(5.0)
    thread.close()


def test_buffers_with_nothing_in_them_end_a_camera_before_long() -> None:
    class Empty(Shutter):
        def retrieve(self) -> tuple[bool, np.ndarray[tuple[int, ...], np.dtype[np.uint8]]]:
            return False, GREYS[0]

    shutter = Empty(GREYS[:1] * 200)
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(150)
    with pytest.raises(DeviceError, match="the camera gave 101 empty frames in a row"):
        thread.newest(5.0)
    thread.close()
    assert thread.next_number == 100  # they were frames, nobody got them


@pytest.mark.parametrize(
    ("late_us", "by_driver"), [(3_000, True), (9_900_000, True), (11_000_000, False), (-50_000, False)]
)
def test_a_drivers_stamp_counts_if_it_is_of_this_clock(late_us: int, *, by_driver: bool) -> None:
    told_us = time.monotonic_ns() // 1000 - late_us
    shutter = Shutter(GREYS, stamp_ms=lambda n: told_us / 1000)
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(1)
    grabbed = thread.newest(5.0)
    now_us = time.monotonic_ns() // 1000
    shutter.end()
    thread.close()
    assert grabbed.by_driver is by_driver
    assert grabbed.timestamp_us == told_us if by_driver else 0 <= now_us - grabbed.timestamp_us < 5_000_000


def test_a_real_capture_is_drained_and_let_go_of(tmp_path: Path) -> None:
    for n in range(6):
        cv2.imwrite(str(tmp_path / f"{n:03d}.png"), np.full((4, 6, 3), 10 * n, np.uint8))
    shutter = Shutter(cv2.VideoCapture(str(tmp_path / "%03d.png"), cv2.CAP_IMAGES))
    thread = CaptureThread(shutter, "the camera")
    shutter.let_through(5)
    assert (thread.newest(5.0).content == 40).all()
    shutter.end()
    thread.close()
    assert not any(running.name.startswith("capture") for running in threading.enumerate())


# ---- buffers


def picture(width: int = 16, height: int = 8) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A grey ramp from left to right, brighter downwards."""
    return (np.arange(width) * 8 + np.arange(height)[:, None] * 4 + 16).astype(np.uint8)


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize(("pixel_format", "brightness"), [("YUYV", 0), ("UYVY", 1)])
def test_brightness_stands_in_every_second_byte(pixel_format: str, brightness: int, padding: int) -> None:
    packed = np.full((8, 16, 2), 128, np.uint8)
    packed[:, :, brightness] = picture()
    rows = np.hstack([packed.reshape(8, 32), np.full((8, padding), 99, np.uint8)])
    np.testing.assert_array_equal(pixels(rows.reshape(1, -1), pixel_format, (16, 8), colour=False), picture())
    shown = pixels(rows.reshape(1, -1), pixel_format, (16, 8), colour=True)
    expected = (picture().astype(float) - 16) * 255 / 219  # limited range, no colour
    np.testing.assert_allclose(shown, np.repeat(expected[:, :, None], 3, axis=2), atol=1.0)


def test_grey_nv12_and_bgr_buffers_are_cut_to_the_picture() -> None:
    padded = np.hstack([picture(), np.zeros((8, 16), np.uint8)])
    np.testing.assert_array_equal(pixels(padded.reshape(1, -1), "GREY", (16, 8), colour=True), picture())
    nv12 = np.vstack([picture(), np.full((4, 16), 128, np.uint8)])
    np.testing.assert_array_equal(pixels(nv12.reshape(1, -1), "NV12", (16, 8), colour=False), picture())
    assert pixels(nv12.reshape(1, -1), "NV12", (16, 8), colour=True).shape == (8, 16, 3)
    bgr = np.dstack([picture(), picture(), picture()])
    np.testing.assert_array_equal(pixels(bgr.reshape(1, -1), "BGR3", (16, 8), colour=True), bgr)
    np.testing.assert_array_equal(pixels(bgr.reshape(1, -1), "BGR3", (16, 8), colour=False), picture())


def test_a_jpeg_is_decoded_if_it_is_whole_and_of_the_streams_size() -> None:
    jpeg = cv2.imencode(".jpg", cv2.merge([picture()] * 3), [cv2.IMWRITE_JPEG_QUALITY, 100])[1].reshape(1, -1)
    with_padding = np.hstack([jpeg, np.zeros((1, 100), np.uint8)])  # drivers fill up to whole packets
    for buffer in (jpeg, with_padding):
        found = pixels(buffer, "MJPG", (16, 8), colour=False)
        np.testing.assert_allclose(found.astype(int), picture(), atol=3)
    assert pixels(jpeg, "MJPG", (16, 8), colour=True).shape == (8, 16, 3)
    with pytest.raises(ImageError, match=r"of 16x8 pixels came in a stream of 1280x720"):
        pixels(jpeg, "MJPG", (1280, 720), colour=False)
    with pytest.raises(ImageError, match="is cut off, or no JPEG"):
        pixels(jpeg[:, :-9], "MJPG", (16, 8), colour=False)


@given(st.binary(max_size=400), st.sampled_from(PIXEL_FORMATS))
@settings(max_examples=100, deadline=None)
def test_no_buffer_breaks_anything(content: bytes, pixel_format: str) -> None:
    buffer = np.frombuffer(content, np.uint8).reshape(1, -1)
    for colour in (False, True):
        try:
            found = pixels(buffer, pixel_format, (16, 8), colour=colour)
        except ImageError:
            continue
        assert found.shape[:2] == (8, 16)


def test_planes_with_padding_give_brightness_and_colour() -> None:
    planes = np.full((12, 24), 99, np.uint8)  # 16 columns and 8 rows, the rows padded to 24 bytes
    planes[:8, :16] = picture()
    chroma = planes[8:].reshape(8, 12)
    chroma[:4, :8], chroma[4:, :8] = 110, 190
    np.testing.assert_array_equal(planar_pixels(planes, (16, 8), colour=False), picture())
    blue, green, red = (int(value) for value in planar_pixels(planes, (16, 8), colour=True)[4, 4])
    y = float(picture()[4, 4])
    assert (blue, green, red) == (
        pytest.approx(y + 1.772 * (110 - 128), abs=1.5),
        pytest.approx(y - 0.344 * (110 - 128) - 0.714 * (190 - 128), abs=1.5),
        pytest.approx(y + 1.402 * (190 - 128), abs=1.5),
    )
    with pytest.raises(ImageError, match="are no YUV 4:2:0 picture of 16x10 pixels"):
        planar_pixels(planes, (16, 10), colour=True)
