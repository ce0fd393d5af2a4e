"""A camera with few pixels whose every part is real but the sensor, which draws its frames and obeys at once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ParamSpec, TypeVar

import cv2
import msgspec
import numpy as np

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.camera import CameraDesk, CameraSource
from prismstereo_device.control.controls import Controls
from prismstereo_device.control.optics_watch import OpticsWatch
from prismstereo_device.control.self_test import Facts
from prismstereo_device.control.settings import SettingRules, Settings
from prismstereo_device.control.stills import Stills
from prismstereo_device.matching import Matching
from prismstereo_device.objects import Held
from prismstereo_device.reopening import Patience
from prismstereo_device.sensors.base import Exposure, Limit, Sensor, SensorLimits, SensorMode, Still
from prismstereo_device.state import MemoryDisk
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Mode, Rig

P = ParamSpec("P")
T = TypeVar("T")

LIMITS = SensorLimits(Limit(10, 30_000), Limit(1, 16), Limit(1, 120), Limit(0, 255))
SENSOR_SIZE = (640, 480)
_SHIFT_PX = 10


@cache
def plain_rig() -> Rig:
    """A rig with few pixels and labels and no glass: its rectification is made in some 40 ms."""
    rig = Rig.read("wedge")
    camera = msgspec.structs.replace(rig.camera, video=Mode(width=320, height=180, rate_hz=30.0))
    return msgspec.structs.replace(rig, camera=camera, range=msgspec.structs.replace(rig.range, labels=64))


@cache
def plain_calibration(lens_position: int | None = None) -> bytes:
    """Flash bytes of the plain rig's calibration, made at a lens position."""
    return flash.pack(replace(Calibration.nominal(plain_rig()), lens_position=lens_position))


class AtOnce(Executor):
    """Does what is submitted before it returns."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        done: Future[T] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class DrawnSensor(Sensor):
    """Gives `frames` frames of 320x180, a wall at disparity 10 in both views; goes away before frame `lost_at`."""

    limits = LIMITS
    modes = (SensorMode(320, 180, "GREY", 30.0), SensorMode(*SENSOR_SIZE, "GREY"))

    def __init__(self, frames: int = 1000, *, lost_at: int | None = None, size: tuple[int, int] = (320, 180)) -> None:
        noise = np.random.default_rng(3).integers(0, 256, (size[1], size[0]), np.uint8)
        wall, half = cv2.GaussianBlur(noise, (0, 0), 1.0), size[0] // 2
        self.pixels = np.concatenate([wall[:, :half], wall[:, _SHIFT_PX : _SHIFT_PX + half]], axis=1)
        self.left, self.lost_at, self.index = frames, lost_at, 0
        self.asked: list[Any] = []
        self.lens_position: int | None = None
        self.refuses: tuple[type, ...] = ()
        self.closed = 0

    def read(self) -> RawFrame | None:
        if self.index == self.lost_at:
            raise DeviceError("the cable was pulled out")
        if self.index == self.left:
            return None
        frame = RawFrame(self.pixels, self.index, 1000 + self.index * 33_333, self.lens_position)
        self.index += 1
        return frame

    def set_exposure(self, exposure: Exposure) -> None:
        if Exposure in self.refuses:
            raise UsageError("the driver does not obey: set the exposure on the camera")
        self.asked.append(exposure)

    def set_rate(self, rate_hz: float) -> None:
        self.asked.append(("rate_hz", rate_hz))

    def set_lens(self, lens_position: int) -> None:
        self.asked.append(("lens", lens_position))
        self.lens_position = lens_position

    def still(self) -> Still:
        pixels = np.arange(SENSOR_SIZE[0] * SENSOR_SIZE[1], dtype=np.uint32).reshape(SENSOR_SIZE[::-1]).astype(np.uint8)
        return Still(RawFrame(pixels, self.index - 1, 1000 + (self.index - 1) * 33_333), (0, 0, *SENSOR_SIZE))

    def close(self) -> None:
        self.closed += 1


@dataclass
class SmallCamera:
    """A camera source around a sensor, and everything that it works for."""

    sensor: DrawnSensor
    settings: Settings = field(default_factory=lambda: Settings(matcher="bm"))
    calibration: bytes = field(default_factory=plain_calibration)
    reopen: Callable[[], Sensor] | None = None
    give_up_s: float | None = None

    def __post_init__(self) -> None:
        matching = Matching(self.calibration, self.settings)
        rules = SettingRules.of(
            self.sensor.limits, matching.picture, matcher="bm", calibrated_lens=matching.calibration.lens_position
        )
        self.controls = Controls(self.settings.checked(rules), rules)
        self.held: list[Held] = []
        self.facts: list[Facts] = []
        self.alive = 0
        self.stills = Stills(self.held.append, AtOnce())
        self.looks: list[Held] = []
        self.optics = OpticsWatch(AtOnce(), MemoryDisk(), self.looks.append)
        desk = CameraDesk(self.controls, self.stills, self.optics, self._tell, self._live)
        patience = Patience(0.001, 0.004, self.give_up_s)
        self.source = CameraSource(self.sensor, matching, desk, reopen=self.reopen, patience=patience, filter_set=2)

    def _tell(self, facts: Facts) -> None:
        self.facts.append(facts)
        self.controls.tested()

    def _live(self) -> None:
        self.alive += 1
