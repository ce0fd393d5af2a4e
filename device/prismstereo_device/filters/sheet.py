"""One disparity map on its way through a chain of filters, with all that its filters look at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.filter_kernels import take
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import ImageError

__all__ = ["Sheet"]

_SURE = np.uint8(255)


@dataclass(frozen=True, slots=True)
class Sheet:
    """Disparity (height, width) float32 pixels, NaN where unmatched, and what belongs to each pixel.

    `confidence` uint8, 0 where unmatched; `reasons` uint8, a `Reason` each; `picture` uint8, the grey left rectified picture or
    None; `filled` bool, or None where no filter fills. `time_us` is the device's time of mid-exposure, or None. Filters that
    can work on several bands of rows at once do so in `threads` threads.
    """

    disparity_px: NDArray[np.float32]
    confidence: NDArray[np.uint8]
    reasons: NDArray[np.uint8]
    window: DisparityWindow
    picture: NDArray[np.uint8] | None = None
    filled: NDArray[np.bool_] | None = None
    time_us: int | None = None
    threads: int = 1

    @classmethod
    def of(
        cls, given: DisparityMap, picture: NDArray[np.uint8] | None = None, time_us: int | None = None, threads: int = 1
    ) -> Sheet:
        """Begin with a map; all matches are equally sure where the matcher does not tell.

        `ImageError` for a picture that is not an 8-bit one of the map's size; colours are turned to grey.
        """
        disparity_px = np.ascontiguousarray(given.disparity_px, np.float32)
        confidence, reasons = given.confidence, given.reasons
        if confidence is None or reasons is None:
            unmatched = np.isnan(disparity_px).view(np.uint8)
            confidence = (1 - unmatched) * _SURE if confidence is None else confidence
            reasons = unmatched * np.uint8(Reason.UNMATCHED) if reasons is None else reasons
        return cls(
            disparity_px,
            np.ascontiguousarray(confidence),
            np.ascontiguousarray(reasons),
            given.window,
            None if picture is None else _grey(picture, disparity_px.shape),
            None,
            time_us,
            threads,
        )

    def without(self, taken: NDArray[np.bool_], reason: Reason) -> Sheet:
        """Take matches (height, width) away, for a reason; where there is none the old reason stays."""
        disparity_px, confidence, reasons = self.disparity_px.copy(), self.confidence.copy(), self.reasons.copy()
        if not take(taken, int(reason), disparity_px, confidence, reasons):
            return self
        filled = None if self.filled is None else self.filled & ~taken
        return replace(self, disparity_px=disparity_px, confidence=confidence, reasons=reasons, filled=filled)


def _grey(picture: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    if picture.dtype != np.uint8 or picture.shape[:2] != shape or picture.shape[2:] not in ((), (3,)):
        raise ImageError(
            f"the picture is {picture.dtype} {picture.shape}, but the disparity map {shape}: give the 8-bit left rectified "
            "picture that was matched"
        )
    picture = np.ascontiguousarray(picture)
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8) if picture.ndim == 3 else picture
