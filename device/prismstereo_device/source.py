"""What a service serves: frames that are matched and stamped, and the one verb that makes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from prismstereo_device.disparity import DisparityMap

__all__ = ["FrameSource", "ProducedFrame"]


@dataclass(frozen=True, slots=True)
class ProducedFrame:
    """A matched frame on its way out.

    `index` rises from frame to frame (a gap tells the host of a drop) and travels modulo 2^32; `timestamp_us` is the
    device's clock at mid-exposure; `lens_position` None where the camera does not tell it.
    """

    index: int
    timestamp_us: int
    lens_position: int | None
    disparity: DisparityMap


class FrameSource(Protocol):
    """Whatever makes frames: sensor, rectifier and matcher behind one verb."""

    def read(self) -> ProducedFrame | None:
        """Make the next frame, however long it takes; None when there are no more."""
        ...
