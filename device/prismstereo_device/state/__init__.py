"""What the camera keeps: calibrations that outlive a power cut, uploads that go on where they broke off."""

from prismstereo_device.state.acceptance import accepts
from prismstereo_device.state.calibration_slots import CalibrationSlots
from prismstereo_device.state.disk import Disk, MemoryDisk, RealDisk, StorageError
from prismstereo_device.state.shelf import Shelf
from prismstereo_device.state.staging import Staging

__all__ = ["CalibrationSlots", "Disk", "MemoryDisk", "RealDisk", "Shelf", "Staging", "StorageError", "accepts"]
