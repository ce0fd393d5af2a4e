"""The camera as the service sees it: sensor and pipeline behind one verb."""

from __future__ import annotations

from prismstereo_device.pipeline import Pipeline
from prismstereo_device.sensors.base import Sensor
from prismstereo_device.source import ProducedFrame

__all__ = ["CameraSource"]


class CameraSource:
    """Reads a sensor and matches what it gives."""

    def __init__(self, sensor: Sensor, pipeline: Pipeline) -> None:
        self._sensor, self._pipeline = sensor, pipeline

    def read(self) -> ProducedFrame | None:
        """Make the next frame, stamped at mid-exposure; None after the sensor's last."""
        frame = self._sensor.read()
        if frame is None:
            return None
        return ProducedFrame(frame.index, frame.timestamp_us, frame.lens_position, self._pipeline.process(frame))
