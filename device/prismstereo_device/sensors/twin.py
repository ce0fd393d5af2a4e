"""The simulated sensor: the optical twin behind the same interface as a camera."""

from __future__ import annotations

from prismstereo_device.sensors.base import Pace, Sensor
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import BUILT_IN, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin

__all__ = ["TwinSensor"]

DEFAULT_SCENE = "desk"


class TwinSensor(Sensor):
    """Exposes a scene through the exact optics of a rig, frame by frame at the video rate of its clock."""

    def __init__(self, twin: Twin, *, frames: int | None = None, rate_hz: float | None = None) -> None:
        self.twin = twin
        self.rig = twin.rig
        self._frames, self._pace, self._index = frames, Pace(rate_hz), 0

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
        frame = self.twin.frame(self._index)
        self._index += 1
        return frame
