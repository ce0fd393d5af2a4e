"""Raspberry Pi cameras, against a strict stand-in for their library."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest

from device import raspberry_camera
from device.raspberry_camera import BOOT_NS, PERIOD_US, QUICK_MODES, SLOW_MODES, Picamera2, sensor_mode
from prismstereo_device.sensors import open_sensor, pi_session
from prismstereo_device.sensors.base import Exposure, Limit, SensorMode, StampQuality
from prismstereo_device.sensors.pi_camera import chosen_streams
from prismstereo_device.sensors.pi_exposure import exposure_controls
from prismstereo_device.sensors.picamera2 import PiSensor
from prismstereo_hw.errors import DeviceError, UsageError


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Picamera2]]:
    """The library as if it were installed; every camera that was opened must be closed, its buffers given back."""

    class Fresh(Picamera2):
        made: ClassVar[list[Picamera2]] = []
        known: ClassVar = dict(Picamera2.known)

    module = ModuleType("picamera2")
    vars(module)["Picamera2"] = Fresh
    monkeypatch.setitem(sys.modules, "picamera2", module)
    yield Fresh
    assert all(camera.closed and not camera.out for camera in Fresh.made)


def opened(address: str = "picamera2:", **limits: int) -> PiSensor:
    sensor = open_sensor(address, **limits)
    assert isinstance(sensor, PiSensor)
    return sensor


# ---- streams


def test_the_mode_with_the_most_pixels_that_is_fast_enough_and_sees_the_whole_width_is_taken() -> None:
    streams = chosen_streams(SLOW_MODES, (1280, 720), 30.0)
    assert (streams.mode["size"], streams.main, streams.lores) == ((1640, 1232), (1632, 918), (1280, 720))
    assert not streams.still_in_main
    streams = chosen_streams(SLOW_MODES, (1280, 720), 20.0)
    assert (streams.mode["size"], streams.main, streams.still_in_main) == ((3280, 2464), (3264, 1836), True)


@pytest.mark.parametrize("size", [(1280, 720), (640, 480), (1000, 700), (1638, 922), (640, 362), (328, 246)])
def test_both_streams_have_the_same_proportions_and_even_sizes(size: tuple[int, int]) -> None:
    main = chosen_streams(SLOW_MODES, size, 20.0).main
    assert main[0] * size[1] == main[1] * size[0]
    assert main[0] % 2 == main[1] % 2 == 0
    assert size[0] <= main[0] <= 3280
    assert size[1] <= main[1] <= 2464


@pytest.mark.parametrize(
    ("size", "rate_hz", "complaint"),
    [
        ((1280, 720), 45.0, r"no mode sees the whole width in 1280x720 at 45 Hz: it has 640x480 up to 103\.33 Hz"),
        ((4000, 2000), 10.0, "no mode sees the whole width in 4000x2000"),
        ((641, 480), 10.0, "641x480 pixels: this camera gives even numbers"),
    ],
)
def test_what_no_mode_gives_is_refused_with_the_modes(size: tuple[int, int], rate_hz: float, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        chosen_streams(SLOW_MODES, size, rate_hz)


def test_a_usb_camera_is_sent_to_the_other_sensor() -> None:
    with pytest.raises(DeviceError, match="it is not on the CSI connector, open it with v4l2:DEVICE"):
        chosen_streams([{"format": "MJPEG"}, {"format": "YUYV"}], (1280, 720), 30.0)


# ---- frames


def test_frames_are_stamped_at_mid_exposure(library: type[Picamera2]) -> None:
    sensor = opened("picamera2:0?exposure_us=8000&gain=2&colour=0&rig=pi-camera-v2", frames=3)
    assert sensor.rig is not None
    assert sensor.rig.name == "pi-camera-v2"
    assert sensor.stamp_quality is StampQuality.EXPOSURE
    assert sensor.modes[1] == SensorMode(1640, 1232, "SRGGB10_CSI2P", 41.85)
    frames = [frame for frame in iter(sensor.read, None) if frame is not None]
    sensor.close()
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.timestamp_us for frame in frames] == [BOOT_NS // 1000 + n * PERIOD_US - 4000 for n in range(3)]
    assert [frame.pixels.shape for frame in frames] == [(720, 1280)] * 3
    assert [int(frame.pixels[700, 1200]) for frame in frames] == [10, 11, 12]
    assert sensor.temperature_c == 41.5
    assert library.made[0].configuration is not None
    assert library.made[0].configuration["raw"]["size"] == (1640, 1232)


def test_a_gap_in_the_numbers_tells_of_frames_that_nobody_read(library: type[Picamera2]) -> None:
    sensor = opened()
    first = sensor.read()
    library.made[0].number += 5
    second = sensor.read()
    sensor.close()
    assert first is not None
    assert second is not None
    assert (first.index, second.index) == (0, 6)
    assert second.pixels.shape == (720, 1280, 3)


def test_a_camera_that_keeps_silent_is_an_error_and_can_be_closed(
    library: type[Picamera2], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pi_session, "_SILENCE_S", 0.05)
    sensor = opened()
    assert sensor.read() is not None
    library.made[0].silent = True
    with pytest.raises(
        DeviceError, match=r"the Raspberry Pi camera 0 gave no frame for 0\.05 s: check its ribbon cable"
    ):
        sensor.read()
    sensor.close()
    library.made[0].out.clear()  # the request that never came


# ---- stills


def test_a_still_of_a_quick_sensor_is_the_newest_frame_in_full(library: type[Picamera2]) -> None:
    library.modes = QUICK_MODES
    sensor = opened("picamera2:?width=160&height=90&colour=0")
    with pytest.raises(UsageError, match="a still belongs to a video frame: read one first"):
        sensor.still()
    frames = [sensor.read(), sensor.read()]
    still = sensor.still()
    assert frames[1] is not None
    assert (still.frame.index, still.frame.timestamp_us) == (1, frames[1].timestamp_us)
    assert still.frame.pixels.shape == (180, 320)
    assert (still.frame.pixels == frames[1].pixels[0, 0]).all()
    assert still.crop == (0, 309, 3280, 1845)
    assert library.made[0].stills == 0
    assert sensor.read() is not None
    sensor.close()


def test_a_still_of_a_slow_sensor_changes_the_mode_and_puts_everything_back(library: type[Picamera2]) -> None:
    library.known |= {"LensPosition": (0.0, 15.0, 1.0), "AfMode": (0, 2, 0)}
    sensor = opened("picamera2:?exposure_us=8000&gain=2&lens_position=250&colour=0")
    frame = sensor.read()
    assert frame is not None
    assert frame.lens_position == 250
    still = sensor.still()
    camera = library.made[0]
    assert camera.stills == 1
    assert (still.frame.index, still.frame.pixels.shape, still.frame.lens_position) == (0, (2464, 3280), 250)
    assert still.frame.timestamp_us > frame.timestamp_us
    assert (camera.still_controls["ExposureTime"], camera.still_controls["LensPosition"]) == (8000, 2.5)
    assert "FrameDurationLimits" not in camera.still_controls  # all its pixels take longer than a video frame
    assert (camera.applied["ExposureTime"], camera.applied["LensPosition"]) == (8000, 2.5)
    assert camera.applied["FrameDurationLimits"] == (33_333, 33_333)
    assert sensor.read() is not None
    sensor.close()


# ---- controls


def test_exposure_is_locked_and_the_white_balance_after_it_settled(library: type[Picamera2]) -> None:
    sensor = opened("picamera2:?colour=0&width=64&height=36")
    camera = library.made[0]
    assert camera.applied["AeEnable"] is True
    assert sensor.limits.exposure_us == Limit(75, 33_333)
    assert sensor.limits.gain == Limit(1.0, 10.67)
    sensor.set_exposure(Exposure(8000.0, 2.0))
    applied = camera.applied
    assert (applied["AeEnable"], applied["ExposureTime"], applied["AnalogueGain"]) == (False, 8000, 2.0)
    assert applied["AwbEnable"] is True
    for _ in range(30):
        assert sensor.read() is not None
    assert (camera.applied["AwbEnable"], camera.applied["ColourGains"]) == (False, (1.5, 2.0))
    sensor.set_exposure(Exposure())
    assert (camera.applied["AeEnable"], camera.applied["AwbEnable"]) == (True, True)
    assert "ColourGains" not in camera.asked[-1]  # libcamera takes them for a wish to balance by hand
    sensor.close()


@pytest.mark.parametrize(
    ("exposure", "expected"),
    [
        (Exposure(), {"ExposureTimeMode": 0, "AnalogueGainMode": 0}),
        (Exposure(8000.4), {"ExposureTimeMode": 1, "AnalogueGainMode": 0, "ExposureTime": 8000}),
        (Exposure(gain=2.0), {"ExposureTimeMode": 0, "AnalogueGainMode": 1, "AnalogueGain": 2.0}),
    ],
)
def test_newer_cameras_take_time_and_gain_apart(exposure: Exposure, expected: dict[str, object]) -> None:
    known = {"ExposureTimeMode", "AnalogueGainMode", "ExposureTime", "AnalogueGain", "AeEnable"}
    assert exposure_controls(exposure, known) == expected


def test_a_time_alone_leaves_the_gain_to_an_older_camera() -> None:
    known = {"AeEnable", "ExposureTime", "AnalogueGain"}
    assert exposure_controls(Exposure(8000.0), known) == {"AeEnable": True, "ExposureTime": 8000, "AnalogueGain": 0.0}


def test_rate_and_lens_are_set_within_their_limits(library: type[Picamera2]) -> None:
    library.known |= {"LensPosition": (0.0, 15.0, 1.0), "AfMode": (0, 2, 0)}
    sensor = opened("picamera2:?width=64&height=36")
    camera = library.made[0]
    assert (camera.applied["AfMode"], camera.applied["LensPosition"]) == (0, 1.0)  # held where it usually is
    sensor.set_rate(10.0)
    assert camera.applied["FrameDurationLimits"] == (100_000, 100_000)
    assert sensor.limits.exposure_us == Limit(75, 100_000)
    sensor.set_lens(333)
    frame = sensor.read()
    assert frame is not None
    assert frame.lens_position == 333
    for wish, complaint in (
        (lambda: sensor.set_rate(60.0), "rate_hz 60: this camera takes"),
        (lambda: sensor.set_lens(1501), "lens_position 1501: this camera takes 0 to 1500"),
        (lambda: sensor.set_exposure(Exposure(200_000.0)), "exposure_us 200000: this camera takes 75 to 100000"),
    ):
        with pytest.raises(UsageError, match=complaint):
            wish()
    sensor.close()


def test_a_camera_without_a_motor_drives_no_lens(library: type[Picamera2]) -> None:
    with pytest.raises(UsageError, match="lens_position 250: this camera's lens_position cannot be set"):
        opened("picamera2:?lens_position=250")
    assert library.made[0].closed


# ---- opening


def test_without_the_library_it_is_said_how_to_get_it() -> None:
    with pytest.raises(
        DeviceError, match="install python3-picamera2 with apt, and make the environment with --system-site"
    ):
        open_sensor("picamera2:0")


def test_a_camera_that_is_not_there_is_refused_with_those_that_are(library: type[Picamera2]) -> None:
    with pytest.raises(DeviceError, match="there is no Raspberry Pi camera 3: there is 0 imx219"):
        open_sensor("picamera2:3")
    with pytest.raises(UsageError, match="Raspberry Pi camera 'imx219': give its number, 0 for the first one"):
        open_sensor("picamera2:imx219")
    with pytest.raises(UsageError, match="there is no option 'still' of this sensor"):
        open_sensor("picamera2:0?still=1")
    assert library.made == []


def test_an_error_of_the_library_becomes_ours(library: type[Picamera2]) -> None:
    del library.known["FrameDurationLimits"]
    with pytest.raises(
        DeviceError, match=r"camera 0 failed .Control FrameDurationLimits is not advertised by libcamera.: check"
    ):
        open_sensor("picamera2:0")


def test_an_image_processor_that_makes_another_size_is_refused(library: type[Picamera2]) -> None:
    library.adjusted = {"lores": (1216, 684)}
    with pytest.raises(UsageError, match="makes 1216x684 of a lores stream of 1280x720: give a size that it keeps"):
        open_sensor("picamera2:0")


def test_a_sensor_of_odd_size_gives_an_even_still(library: type[Picamera2]) -> None:
    library.modes = [
        sensor_mode((820, 616), 60.0, (0, 0, 1639, 1231)),
        sensor_mode((1639, 1231), 10.0, (0, 0, 1639, 1231)),
    ]
    sensor = opened("picamera2:?width=64&height=48")
    assert sensor.read() is not None
    assert sensor.still().frame.pixels.shape == (1230, 1638, 3)
    sensor.close()


def test_the_stand_in_is_as_strict_as_the_library() -> None:
    camera = raspberry_camera.Picamera2()
    with pytest.raises(RuntimeError, match="Control Exposure is not advertised"):
        camera.set_controls({"Exposure": 3})
    with pytest.raises(AttributeError):
        camera.capture_arrays(["main"])  # type: ignore[attr-defined]
    assert np.all(np.array(camera.number) == -1)
