"""The simulated sensor: the optical twin behind the same interface as a camera."""

from __future__ import annotations

from dataclasses import replace

from prismstereo_device.sensors.base import Exposure, Limit, Pace, Sensor, SensorLimits, SensorMode, Still
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import BUILT_IN, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.twin import Twin

__all__ = ["TwinSensor"]

DEFAULT_SCENE = "desk"
_LIMITS = SensorLimits(exposure_us=Limit(10.0, 1e6), gain=Limit(0.1, 64.0), rate_hz=Limit(0.1, 1000.0))


class TwinSensor(Sensor):
    """Exposes a scene through the exact optics of a rig, frame by frame at the video rate of its clock.

    With a rate it is no faster than that, and its stamps lie as far apart. An exposure or a gain counts the light of the scene
    as `SensorModel` does, beside the noise that the twin has without them.
    """

    limits = _LIMITS

    def __init__(self, twin: Twin, *, frames: int | None = None, rate_hz: float | None = None) -> None:
        self.twin = twin
        self.rig = twin.rig
        video = twin.mode or twin.rig.camera.video
        self.modes = tuple(
            SensorMode(mode.width, mode.height, "GREY", mode.rate_hz) for mode in (video, twin.rig.camera.still)
        )
        self._as_made = twin
        self._frames, self._pace, self._index = frames, Pace(rate_hz), 0
        self._period_us = 1e6 / (rate_hz or twin.rig.camera.video.rate_hz)
        self._since = 0, 0.0  # the frame from which on this period holds, and its time in microseconds
        self._newest = 0, 0  # index and stamp

    @classmethod
    def parse(cls, argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> TwinSensor:
        """Make the sensor of RIG[:SCENE], e.g. `oak-1`, `oak-1:plane:500`, `my-rig.toml:desk`."""
        rig_name, _, scene = argument.partition(":")
        if rig_name not in BUILT_IN and ".toml" in argument:  # a path may itself hold a colon
            before, found, after = argument.rpartition(".toml:")
            rig_name, scene = (f"{before}.toml", after) if found else (argument, "")
        rig = Rig.read(rig_name)
        return cls(Twin(rig, named(rig, scene or DEFAULT_SCENE)), frames=frames, rate_hz=rate_hz)

    def read(self) -> RawFrame | None:
        """Expose the next frame; None after the last."""
        if self._frames is not None and self._index >= self._frames:
            return None
        self._pace.wait()
        self._newest = self._index, round(self._time_us(self._index))
        self._index += 1
        return self.twin.frame(*self._newest)

    def set_exposure(self, exposure: Exposure) -> None:
        """Count the light of so long an exposure, and multiply it by the gain; with neither, as the twin was made."""
        _require_within("exposure_us", exposure.exposure_us, _LIMITS.exposure_us)
        _require_within("gain", exposure.gain, _LIMITS.gain)
        twin = self._as_made
        if exposure != Exposure():
            plain = SensorModel(shot_noise=False)
            quiet = replace(plain, read_noise_electrons=twin.noise * plain.electrons_per_grey)
            sensor = twin.sensor or quiet
            exposure_us, gain = exposure.exposure_us or sensor.exposure_us, exposure.gain or sensor.gain
            twin = replace(twin, sensor=replace(sensor, exposure_us=exposure_us, gain=gain))
        self.twin = twin

    def set_rate(self, rate_hz: float) -> None:
        """Give frames so far apart, by the clock and by their stamps."""
        _require_within("rate_hz", rate_hz, _LIMITS.rate_hz)
        self._since = self._index, self._time_us(self._index)
        self._period_us = 1e6 / rate_hz
        self._pace.set_rate(rate_hz)

    def still(self) -> Still:
        """Expose the full sensor at the time of the newest frame: some seconds of computing."""
        camera = replace(self.twin, mode=self.twin.rig.camera.still, seed=self.twin.seed + 1)
        frame = camera.frame(*self._newest)
        return Still(frame, (0, 0, frame.width, frame.height))

    def _time_us(self, index: int) -> float:
        first, time_us = self._since
        return time_us + (index - first) * self._period_us


def _require_within(name: str, value: float | None, limit: Limit | None) -> None:
    if value is not None and limit is not None and not limit.least <= value <= limit.most:
        raise UsageError(f"{name} {value:g}: this sensor takes {limit.least:g} to {limit.most:g}")
