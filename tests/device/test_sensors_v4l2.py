"""Video4Linux cameras, against the kernel's documented bytes and a stream behind a shutter."""

from __future__ import annotations

import ctypes
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from device.video_device import (
    AUTO_EXPOSURE,
    AUTO_FOCUS,
    AUTO_GAIN,
    EXPOSURE,
    FOCUS,
    GAIN,
    PRIORITY,
    KernelCamera,
    KernelControl,
    Shutter,
)
from prismstereo_device.sensors import open_sensor, v4l2_layout
from prismstereo_device.sensors.base import Exposure, Limit, SensorMode, StampQuality
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.v4l2 import V4l2Sensor
from prismstereo_device.sensors.v4l2_mode import chosen_mode
from prismstereo_device.sensors.v4l2_node import VideoNode
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

KNOWN = ("width", "height", "format", "rate", "exposure_us", "gain", "lens_position", "colour", "rig")
SIZE = 64, 48


def webcam() -> KernelCamera:
    """A camera as they are sold: YUYV slow and MJPG fast, in two sizes."""
    return KernelCamera(
        modes={
            "YUYV": {(64, 48): [(1, 30), (1, 15)], (128, 72): [(1, 10)]},
            "MJPG": {(64, 48): [(1, 60), (1, 30)], (128, 72): [(1, 30)]},
            "H264": {(128, 72): [(1, 30)]},
        },
        controls={
            AUTO_EXPOSURE: KernelControl(0, 3, 3, keeps=lambda value: value if value in (1, 3) else 3),
            EXPOSURE: KernelControl(1, 5000, 157),
            PRIORITY: KernelControl(0, 1, 1),
            GAIN: KernelControl(0, 100, 20),
            AUTO_FOCUS: KernelControl(0, 1, 1),
            FOCUS: KernelControl(0, 250, 35),
        },
    )


def yuyv(grey: int) -> NDArray[np.uint8]:
    """A buffer of the video size, as OpenCV hands it over."""
    return np.array([grey, 128] * (SIZE[0] * SIZE[1]), np.uint8).reshape(1, -1)


class Bench:
    """A camera's kernel side, its streams one after the other, and the sensor in front of both."""

    def __init__(
        self,
        kernel: KernelCamera,
        options: str = "format=YUYV",
        *,
        frames: list[NDArray[np.uint8]] | None = None,
        fixed: dict[int, float] | None = None,
        stamp_ms: Callable[[int], float] = lambda n: 40.0 * n,
        most: int | None = None,
    ) -> None:
        self.kernel, self.shutters = kernel, list[Shutter]()
        size = {cv2.CAP_PROP_FRAME_WIDTH: 64.0, cv2.CAP_PROP_FRAME_HEIGHT: 48.0}

        def open_capture() -> Shutter:
            buffers = [yuyv(10 * n) for n in range(9)] if frames is None else frames
            self.shutters.append(Shutter(buffers, fixed=size | (fixed or {}), stamp_ms=stamp_ms))
            return self.shutters[-1]

        node = VideoNode(os.open(os.devnull, os.O_RDWR), "/dev/video7", kernel.ioctl)
        try:
            self.sensor = V4l2Sensor(node, open_capture, Options(f"width=64&height=48&{options}", KNOWN), frames=most)
        except BaseException:
            node.close()
            raise

    def shoot(self, frames: int = 1) -> RawFrame:
        """Let frames through and read the newest one."""
        self.shutters[-1].let_through(frames)
        found = self.sensor.read()
        assert found is not None
        return found

    def close(self) -> None:
        self.shutters[-1].end()
        self.sensor.close()


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(*arguments: Any, **words: Any) -> Bench:
        made.append(Bench(*arguments, **words))
        return made[-1]

    yield make
    for each in made:
        each.close()


# ---- the kernel's bytes (linux/videodev2.h)


@pytest.mark.parametrize(
    ("structure", "size", "offsets"),
    [
        (
            v4l2_layout.Capability,
            104,
            {"card": 16, "bus_info": 48, "version": 80, "capabilities": 84, "device_caps": 88},
        ),
        (v4l2_layout.FormatQuery, 64, {"type": 4, "flags": 8, "description": 12, "pixelformat": 44, "mbus_code": 48}),
        (v4l2_layout.SizeQuery, 44, {"pixel_format": 4, "type": 8, "numbers": 12, "reserved": 36}),
        (v4l2_layout.IntervalQuery, 52, {"width": 8, "height": 12, "type": 16, "numbers": 20, "reserved": 44}),
        (v4l2_layout.ControlQuery, 68, {"type": 4, "name": 8, "minimum": 40, "maximum": 44, "step": 48, "flags": 56}),
        (v4l2_layout.Control, 8, {"id": 0, "value": 4}),
    ],
)
def test_structures_lie_as_the_kernel_has_them(
    structure: type[ctypes.Structure], size: int, offsets: dict[str, int]
) -> None:
    assert ctypes.sizeof(structure) == size
    assert {name: getattr(structure, name).offset for name in offsets} == offsets


def test_requests_have_the_kernels_numbers() -> None:
    assert v4l2_layout.QUERY_CAPABILITY == 0x80685600
    assert v4l2_layout.ENUM_FORMATS == 0xC0405602
    assert v4l2_layout.ENUM_SIZES == 0xC02C564A
    assert v4l2_layout.ENUM_INTERVALS == 0xC034564B
    assert v4l2_layout.QUERY_CONTROL == 0xC0445624
    assert v4l2_layout.GET_CONTROL == 0xC008561B
    assert v4l2_layout.SET_CONTROL == 0xC008561C


# ---- modes


def test_every_mode_is_listed(bench: Callable[..., Bench]) -> None:
    modes = bench(webcam()).sensor.modes
    assert modes[:3] == (
        SensorMode(64, 48, "YUYV", 30),
        SensorMode(64, 48, "YUYV", 15),
        SensorMode(128, 72, "YUYV", 10),
    )
    assert [mode.pixel_format for mode in modes] == ["YUYV"] * 3 + ["MJPG"] * 3 + ["H264"]


def test_a_range_of_sizes_is_listed_by_its_ends_and_anything_between_is_asked_for(bench: Callable[..., Bench]) -> None:
    kernel = KernelCamera(modes={}, stepwise={"GREY": (32, 640, 8, 24, 480, 8)}, device_caps=0x04201000, buffer_type=9)
    sensor = bench(kernel, "format=GREY").sensor
    assert sensor.modes == (SensorMode(32, 24, "GREY"), SensorMode(640, 480, "GREY"))
    assert sensor.mode == SensorMode(64, 48, "GREY")


def test_without_a_format_the_fastest_is_taken_and_of_equals_the_one_with_the_most_in_it(
    bench: Callable[..., Bench],
) -> None:
    assert bench(webcam(), "colour=1").sensor.mode.pixel_format == "YUYV"  # 60 Hz of JPEG are more than enough
    assert bench(webcam(), "rate=60", fixed={cv2.CAP_PROP_FPS: 60.0}).sensor.mode.pixel_format == "MJPG"
    slow = KernelCamera(modes={"YUYV": {(64, 48): [(1, 5)]}, "GREY": {(64, 48): [(1, 30)]}})
    assert bench(slow, "colour=1").sensor.mode.pixel_format == "GREY"


def test_the_rigs_video_size_is_the_usual_one() -> None:
    modes = (SensorMode(1280, 720, "MJPG", 30), SensorMode(640, 480, "YUYV", 30))
    assert chosen_mode(modes, Options("", KNOWN), Rig.read("oak-1").camera.video) == SensorMode(1280, 720, "MJPG")
    assert chosen_mode(modes, Options("", KNOWN), None) == SensorMode(640, 480, "YUYV")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("width=100&height=100", r"no mode 100x100: give one of 64x48 YUYV 30 Hz, 64x48 YUYV 15 Hz, 128x72 YUYV 10 Hz"),
        ("width=128&height=72&rate=60", "no mode 128x72 at 60 Hz: give one of"),
        ("width=64&height=48&format=NV12", "no mode 64x48 NV12: give one of"),
        ("width=64&height=48&format=H264", "format=H264: give one of YUYV, UYVY"),
        ("width=64", "give width and height, or neither of them"),
    ],
)
def test_a_mode_that_is_not_there_is_refused_with_those_that_are(options: str, complaint: str) -> None:
    descriptor = os.open(os.devnull, os.O_RDWR)
    modes = VideoNode(descriptor, "/dev/video7", webcam().ioctl).modes()
    os.close(descriptor)
    with pytest.raises(UsageError, match=complaint):
        chosen_mode(modes, Options(options, KNOWN), None)


def test_a_driver_that_gives_another_size_or_rate_is_refused() -> None:
    with pytest.raises(UsageError, match="gives 32x48 pixels where 64x48 were asked for"):
        Bench(webcam(), fixed={cv2.CAP_PROP_FRAME_WIDTH: 32.0})
    with pytest.raises(UsageError, match="runs at 15 Hz where 30 were asked for"):
        Bench(webcam(), "rate=30", fixed={cv2.CAP_PROP_FPS: 15.0})


# ---- frames


def test_a_frame_is_decoded_and_the_newest_one_wins(bench: Callable[..., Bench]) -> None:
    made = bench(webcam(), "format=YUYV&colour=0")
    frame = made.shoot(1)
    assert (frame.index, frame.pixels.shape, int(frame.pixels[5, 5]), frame.lens_position) == (0, (48, 64), 0, 35)
    frame = made.shoot(4)
    assert (frame.index, int(frame.pixels[5, 5])) == (4, 40)
    assert bench(webcam(), "format=YUYV").shoot().pixels.shape == (48, 64, 3)


def test_a_damaged_jpeg_is_passed_over_and_counted(bench: Callable[..., Bench]) -> None:
    good = cv2.imencode(".jpg", np.full((48, 64), 77, np.uint8))[1].reshape(1, -1)
    made = bench(webcam(), "format=MJPG&colour=0", frames=[good[:, :-40], good])
    made.shutters[0].let_through(1)
    later = threading.Timer(0.1, made.shutters[0].let_through)
    later.start()
    frame = made.sensor.read()
    later.join()
    assert frame is not None
    assert (frame.index, int(frame.pixels[0, 0]), made.sensor.damaged) == (1, 77, 1)


def test_frames_that_opencv_decoded_itself_are_taken_as_they_are(bench: Callable[..., Bench], tmp_path: Path) -> None:
    made = bench(webcam(), frames=[np.full((48, 64, 3), 9, np.uint8)])
    assert (made.shoot().pixels == 9).all()


def test_the_drivers_stamp_is_given_and_graded(bench: Callable[..., Bench]) -> None:
    begin_us = time.monotonic_ns() // 1000 - 2_000_000
    made = bench(webcam(), stamp_ms=lambda n: begin_us / 1000 + 40 * n)
    assert made.shoot(3).timestamp_us == begin_us + 80_000
    assert made.sensor.stamp_quality is StampQuality.DRIVER
    made = bench(webcam())  # stamps that count from the stream's begin are no clock
    before_us = time.monotonic_ns() // 1000
    assert before_us <= made.shoot().timestamp_us <= time.monotonic_ns() // 1000
    assert made.sensor.stamp_quality is StampQuality.ARRIVAL


def test_only_as_many_frames_are_given_as_asked_for(bench: Callable[..., Bench]) -> None:
    made = bench(webcam(), most=1)
    made.shoot()
    assert made.sensor.read() is None


def test_a_camera_that_is_pulled_is_named(bench: Callable[..., Bench]) -> None:
    made = bench(webcam())
    made.shoot()
    made.shutters[0].end()
    with pytest.raises(DeviceError, match="/dev/video7 stopped giving frames: check its cable"):
        made.sensor.read()
    made.kernel.gone = True
    with pytest.raises(DeviceError, match=r"the camera /dev/video7 went away \(No such device\)"):
        made.sensor.set_exposure(Exposure(1000.0))


# ---- exposure, rate, lens


def test_exposure_is_locked_in_steps_of_100_us_and_read_back(bench: Callable[..., Bench]) -> None:
    made = bench(webcam(), "format=YUYV&exposure_us=8000&gain=40")
    assert made.sensor.limits.exposure_us == Limit(100, 500_000)
    assert made.sensor.limits.gain == Limit(0, 100)
    values = {key: control.value for key, control in made.kernel.controls.items()}
    assert (values[AUTO_EXPOSURE], values[EXPOSURE], values[GAIN], values[PRIORITY]) == (1, 80, 40, 0)
    made.sensor.set_exposure(Exposure())
    assert made.kernel.controls[AUTO_EXPOSURE].value == 3
    with pytest.raises(UsageError, match="exposure_us 600000: this camera takes 100 to 500000"):
        made.sensor.set_exposure(Exposure(600_000.0))


def test_a_driver_that_does_not_obey_is_refused(bench: Callable[..., Bench]) -> None:
    kernel = webcam()
    kernel.controls[EXPOSURE].keeps = lambda value: 157  # says yes, does nothing
    made = bench(kernel)
    with pytest.raises(UsageError, match="makes 157 of EXPOSURE_ABSOLUTE 80: give a value that its driver keeps"):
        made.sensor.set_exposure(Exposure(8000.0))
    with pytest.raises(UsageError, match="makes 157 of EXPOSURE_ABSOLUTE 80"):
        Bench(kernel, "format=YUYV&exposure_us=8000")


def test_what_a_camera_has_not_got_cannot_be_set(bench: Callable[..., Bench]) -> None:
    kernel = KernelCamera(modes=webcam().modes)
    kernel.controls[GAIN] = KernelControl(0, 100, 20, flags=0x4)  # read only
    made = bench(kernel)
    assert made.sensor.limits.exposure_us is made.sensor.limits.gain is made.sensor.limits.lens_position is None
    assert made.shoot().lens_position is None
    for wish in (Exposure(8000.0), Exposure(gain=30.0)):
        with pytest.raises(UsageError, match="cannot be set, leave it as it is"):
            made.sensor.set_exposure(wish)
    with pytest.raises(UsageError, match="lens_position 3: this camera's lens_position cannot be set"):
        made.sensor.set_lens(3)
    with pytest.raises(UsageError, match="this sensor takes no stills"):
        made.sensor.still()


def test_automatic_gain_is_switched_with_the_gain(bench: Callable[..., Bench]) -> None:
    kernel = webcam()
    kernel.controls[AUTO_GAIN] = KernelControl(0, 1, 0)
    made = bench(kernel)
    assert kernel.controls[AUTO_GAIN].value == 1
    made.sensor.set_exposure(Exposure(gain=30.0))
    assert (kernel.controls[AUTO_GAIN].value, kernel.controls[GAIN].value) == (0, 30)


def test_the_lens_is_held_and_stamped(bench: Callable[..., Bench]) -> None:
    made = bench(webcam(), "format=YUYV&lens_position=120")
    assert (made.kernel.controls[AUTO_FOCUS].value, made.kernel.controls[FOCUS].value) == (0, 120)
    made.sensor.set_lens(90)
    assert made.shoot().lens_position == 90
    with pytest.raises(UsageError, match="lens_position 300: this camera takes 0 to 250"):
        made.sensor.set_lens(300)


def test_another_rate_starts_the_stream_again_and_the_numbers_go_on(bench: Callable[..., Bench]) -> None:
    made = bench(webcam(), "format=MJPG&rate=60", frames=[np.full((48, 64, 3), 9, np.uint8)] * 9)
    assert made.sensor.limits.rate_hz == Limit(30, 60)
    assert made.shoot(3).index == 2
    closer = threading.Timer(0.05, made.shutters[0].end)  # a camera that runs gives its reader a chance to stop
    closer.start()
    made.sensor.set_rate(30.0)
    closer.join()
    assert made.shutters[0].released
    assert made.shutters[1].get(cv2.CAP_PROP_FPS) == 30.0
    assert made.shoot(1).index == 3
    with pytest.raises(UsageError, match="rate_hz 100: this camera takes 30 to 60"):
        made.sensor.set_rate(100.0)
    assert made.shoot(1).index == 4


# ---- opening


def test_a_device_that_is_not_there_or_no_camera_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"cannot open the camera .*missing \(No such file or directory\)"):
        open_sensor(f"v4l2:{tmp_path / 'missing'}")
    with pytest.raises(DeviceError, match=r"/dev/null is no camera .*: give a video device"):
        open_sensor("v4l2:/dev/null")
    with pytest.raises(
        DeviceError, match=r"cannot open the camera /dev/video63 .* (give one of|no camera is plugged in)"
    ):
        open_sensor("v4l2:63?rig=oak-1")


def test_a_node_that_gives_no_frames_is_refused() -> None:
    descriptor = os.open(os.devnull, os.O_RDWR)
    metadata_node = KernelCamera(modes={}, device_caps=0x04800000)
    with pytest.raises(DeviceError, match="/dev/video8 gives no frames: a camera often has several nodes"):
        VideoNode(descriptor, "/dev/video8", metadata_node.ioctl)
    os.close(descriptor)
