"""What a service serves: frames that are matched and stamped, and the one verb that makes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.zones import ZoneDistances

__all__ = ["FrameSource", "ProducedFrame"]

_NO_CALIBRATION = bytes(8)


@dataclass(frozen=True, slots=True)
class ProducedFrame:
    """A frame on its way out, with what was asked for of it; what was not asked for is None.

    `index` rises from frame to frame (a gap tells the host of a drop) and travels modulo 2^32; `timestamp_us` is the
    device's clock at mid-exposure; `lens_position` None where the camera does not tell it. `calibration_hash` names, by 8
    bytes, the calibration that the disparity was made with; `filter_set` numbers the filters that ran. `preview` is the
    rectified left picture, `raw` the sensor's frame, (height, width[, 3]) uint8 each.
    """

    index: int
    timestamp_us: int
    lens_position: int | None
    disparity: DisparityMap | None
    calibration_hash: bytes = _NO_CALIBRATION
    filter_set: int = 0
    preview: NDArray[np.uint8] | None = None
    raw: NDArray[np.uint8] | None = None
    zones: ZoneDistances | None = None


class FrameSource(Protocol):
    """Whatever makes frames: sensor, rectifier and matcher behind one verb."""

    def read(self) -> ProducedFrame | None:
        """Make the next frame, however long it takes; None when there are no more."""
        ...
