"""Photometry: what each view must be multiplied by so that one thing has one brightness in both.

The two ways to the lens do not pass the same light: mirrors and glass differ, and a lens darkens its corners. `gain` is a
coarse grid over the upright picture of a view, its first node in the centre of the first pixel and its last in the centre
of the last, bilinear between; 1 in the middle of the LEFT view. Corrected = gain (measured - black).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.errors import ImageError

__all__ = ["GainMap", "Photometry", "PhotometryPart", "ViewLight", "ViewLightPart", "of_part", "part_of"]

_LEAST_GAIN, _MOST_GAIN = 0.02, 50.0
_MOST_NODES = 64
_MOST_BLACK = 128.0

_Gain = Annotated[float, Meta(ge=_LEAST_GAIN, le=_MOST_GAIN)]
_Nodes = Annotated[int, Meta(ge=2, le=_MOST_NODES)]
_Black = Annotated[float, Meta(ge=0, le=_MOST_BLACK)]


class ViewLightPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One view's light in the calibration file: the grid row by row, gains without a unit."""

    black_grey: _Black
    columns: _Nodes
    rows: _Nodes
    gain: Annotated[tuple[_Gain, ...], Meta(min_length=4, max_length=_MOST_NODES**2)]


class PhotometryPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Both views' light in the calibration file."""

    left: ViewLightPart
    right: ViewLightPart


@dataclass(frozen=True, slots=True)
class GainMap:
    """A view's gain and black level for pictures of one size, worked out once: gain (height, width) float32."""

    gain: NDArray[np.float32]
    black_grey: float

    def apply(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the picture (height, width[, 3]) as even light would give it, rounded; `ImageError` for another size."""
        if picture.shape[:2] != self.gain.shape:
            raise ImageError(
                f"the view is {picture.shape[1]}x{picture.shape[0]} pixels, but its gain map is for "
                f"{self.gain.shape[1]}x{self.gain.shape[0]}: make the map for the size of the pictures"
            )
        gain = self.gain if picture.ndim == 2 else self.gain[..., None]
        level = picture.astype(np.float32)
        if self.black_grey:
            level -= np.float32(self.black_grey)
        level *= gain
        level += np.float32(0.5)  # what is cut off becomes rounding
        return np.clip(level, 0, 255, out=level).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class ViewLight:
    """One view's gain on a grid (rows, columns) float32, and its black level in grey levels."""

    gain: NDArray[np.float32]
    black_grey: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no lens and no mirror does."""
        shape = self.gain.shape
        if len(shape) != 2 or not all(2 <= side <= _MOST_NODES for side in shape):
            raise CalibrationError(f"a gain grid of shape {shape}: give 2 to {_MOST_NODES} rows and columns")
        low, high = float(self.gain.min()), float(self.gain.max())
        if not (low >= _LEAST_GAIN and high <= _MOST_GAIN):  # NaN compares as False
            raise CalibrationError(
                f"the gain of a view goes from {low:g} to {high:g}: views of one lens stay within {_LEAST_GAIN:g} and "
                f"{_MOST_GAIN:g}, measure the flat field again"
            )
        if not 0 <= self.black_grey <= _MOST_BLACK:
            raise CalibrationError(f"a black level of {self.black_grey:g} grey levels: give 0 to {_MOST_BLACK:g}")

    def spread(self, width: int, height: int) -> GainMap:
        """Work the gain out for upright pictures of a size."""
        rows, columns = self.gain.shape
        along = _blend(columns, width)
        down = _blend(rows, height)
        return GainMap(np.asarray(down @ self.gain @ along.T, np.float32), self.black_grey)


@dataclass(frozen=True, slots=True)
class Photometry:
    """The light of both views."""

    left: ViewLight
    right: ViewLight

    @classmethod
    def even(cls, right_gain: float, black_grey: float = 0.0) -> Photometry:
        """Return two even views, the right one to be multiplied by a number: all that an ordinary scene tells."""
        one = np.ones((2, 2), np.float32)
        return cls(ViewLight(one, black_grey), ViewLight(np.float32(right_gain) * one, black_grey))


def part_of(photometry: Photometry) -> PhotometryPart:
    """Return the file form; gains come back exactly."""
    return PhotometryPart(left=_light_part(photometry.left), right=_light_part(photometry.right))


def of_part(part: PhotometryPart) -> Photometry:
    """Make the photometry that a file describes; `CalibrationError` names a view whose grid is not whole."""
    return Photometry(_light("left", part.left), _light("right", part.right))


def _light_part(light: ViewLight) -> ViewLightPart:
    rows, columns = light.gain.shape
    shortest = tuple(float(str(gain)) for gain in light.gain.ravel())  # a float32 says itself in 9 digits, not in 17
    return ViewLightPart(black_grey=float(light.black_grey), columns=columns, rows=rows, gain=shortest)


def _light(side: str, part: ViewLightPart) -> ViewLight:
    if len(part.gain) != part.rows * part.columns:
        raise CalibrationError(
            f"photometry.{side}.gain has {len(part.gain)} numbers for {part.rows} rows and {part.columns} columns: the file "
            "was damaged or written by hand"
        )
    return ViewLight(np.array(part.gain, np.float32).reshape(part.rows, part.columns), part.black_grey)


def _blend(nodes: int, pixels: int) -> NDArray[np.float32]:
    """Return how much of each node each pixel takes, (pixels, nodes)."""
    place = np.linspace(0, nodes - 1, pixels)
    return np.asarray(np.maximum(0, 1 - np.abs(place[:, None] - np.arange(nodes))), np.float32)
