"""The simulated sensor obeys: exposure counts light, a rate spaces the stamps, a still shows the full sensor."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from prismstereo_device.sensors.base import Exposure, SensorMode
from prismstereo_device.sensors.twin import TwinSensor
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin


@pytest.fixture
def sensor(small: Rig) -> TwinSensor:
    rig = msgspec.structs.replace(
        small, camera=msgspec.structs.replace(small.camera, still=Mode(width=640, height=480))
    )
    return TwinSensor(Twin(rig, facing_plane(rig, 600.0)))


def taken(sensor: TwinSensor) -> RawFrame:
    frame = sensor.read()
    assert frame is not None
    return frame


def test_half_the_exposure_is_half_the_light_and_a_gain_gives_it_back(sensor: TwinSensor) -> None:
    as_made = float(taken(sensor).pixels.mean())
    sensor.set_exposure(Exposure(exposure_us=5000.0))
    half = float(taken(sensor).pixels.mean())
    sensor.set_exposure(Exposure(exposure_us=5000.0, gain=2.0))
    again = float(taken(sensor).pixels.mean())
    sensor.set_exposure(Exposure())
    assert half == pytest.approx(as_made / 2, rel=0.02)
    assert again == pytest.approx(as_made, rel=0.02)
    assert float(taken(sensor).pixels.mean()) == pytest.approx(as_made, rel=0.01)


def test_a_rate_spaces_the_stamps_from_the_next_frame_on(sensor: TwinSensor) -> None:
    stamps = [taken(sensor).timestamp_us for _ in range(2)]
    sensor.set_rate(500.0)
    stamps += [taken(sensor).timestamp_us for _ in range(3)]
    assert stamps == [0, 33_333, 66_667, 68_667, 70_667]


@pytest.mark.parametrize("exposure", [Exposure(exposure_us=0.0), Exposure(gain=100.0), Exposure(exposure_us=2e6)])
def test_what_lies_beyond_its_limits_is_refused(sensor: TwinSensor, exposure: Exposure) -> None:
    with pytest.raises(UsageError, match="this sensor takes"):
        sensor.set_exposure(exposure)
    with pytest.raises(UsageError, match="this sensor takes"):
        sensor.set_rate(0.01)


def test_a_still_is_the_full_sensor_at_the_newest_frames_time(sensor: TwinSensor) -> None:
    for _ in range(3):
        frame = taken(sensor)
    still = sensor.still()
    assert (still.frame.index, still.frame.timestamp_us) == (frame.index, frame.timestamp_us)
    assert still.frame.pixels.shape == (480, 640)
    assert still.crop == (0, 0, 640, 480)
    assert sensor.modes == (SensorMode(320, 180, "GREY", 30.0), SensorMode(640, 480, "GREY"))
    middle = still.frame.pixels[60:420:2, ::2].astype(float)  # the still is twice as fine, and taller
    assert np.corrcoef(middle.ravel(), frame.pixels.astype(float).ravel())[0, 1] > 0.6
