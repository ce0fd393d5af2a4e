"""The scene without its moving objects: as the video sees it, and as a still shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.dense_sift import DenseSift
from prismstereo.fusion.motion.features import Features
from prismstereo.fusion.motion.picture import grey, reduced, require_picture
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo_hw.errors import DataError

__all__ = ["Background"]

Picture = NDArray[np.uint8]
_MOST_FRAMES = 31
_ROWS_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Background:
    """`video` (height, width[, 3]) uint8 and `still` (height, width[, 3]) uint8 or None, both rectified; `grid` ties them.

    `sift` and `features` are what is known of `video`, kept because every frame is compared with it.
    """

    video: Picture
    still: Picture | None
    grid: Grid
    sift: DenseSift
    features: Features

    @classmethod
    def of(
        cls, video: Picture | None, still: Picture | None, grid: Grid, shape: tuple[int, ...] | None = None
    ) -> Background:
        """Make a background of a video picture, a still, or both; DataError for pictures that do not go together.

        Without a video picture the still is reduced to the video's `shape` (height, width); without a still there is nothing
        but the video to show what an object uncovers.
        """
        if still is not None:
            require_picture(still, "the background still")
        if video is None:
            if still is None or shape is None:
                raise DataError("no background: name a background picture, or give several frames to take it from")
            video = reduced(still, grid, shape)
        require_picture(video, "the background of the video")
        if still is not None and still.ndim != video.ndim:
            raise DataError("one background picture is grey and the other has colours: take both in the same way")
        flat = grey(video)
        return cls(video, still, grid, DenseSift.of(flat), Features.of_scene(flat))

    @classmethod
    def from_frames(cls, frames: Sequence[Picture], stills: Sequence[Picture], grid: Grid) -> Background:
        """Take the background from pictures with objects in them: what most of them show at each pixel.

        At least three frames (three stills, or none of them counts); an object must cover a pixel in fewer than half.
        """
        if len(frames) < 3:
            raise DataError(
                f"{len(frames)} frames tell no background: give three at least, or a picture of the empty scene"
            )
        return cls.of(_median(frames), _median(stills) if len(stills) >= 3 else None, grid)


def _median(pictures: Sequence[Picture]) -> Picture:
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        raise DataError(
            f"pictures of {len(shapes)} sizes tell no background: {sorted(shapes)[:3]}: give those of one camera mode"
        )
    step = -(-len(pictures) // _MOST_FRAMES)
    chosen = pictures[::step]
    found = np.empty_like(chosen[0])
    for top in range(0, len(found), _ROWS_AT_ONCE):  # so that the stack stays small
        rows = slice(top, top + _ROWS_AT_ONCE)
        found[rows] = np.median(np.stack([picture[rows] for picture in chosen]), axis=0)
    return found
