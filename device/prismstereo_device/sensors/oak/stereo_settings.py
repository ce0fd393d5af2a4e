"""What the camera's own stereo engine is set to, and what its numbers then mean.

depthai takes nonsense without a word as long as no camera is there, so every rule is checked here. Disparities come in steps of
2^-bits pixels; a disparity shift is left out of them, so it is added again (depthai-python #615).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.sensors.options import Options
from prismstereo_hw.errors import UsageError

__all__ = ["Median", "StereoSettings"]

Median = Literal["off", "3", "5", "7"]

_LABEL_STEP = 16
_SEARCHED, _SEARCHED_EXTENDED = 96, 192  # disparities from 0: it tells 0..95, and 0..190 in extended mode
_MOST_SHIFT_PX = 128
_BITS = (3, 4, 5)
_BITS_RVC4 = 4
_MOST_WIDTH_RVC2_PX = 1280


@dataclass(frozen=True, slots=True)
class StereoSettings:
    """`bits` of sub-pixel fraction; `extended` searches twice as far; `shift_px` begins the search there.

    `median` is the size of its median filter. `threshold` 0..255: only matches surer than this are kept, 0 keeps all.
    `confidence` and `preview` ask for the confidence map and the left rectified picture beside the disparity.
    """

    bits: int = 4
    extended: bool = False
    shift_px: int = 0
    median: Median = "off"
    threshold: int = 55
    confidence: bool = False
    preview: bool = False

    def __post_init__(self) -> None:
        """Refuse what the engine cannot do."""
        if self.bits not in _BITS:
            raise UsageError(f"bits={self.bits}: its sub-pixels have 3, 4 or 5 fractional bits")
        if self.median not in ("off", "3", "5", "7"):
            raise UsageError(f"median={self.median}: give off, 3, 5 or 7")
        if self.median != "off" and self.bits != 3:
            raise UsageError(
                f"median={self.median} with bits={self.bits}: its median filter takes 3 bits only, give bits=3"
            )
        if not 0 <= self.shift_px <= _MOST_SHIFT_PX or self.shift_px % _LABEL_STEP:
            raise UsageError(f"shift={self.shift_px}: give a multiple of {_LABEL_STEP} up to {_MOST_SHIFT_PX} pixels")
        if not 0 <= self.threshold <= 255:
            raise UsageError(f"threshold={self.threshold}: give 0 to 255")

    @classmethod
    def parse(cls, options: Options) -> StereoSettings:
        """Read bits, extended, shift, median, threshold, confidence and preview of a sensor's options."""
        return cls(
            bits=options.whole("bits", 1, 16) or 4,
            extended=options.flag("extended", default=False),
            shift_px=options.whole("shift", 0, 1 << 16) or 0,
            median=cast(Median, options.choice("median", ("off", "3", "5", "7"), "off")),
            threshold=55 if (threshold := options.whole("threshold", 0, 255)) is None else threshold,
            confidence=options.flag("confidence", default=False),
            preview=options.flag("preview", default=False),
        )

    @property
    def labels(self) -> int:
        """Number of disparities from 0 to the last one searched, the shift included: the labels of the window."""
        return self.shift_px + (_SEARCHED_EXTENDED if self.extended else _SEARCHED)

    def require_platform(self, platform: str) -> None:
        """Refuse what depthai says that only one kind of camera can do."""
        if platform == "RVC4" and (self.extended or self.shift_px or self.bits != _BITS_RVC4):
            raise UsageError(
                f"bits={self.bits}, extended={self.extended:d}, shift={self.shift_px}: sub-pixels, search and shift are fixed "
                f"on this camera (RVC4): leave bits={_BITS_RVC4}, extended=0, shift=0"
            )

    def require_picture(self, width: int, height: int, platform: str) -> None:
        """Refuse rectified pictures that the engine, or the warp before it, does not take."""
        if width % 16 or height % 4:
            raise UsageError(
                f"rectified pictures of {width}x{height}: the camera's warp takes widths in steps of 16 and heights in steps "
                "of 4: capture and calibrate another size, or use mode=capture"
            )
        if platform == "RVC2" and width > _MOST_WIDTH_RVC2_PX:
            raise UsageError(
                f"rectified pictures {width} pixels wide: this camera's stereo engine takes at most {_MOST_WIDTH_RVC2_PX}: "
                "calibrate a smaller mode, or use mode=capture"
            )

    def disparity(
        self,
        values: NDArray[np.uint16],
        window: DisparityWindow,
        seen: NDArray[np.bool_],
        sureness: NDArray[np.uint8] | None = None,
    ) -> DisparityMap:
        """Make the disparity map of the engine's numbers, (height, width) each.

        `values` 0 is unmatched. Outside `seen`, where the left view shows nothing, no number means anything. `sureness` is its
        confidence map, 255 the surest.
        """
        matched = (values > 0) & seen
        pixels = values.astype(np.float32) / np.float32(1 << self.bits) + np.float32(self.shift_px)
        confidence = None if sureness is None else np.where(matched, np.maximum(sureness, 1), 0).astype(np.uint8)
        return DisparityMap(np.where(matched, pixels, np.float32(np.nan)), window, confidence)
