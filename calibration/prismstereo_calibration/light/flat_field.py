"""The flat field: how much light reaches each pixel of both views, measured on something evenly bright.

A white wall out of focus, an overcast sky, or paper held against the mirrors. What is dark in such a picture is the rig's own
doing. Several frames are averaged; one that is saturated or too dark to tell is refused by name, and so is a wall that
has a picture on it. What changes slowly across the wall itself cannot be told from the lens: turn the rig between frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.light.seam_band import seam_band
from prismstereo_calibration.photometry import Photometry, ViewLight
from prismstereo_calibration.seam import Seam
from prismstereo_hw.errors import ImageError
from prismstereo_hw.view import View

__all__ = ["GREY_RANGE", "FlatField", "measure"]

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Mask = NDArray[np.bool_]

GREY_RANGE = (40, 250)  # grey levels: a view's middle level above black, and where saturation begins
_MOST_SATURATED = 0.01
_MOST_TEXTURE = 0.03  # relative: what 95 % of the blocks keep within, once the smooth part is taken away
_COLUMNS, _ROWS = 16, 9
_BLOCK_PX = 8
_LIT = 0.3  # of a view's middle level: below, the rig lets hardly any light through
_STIFFNESS = 0.3  # of the grid against bending, in blocks: what carries it over where nothing is measured
_LEAST_LIT = 0.3  # of a view's blocks
_DIGITS = 4
_GAIN_RANGE = (0.05, 20.0)
_SMOOTH_PX = 9


@dataclass(frozen=True, slots=True)
class FlatField:
    """What a flat field tells: gains for both views, and their light, (height, width) float32, 1 in the left view's middle.

    `light` is that of the upright pictures without black level, smoothed over a few pixels. `right_gain` is how much brighter
    the left view is as a whole. `texture` is what the surface was not even by, relative: 95 % of the blocks of 8 pixels keep
    within it.
    """

    photometry: Photometry
    light: tuple[Grey, Grey]
    right_gain: float
    texture: float


def measure(
    frames: Sequence[NamedFrame],
    views: tuple[View, View],
    seam: Seam | None = None,
    dark: Sequence[NamedFrame] = (),
) -> FlatField:
    """Measure the light of both views from raw frames of an even surface; `dark` are frames with the lens cap on.

    Pixels in the seam's band, and those that get less than 30 % of their view's light, do not count: the gain goes on
    smoothly across them. `ImageError` for no frame, frames of two sizes, and for saturated, dark or textured ones by name.
    """
    if not frames:
        raise ImageError("0 frames: the flat field is measured in pictures of an even surface, give one or more")
    _require_one_size([*frames, *dark])
    black_grey = float(np.median([np.median(frame.pixels) for frame in dark])) if dark else 0.0
    for frame in frames:
        _require_lit(frame, views, black_grey)
    means = [_mean_grey(frames, view) - np.float32(black_grey) for view in views]
    height, width = frames[0].pixels.shape[:2]
    usable = _usable(means, seam, views, (width, height // views[0].exposures))
    blocks = [_Blocks.of(mean, use) for mean, use in zip(means, usable, strict=True)]
    _require_enough(frames, blocks)
    middle = blocks[0].middle()
    grids = [_fit(block, middle) for block in blocks]
    texture = max(_texture(block, grid, middle) for block, grid in zip(blocks, grids, strict=True))
    if texture > _MOST_TEXTURE:
        raise ImageError(
            f"{_names(frames)}: no flat field, the light differs by {100 * texture:.1f} % within a few pixels, and "
            f"{100 * _MOST_TEXTURE:g} % is the most: defocus the lens, or hold white paper before the mirrors"
        )
    one = float((_hats(np.array([[0.5, 0.5]])) @ grids[0].ravel())[0])
    left, right = (ViewLight((grid / one).round(_DIGITS).astype(np.float32), black_grey) for grid in grids)
    light = [np.asarray(cv2.blur(mean, (_SMOOTH_PX, _SMOOTH_PX)) / middle, np.float32) for mean in means]
    right_gain = float(np.median(blocks[0].level) / np.median(blocks[1].level))
    return FlatField(Photometry(left, right), (light[0], light[1]), right_gain, texture)


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Mean levels (N,) of blocks of usable pixels, and the middles (N, 2) of the blocks as parts 0..1 of the view.

    `share` is that of these blocks among all of the view's.
    """

    level: Array
    place: Array
    share: float

    @classmethod
    def of(cls, mean: Grey, usable: Mask) -> _Blocks:
        h, w = mean.shape
        rows, columns = (np.arange(0, n - _BLOCK_PX // 2, _BLOCK_PX) for n in (h, w))

        def sums(values: Grey) -> Array:
            down = np.add.reduceat(values, rows, axis=0, dtype=np.float64)
            return np.asarray(np.add.reduceat(down, columns, axis=1))

        count, total = sums(usable.astype(np.float32)), sums(np.where(usable, mean, 0))
        size = np.outer(np.diff(np.append(rows, h)), np.diff(np.append(columns, w)))
        whole = count > 0.99 * size  # a block half in the band has its middle elsewhere
        middles = [(begin + np.append(begin[1:], n) - 1) / 2 / (n - 1) for begin, n in ((columns, w), (rows, h))]
        place = np.stack(np.meshgrid(*middles), axis=-1)
        return cls((total / np.maximum(count, 1))[whole], place[whole], float(whole.mean()))

    def middle(self) -> float:
        """Return the level in the middle of the view: median of the middle ninth."""
        near = (np.abs(self.place - 0.5) < 1 / 6).all(axis=1)
        return float(np.median(self.level[near] if near.any() else self.level))


def _require_one_size(frames: Sequence[NamedFrame]) -> None:
    first = frames[0]
    for frame in frames:
        if frame.pixels.shape[:2] != first.pixels.shape[:2]:
            sizes = ["{1}x{0}".format(*each.pixels.shape) for each in (frame, first)]
            raise ImageError(f"{frame.name} is {sizes[0]}, but {first.name} is {sizes[1]}: give frames of one mode")


def _require_lit(frame: NamedFrame, views: tuple[View, View], black_grey: float) -> None:
    least, saturated = GREY_RANGE
    for side, view in zip(("left", "right"), views, strict=True):
        cut = view.cut(frame.pixels)
        share = float(np.mean(cut >= saturated))
        if share > _MOST_SATURATED:
            raise ImageError(
                f"{frame.name} is saturated: {100 * share:.1f} % of its {side} view has {saturated} grey levels or more, and "
                f"{100 * _MOST_SATURATED:g} % is the most: expose for half as long"
            )
        level = float(np.median(cut)) - black_grey
        if level < least:
            raise ImageError(
                f"{frame.name} is dark: its {side} view has {level:.0f} grey levels over black, and {least} is the least: "
                "expose longer, or give more light"
            )


def _usable(
    means: Sequence[Grey], seam: Seam | None, views: tuple[View, View], frame_size: tuple[int, int]
) -> list[Mask]:
    """Tell which pixels of each view get their own light, and enough of it."""
    usable = [np.asarray(mean > _LIT * np.median(mean)) for mean in means]
    if seam is None:
        return usable
    return [lit & ~band for lit, band in zip(usable, seam_band(seam, views, *frame_size), strict=True)]


def _require_enough(frames: Sequence[NamedFrame], blocks: Sequence[_Blocks]) -> None:
    for side, block in zip(("left", "right"), blocks, strict=True):
        if block.share < _LEAST_LIT:
            raise ImageError(
                f"{_names(frames)}: only {100 * block.share:.0f} % of the {side} view is lit and clear of the seam, and "
                f"{100 * _LEAST_LIT:g} % is the least: check the seam, and what stands before the mirrors"
            )


def _mean_grey(frames: Sequence[NamedFrame], view: View) -> Grey:
    total = np.zeros(view.cut(frames[0].pixels).shape[:2], np.float64)
    for frame in frames:
        cut = np.ascontiguousarray(view.cut(frame.pixels))
        total += cv2.cvtColor(cut, cv2.COLOR_BGR2GRAY) if cut.ndim == 3 else cut
    return np.asarray(total / len(frames), np.float32)


def _names(frames: Sequence[NamedFrame]) -> str:
    return frames[0].name if len(frames) == 1 else f"{frames[0].name} and {len(frames) - 1} more"


def _hats(place: Array) -> Array:
    """Return how much of each node (rows x columns) each place (N, 2) takes, (N, nodes)."""
    across = np.maximum(0, 1 - np.abs(place[:, :1] * (_COLUMNS - 1) - np.arange(_COLUMNS)))
    down = np.maximum(0, 1 - np.abs(place[:, 1:] * (_ROWS - 1) - np.arange(_ROWS)))
    return np.asarray((down[:, :, None] * across[:, None, :]).reshape(len(place), -1))


def _bends() -> Array:
    """Return the second differences of the grid along rows and columns, (differences, nodes)."""
    number = np.eye(_ROWS * _COLUMNS).reshape(_ROWS, _COLUMNS, -1)
    bends = (np.diff(number, 2, axis=0), np.diff(number, 2, axis=1))
    return np.concatenate([bend.reshape(-1, _ROWS * _COLUMNS) for bend in bends])


def _fit(blocks: _Blocks, middle: float) -> Array:
    """Return the gains (rows, columns) with which all blocks come nearest to the level of the left view's middle."""
    A = _hats(blocks.place) * (blocks.level / middle)[:, None]
    bends = _STIFFNESS * _bends()
    normal = A.T @ A + bends.T @ bends
    gain = np.linalg.solve(normal, A.sum(axis=0)).reshape(_ROWS, _COLUMNS)
    return np.clip(gain, *_GAIN_RANGE)


def _texture(blocks: _Blocks, gain: Array, middle: float) -> float:
    even = _hats(blocks.place) @ gain.ravel() * blocks.level / middle
    return float(np.percentile(np.abs(even - 1), 95))
