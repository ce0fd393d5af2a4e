"""The static mask: why a pixel of a view can never be matched, whatever the scene. Worked out once, kept with the calibration.

A code for every pixel of a view's upright picture (see `prismstereo_hw.view`). In the file it is small, since most pixels
have the code of the pixel above: rows are kept as their difference from the row above, deflated.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.view import Side

if TYPE_CHECKING:
    pass

__all__ = ["StaticMask", "StaticMaskPart", "StaticReason", "ViewMaskPart", "of_part", "part_of"]

_MOST_BYTES = 32 * 1024  # deflated, of one view: both fit into the calibration file
_LARGEST_SIDE_PX = 16384
_MOST_PIXELS = 64 * 1024 * 1024

_Side = Annotated[int, Meta(ge=1, le=_LARGEST_SIDE_PX)]


class StaticReason(IntEnum):
    """Why a pixel is no good; the name in small letters is the reason that a disparity map gives."""

    GOOD = 0
    OUTSIDE = 1  # the other view never sees it within the range window
    SEAM = 2  # both views lie over each other here, or it is the other view already
    VIGNETTED = 3  # hardly any light gets here


class ViewMaskPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One view's codes in the calibration file: base64 of what `_packed` makes."""

    width_px: _Side
    height_px: _Side
    codes: Annotated[bytes, Meta(max_length=_MOST_BYTES)]


class StaticMaskPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Both views' codes in the calibration file."""

    left: ViewMaskPart
    right: ViewMaskPart


@dataclass(frozen=True, slots=True)
class StaticMask:
    """The `StaticReason` of every pixel of both views' upright pictures, (height, width) uint8 each."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]

    def __post_init__(self) -> None:
        """Refuse what is no picture of codes."""
        for side, codes in (("left", self.left), ("right", self.right)):
            if codes.dtype != np.uint8 or codes.ndim != 2 or not codes.size or codes.max() > max(StaticReason):
                raise CalibrationError(
                    f"the {side} mask is {codes.dtype} {codes.shape}: give a code from 0 to {max(StaticReason):d} for every "
                    "pixel of the upright view"
                )

    def of(self, side: Side) -> NDArray[np.uint8]:
        """Return one view's codes (height, width)."""
        return self.left if side == "left" else self.right

    def require_sizes(self, left: tuple[int, int], right: tuple[int, int]) -> None:
        """Refuse views of other sizes (width, height) with `CalibrationError`."""
        for side, codes, (w, h) in (("left", self.left, left), ("right", self.right, right)):
            if codes.shape != (h, w):
                raise CalibrationError(
                    f"mask.{side} is for a view of {codes.shape[1]}x{codes.shape[0]} pixels, but the {side} view has {w}x{h}: "
                    "calibrate again, or leave the mask out"
                )

    def shares(self, side: Side) -> dict[str, float]:
        """Return the share 0..1 of a view's pixels that each reason has, by its name."""
        counts = np.bincount(self.of(side).ravel(), minlength=len(StaticReason))
        return {reason.name.lower(): float(counts[reason] / counts.sum()) for reason in StaticReason if reason}


def part_of(mask: StaticMask) -> StaticMaskPart:
    """Return the file form; `CalibrationError` for a mask so ragged that it would fill the file."""
    left, right = (
        ViewMaskPart(width_px=codes.shape[1], height_px=codes.shape[0], codes=_packed(codes))
        for codes in (mask.left, mask.right)
    )
    for side, part in (("left", left), ("right", right)):
        if len(part.codes) > _MOST_BYTES:
            raise CalibrationError(
                f"the {side} mask takes {len(part.codes)} bytes, and a file keeps {_MOST_BYTES}: it is ragged as only noise "
                "is, measure it from a better flat field"
            )
    return StaticMaskPart(left=left, right=right)


def of_part(part: StaticMaskPart) -> StaticMask:
    """Make the mask that a file describes; `CalibrationError` names the view whose codes are damaged."""
    return StaticMask(_unpacked("left", part.left), _unpacked("right", part.right))


def _packed(codes: NDArray[np.uint8]) -> bytes:
    above = np.vstack([np.zeros_like(codes[:1]), codes[:-1]])
    return zlib.compress((codes ^ above).tobytes(), 9)


def _unpacked(side: str, part: ViewMaskPart) -> NDArray[np.uint8]:
    count = part.width_px * part.height_px
    if count > _MOST_PIXELS:
        raise CalibrationError(f"mask.{side} claims {part.width_px}x{part.height_px} pixels: at most {_MOST_PIXELS}")
    opened = zlib.decompressobj()
    try:
        content = opened.decompress(part.codes, count + 1)  # a few bytes can deflate gigabytes: never more than asked
    except zlib.error as error:
        raise CalibrationError(
            f"mask.{side}.codes is damaged: {error}: restore the file, or calibrate again"
        ) from error
    if len(content) != count or not opened.eof or opened.unused_data:
        raise CalibrationError(
            f"mask.{side}.codes does not hold {part.width_px}x{part.height_px} codes: restore the file, or calibrate again"
        )
    rows = np.frombuffer(content, np.uint8).reshape(part.height_px, part.width_px)
    return np.asarray(np.bitwise_xor.accumulate(rows, axis=0), np.uint8)
