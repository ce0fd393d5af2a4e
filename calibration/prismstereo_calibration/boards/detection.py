"""What was seen of the board: for every frame the board's corners in every view, and why the other frames do not count.

Pixels are upright coordinates of the view (those of its cut-out picture plus the corner of its rectangle, see
`prismstereo_hw.view`). Corner k of all views of a frame is the same corner of the board; NaN where a view does not show it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.view import View

__all__ = ["Detection", "NamedFrame", "Rejection", "Sighting"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NamedFrame:
    """A raw picture, (height, width[, 3]) uint8, and the name by which people know it (its file)."""

    name: str
    pixels: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Sighting:
    """The corners of the board in the views of one exposure, (views, N, 2) upright pixels, NaN where unseen."""

    name: str
    pixels: Array

    @classmethod
    def of(cls, name: str, *views: Array) -> Sighting:
        """Make the sighting of the upright pixels (N, 2) of each view, left first."""
        return cls(name, np.stack(views).astype(np.float64))

    @property
    def left(self) -> Array:
        """Upright pixels (N, 2) of the first view."""
        return np.asarray(self.pixels[0])

    @property
    def right(self) -> Array:
        """Upright pixels (N, 2) of the second view."""
        return np.asarray(self.pixels[1])

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Which corners (N,) the first two views both show."""
        return np.asarray(np.isfinite(self.pixels[:2]).all(axis=(0, 2)))


@dataclass(frozen=True, slots=True)
class Rejection:
    """A frame that does not count, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Detection:
    """Everything that was seen of the board: frame size, views, sightings in the order of the frames, rejections.

    The first two views are left and right; a rig with more mirrors may have more. The height is that of one exposure where
    the views are taken one after the other.
    """

    frame_width: int
    frame_height: int
    views: tuple[View, ...]
    sightings: tuple[Sighting, ...]
    rejected: tuple[Rejection, ...] = ()

    def only(self, names: Collection[str]) -> Detection:
        """Return this detection with the sightings of those frames alone."""
        return replace(self, sightings=tuple(one for one in self.sightings if one.name in names))

    def pixels(self) -> Array:
        """Return the upright pixels of all sightings, (frames, views, N, 2), NaN where unseen."""
        return np.stack([one.pixels for one in self.sightings])
