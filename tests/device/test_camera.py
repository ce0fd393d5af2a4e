"""The camera source: exactly what was asked for, changed between frames, and back after it went away."""

from __future__ import annotations

import logging
import time
from typing import cast

import cv2
import msgspec
import numpy as np
import pytest

from device.small_camera import AtOnce, DrawnSensor, SmallCamera, plain_calibration, plain_rig
from prismstereo_calibration import flash
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_device.control.settings import Settings
from prismstereo_device.control.stills import StillRequest, Stills
from prismstereo_device.objects import Held
from prismstereo_device.protocol.command import Value
from prismstereo_device.sensors.base import Exposure, Sensor
from prismstereo_device.source import ProducedFrame
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.rig import Mode


def frame_of(camera: SmallCamera) -> ProducedFrame:
    frame = camera.source.read()
    assert frame is not None
    return frame


def changed(camera: SmallCamera, **values: Value) -> ProducedFrame:
    for name, value in values.items():
        camera.controls.change(name, value)
    return frame_of(camera)


# ---- what was asked for, and no more


def test_a_stream_carries_disparity_and_its_calibration_and_nothing_else() -> None:
    camera = SmallCamera(DrawnSensor())
    frame = frame_of(camera)
    assert frame.disparity is not None
    assert frame.disparity.disparity_px.shape == (180, 160)
    assert (frame.disparity.reasons, frame.disparity.confidence) == (None, None)
    assert (frame.preview, frame.raw, frame.zones) == (None, None, None)
    assert frame.calibration_hash == flash.digest(plain_calibration())
    assert (frame.index, frame.timestamp_us, frame.filter_set) == (0, 1000, 2)


def test_each_wish_adds_its_own_and_the_next_frame_has_it() -> None:
    camera = SmallCamera(DrawnSensor())
    raw = changed(camera, raw=True)
    np.testing.assert_array_equal(cast("np.ndarray", raw.raw), camera.sensor.pixels)
    reasons = changed(camera, raw=False, reasons=True)
    assert reasons.raw is None
    assert reasons.disparity is not None
    assert reasons.disparity.reasons is not None
    zones = changed(camera, reasons=False, zones=True, stream=False)
    assert zones.disparity is None
    assert zones.zones is not None
    assert (zones.zones.index, zones.zones.timestamp_us) == (2, zones.timestamp_us)


def test_raw_frames_without_a_stream_are_not_matched_even_where_they_do_not_fit() -> None:
    settings = Settings(matcher="bm", stream=False, raw=True)
    camera = SmallCamera(DrawnSensor(2, size=(640, 480)), settings)
    frames = list(iter(camera.source.read, None))
    assert [cast("ProducedFrame", frame).raw is not None for frame in frames] == [True, True]
    camera.controls.order_self_test()
    assert camera.source.read() is None
    assert camera.facts[0].match_ms is None


def test_previews_come_no_faster_than_their_rate() -> None:
    camera = SmallCamera(DrawnSensor(30), Settings(matcher="bm", preview=True, stream=False))
    frames = [cast("ProducedFrame", frame) for frame in iter(camera.source.read, None)]
    previews = [frame for frame in frames if frame.preview is not None]
    assert [frame.index for frame in previews] == [0, 6, 12, 18, 24]  # five in a second of frames
    assert cast("np.ndarray", previews[0].preview).shape == (180, 160)


def test_a_region_and_a_matcher_change_between_frames() -> None:
    camera = SmallCamera(DrawnSensor())
    whole = frame_of(camera).disparity
    part = changed(camera, region=[80, 20, 60, 40], matcher="sgbm-3way").disparity
    assert whole is not None
    assert part is not None
    rows, columns = np.nonzero(part.valid)
    assert len(rows) > 500
    assert (rows.min(), rows.max()) >= (20, 20)
    assert rows.max() < 60
    assert columns.min() >= 80
    assert columns.max() < 140
    assert whole.density > part.density


def test_a_matcher_that_must_be_compiled_takes_over_while_frames_go_on() -> None:
    camera = SmallCamera(DrawnSensor())
    camera.controls.change("matcher", "tiles")
    until_s = time.monotonic() + 60
    density = {round(frame.disparity.density, 3) for frame in [frame_of(camera)] if frame.disparity}
    while len(density) < 2 and time.monotonic() < until_s:
        frame = frame_of(camera)
        assert frame.disparity is not None  # no frame waited for the compiler
        density.add(round(frame.disparity.density, 3))
    assert len(density) == 2
    assert camera.controls.settings.matcher == "tiles"


# ---- the sensor's controls


def test_controls_reach_the_sensor_between_frames_and_only_when_they_change() -> None:
    camera = SmallCamera(DrawnSensor())
    changed(camera, exposure_us=5000, rate_hz=20)
    changed(camera, bound=2)
    changed(camera, exposure_us="auto")
    assert camera.sensor.asked == [Exposure(5000.0), ("rate_hz", 20.0), Exposure()]


def test_a_control_that_the_sensor_refuses_is_as_before_and_the_log_says_why(
    caplog: pytest.LogCaptureFixture,
) -> None:
    camera = SmallCamera(DrawnSensor())
    changed(camera, gain=2)
    camera.sensor.refuses = (Exposure,)
    changed(camera, exposure_us=5000.0)
    assert camera.controls.settings.exposure_us == "auto"
    assert camera.controls.settings.gain == 2.0
    assert "exposure_us and gain stays as it was: the driver does not obey" in caplog.text


def test_the_sensor_begins_with_the_settings_of_the_start() -> None:
    camera = SmallCamera(DrawnSensor(), Settings(matcher="bm", exposure_us=700.0, rate_hz=15.0))
    assert camera.sensor.asked == [Exposure(700.0), ("rate_hz", 15.0)]
    sensor = DrawnSensor()
    sensor.refuses = (Exposure,)
    with pytest.raises(UsageError, match="the driver does not obey"):
        SmallCamera(sensor, Settings(matcher="bm", exposure_us=700.0))


def test_the_temperature_is_asked_in_the_frame_loop_and_kept_for_others() -> None:
    class Warm(DrawnSensor):
        temperature_c = 48.5

    camera = SmallCamera(Warm())
    assert camera.source.temperature_c is None
    frame_of(camera)
    assert camera.source.temperature_c == 48.5


# ---- calibration and focus


def test_the_lens_is_driven_to_where_the_calibration_was_made() -> None:
    camera = SmallCamera(DrawnSensor(), calibration=plain_calibration(140))
    assert camera.sensor.asked[0] == ("lens", 140)
    assert camera.controls.settings.lens_position == 140
    frame = frame_of(camera)
    assert (frame.lens_position, frame.disparity is not None) == (140, True)


def test_a_new_calibration_moves_the_lens_and_names_its_frames() -> None:
    camera = SmallCamera(DrawnSensor(), calibration=plain_calibration(140))
    before = frame_of(camera).calibration_hash
    camera.controls.order_calibration(plain_calibration(150))
    after = frame_of(camera)
    assert after.calibration_hash == flash.digest(plain_calibration(150)) != before
    assert camera.sensor.asked[-1] == ("lens", 150)
    assert after.disparity is not None
    with pytest.raises(UsageError, match="the calibration is for 150"):
        camera.controls.change("lens_position", 140)


def test_bytes_that_are_no_calibration_change_nothing(caplog: pytest.LogCaptureFixture) -> None:
    camera = SmallCamera(DrawnSensor())
    before = frame_of(camera).calibration_hash
    camera.controls.order_calibration(b"PSC\nnonsense")
    assert frame_of(camera).calibration_hash == before
    assert "the calibration stays as it was" in caplog.text


def test_a_region_that_no_longer_fits_is_given_up() -> None:
    camera = SmallCamera(DrawnSensor())
    changed(camera, region=[100, 100, 60, 80])
    rig = plain_rig()
    lower = msgspec.structs.replace(rig.camera, video=Mode(width=320, height=100, rate_hz=30.0))
    less = Calibration.nominal(msgspec.structs.replace(rig, camera=lower))
    camera.controls.order_calibration(flash.pack(less))
    frame_of(camera)
    assert camera.controls.settings.region == "auto"
    assert camera.controls.rules["region"].size == (160, 100)


def test_a_frame_out_of_focus_goes_out_unmatched_and_is_named_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    camera = SmallCamera(DrawnSensor(), calibration=plain_calibration(140))
    frame_of(camera)
    camera.sensor.lens_position = 141  # somebody turned it
    with caplog.at_level(logging.WARNING):
        assert [frame_of(camera).disparity for _ in range(3)] == [None] * 3
        camera.sensor.lens_position = 140
        assert frame_of(camera).disparity is not None
    assert caplog.text.count("was taken at lens position 141, but the calibration of 'wedge' is for 140") == 1
    assert "frames fit the calibration again" in caplog.text


def test_a_source_of_which_no_frame_fits_ends_with_the_reason() -> None:
    camera = SmallCamera(DrawnSensor(3, size=(640, 480)))
    assert [frame_of(camera).disparity for _ in range(3)] == [None] * 3
    with pytest.raises(CalibrationError, match="is 640x480, but the calibration of 'wedge' is for 320x180"):
        camera.source.read()


# ---- a camera that goes away


def test_a_camera_that_went_away_comes_back_with_its_settings_and_rising_numbers() -> None:
    successors = [DeviceError("not there yet"), DrawnSensor(3, lost_at=None)]

    def reopen() -> DrawnSensor:
        found = successors.pop(0)
        if isinstance(found, DeviceError):
            raise found
        return found

    second = successors[-1]
    assert isinstance(second, DrawnSensor)
    camera = SmallCamera(DrawnSensor(lost_at=2), calibration=plain_calibration(140), reopen=reopen)
    changed(camera, exposure_us=5000.0)
    numbers = [cast("ProducedFrame", frame).index for frame in iter(camera.source.read, None)]
    assert numbers == [1, 3, 4, 5]  # the gap tells of it
    assert second.asked == [Exposure(5000.0), ("lens", 140)]
    assert camera.sensor.closed == 1
    assert camera.alive >= 2
    camera.source.close()
    assert second.closed == 1


def test_orders_are_heard_while_the_camera_is_away() -> None:
    camera: SmallCamera
    tries = 0

    def reopen() -> DrawnSensor:
        nonlocal tries
        tries += 1
        if tries == 1:
            camera.controls.change("gain", 3.0)
            camera.controls.order_self_test()
            camera.stills.ask(StillRequest(4))
        if tries < 3:
            raise DeviceError("not there yet")
        return back

    back = DrawnSensor()
    camera = SmallCamera(DrawnSensor(lost_at=0), reopen=reopen)
    frame_of(camera)
    assert back.asked == [Exposure(None, 3.0)]
    assert camera.facts[0].away == "the cable was pulled out"
    assert msgspec.json.decode(camera.stills.state)["why"] == "the camera is away"


def test_patience_ends_where_it_is_told_to() -> None:
    def reopen() -> DrawnSensor:
        raise DeviceError("not there")

    camera = SmallCamera(DrawnSensor(lost_at=0), reopen=reopen, give_up_s=0.01)
    with pytest.raises(
        DeviceError, match=r"did not come back within 0\.01 s \(the cable was pulled out\): check its cable"
    ):
        camera.source.read()
    with pytest.raises(DeviceError, match="the cable was pulled out"):
        SmallCamera(DrawnSensor(lost_at=0)).source.read()


def test_who_stops_does_not_wait_for_the_camera() -> None:
    def reopen() -> DrawnSensor:
        camera.source.stop()
        raise DeviceError("not there")

    camera = SmallCamera(DrawnSensor(lost_at=0), reopen=reopen)
    assert camera.source.read() is None


# ---- stills and looks


def test_a_still_is_the_sensors_own_pixels_of_the_wished_crop() -> None:
    camera = SmallCamera(DrawnSensor())
    frame_of(camera)
    assert camera.stills.ask(StillRequest(9, (10, 20, 300, 200)))
    assert msgspec.json.decode(camera.stills.state) == {"id": 9, "state": "waiting"}
    frame_of(camera)
    (held,) = camera.held
    assert msgspec.json.decode(camera.stills.state) == {
        "id": 9, "state": "ready", "frame": 0, "timestamp_us": 1000, "crop": [10, 20, 300, 200], "size": len(held.content)
    }  # fmt: skip
    picture = cv2.imdecode(np.frombuffer(held.content, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(picture, camera.sensor.still().frame.pixels[20:220, 10:310])
    assert held.version == 9


def test_a_still_may_be_a_jpeg() -> None:
    kept: list[Held] = []
    stills = Stills(kept.append, AtOnce(), "jpeg")
    stills.ask(StillRequest(1))
    sensor = DrawnSensor()
    stills.serve(sensor)
    picture = cv2.imdecode(np.frombuffer(kept[0].content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert kept[0].content.startswith(b"\xff\xd8")
    assert picture.shape == (480, 640)
    assert np.abs(picture.astype(int) - sensor.still().frame.pixels).mean() < 12


def test_a_sensor_without_stills_says_so() -> None:
    class VideoOnly(DrawnSensor):
        still = Sensor.still

    camera = SmallCamera(VideoOnly())
    camera.stills.ask(StillRequest(1))
    frame_of(camera)
    assert "this sensor takes no stills" in msgspec.json.decode(camera.stills.state)["why"]


def test_a_still_outside_the_sensor_fails_and_says_so() -> None:
    camera = SmallCamera(DrawnSensor())
    camera.stills.ask(StillRequest(1, (600, 0, 100, 100)))
    frame_of(camera)
    told = msgspec.json.decode(camera.stills.state)
    assert told["state"] == "failed"
    assert "leaves the sensor" in told["why"]
    assert camera.held == []


def test_the_optics_are_looked_at_now_and_then_and_when_asked() -> None:
    camera = SmallCamera(DrawnSensor())
    frame_of(camera)
    assert camera.looks == []  # not yet: there are seconds between looks
    for _ in range(2):
        assert camera.optics.ask()
        frame_of(camera)
        frame_of(camera)
    told = msgspec.json.decode(camera.looks[-1].content)
    assert (told["looks"], {finding["name"] for finding in told["findings"]} >= {"seam_px", "dust_left"}) == (2, True)
