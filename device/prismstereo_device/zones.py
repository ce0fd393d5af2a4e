"""Obstacle zones: the nearest distance in each field of a grid over the picture, small enough for the slowest line.

A robot's floor would be the nearest thing in every lower zone, so it is taken out first. In a disparity map a plane of the
scene is a plane: disparity + offset = a x + b y + c, and its normal in the camera's frame is (a, b, (a cx + b cy + c) / f)
up to a factor. A floor is the plane below the camera that holds most of the picture's lower part and whose normal is near
enough to the picture's vertical; whatever stands on it has a larger disparity than the floor has there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification
from prismstereo_device.disparity import DisparityMap

__all__ = ["ZoneDistances", "ZoneFinder"]

Array = NDArray[np.float64]

_ROWS, _COLUMNS = 4, 8
_NOTHING, _FAR = 0, 65535  # in the grid; a distance lies between
_NEAREST_SHARE = 0.01  # of a zone's pixels: a thing of that size counts, fewer are taken for noise
_LEAST_PIXELS = 12
_SAMPLES = (24, 32)  # of the picture's lower part, rows and columns
_LOWER_PART = 0.45  # of the height, from where on a floor is looked for
_TRIALS = 160
_NEAR_PLANE_PX = 1.0  # a floor is rough and matching is noisy
_LEAST_SEEN = 0.2  # of the samples: fewer matches tell of no floor
_FLOOR_SHARE = 0.35  # of the samples that are matched
_FLOOR_COLUMNS = 0.5  # of the columns of samples: a box's top is no floor
_MOST_ROLL_DEG = 20.0
_MOST_PITCH_DEG = 50.0  # how far a camera may look down at it, or up
_ROUNDS = 4
_CLEAR_OF_FLOOR = 0.06  # of the floor's disparity: a camera 0.5 m above it sees what stands higher than 3 cm
_CLEAR_OF_FLOOR_PX = 1.5


@dataclass(frozen=True, slots=True)
class ZoneDistances:
    """Nearest distance along the rectified z axis of each zone, (rows, columns) uint16 mm, of frame `index`.

    0: nothing was measured there; 65535: all that was measured is floor, or as far as that. `floor_removed` says whether a
    floor was found and left out.
    """

    index: int
    timestamp_us: int
    nearest_mm: NDArray[np.uint16]
    floor_removed: bool = False


@dataclass(frozen=True, slots=True)
class ZoneFinder:
    """Finds the zones of one rectification's disparity maps; 4 rows of 8 zones unless told otherwise."""

    rectification: Rectification
    rows: int = _ROWS
    columns: int = _COLUMNS

    def find(self, disparity: DisparityMap, index: int, timestamp_us: int) -> ZoneDistances:
        """Give the zones of a map, of the rectification's size or decimated by a whole number."""
        inverse = _inverse_depth(disparity)
        floor = self._floor(inverse)
        left = inverse if floor is None else np.where(_stands_out(inverse, floor), inverse, np.float32(np.nan))
        scale = disparity.window.scale_px
        grid = np.zeros((self.rows, self.columns), np.uint16)
        for row, (seen_band, left_band) in enumerate(zip(_cut(inverse, self.rows), _cut(left, self.rows), strict=True)):
            seen_zones = _cut(seen_band.T, self.columns)
            for column, (seen, zone) in enumerate(zip(seen_zones, _cut(left_band.T, self.columns), strict=True)):
                grid[row, column] = _nearest(seen, zone, scale)
        return ZoneDistances(index, timestamp_us, grid, floor is not None)

    def _floor(self, inverse: NDArray[np.float32]) -> Array | None:
        """Find the floor as (a, b, c) of disparity + offset = a x + b y + c; None where there is none."""
        points = _samples(inverse)
        if len(points) < _LEAST_SEEN * _SAMPLES[0] * _SAMPLES[1]:
            return None
        scale = self.rectification.width / inverse.shape[1]
        planes = [plane for plane in _trials(points) if self._lies_like_a_floor(plane, scale)]
        if not planes:
            return None
        best = max(planes, key=lambda plane: np.count_nonzero(_near(points, plane)))
        for _ in range(_ROUNDS):
            near = points[_near(points, best)]
            if len(near) < 3:
                return None
            best = np.asarray(np.linalg.lstsq(_terms(near), near[:, 2], rcond=None)[0], np.float64)
        near = points[_near(points, best)]
        wide = len(np.unique(near[:, 0])) / _SAMPLES[1]
        enough = len(near) >= _FLOOR_SHARE * len(points) and wide >= _FLOOR_COLUMNS
        return best if enough and self._lies_like_a_floor(best, scale) else None

    def _lies_like_a_floor(self, plane: Array, scale: float) -> bool:
        """Tell whether a plane lies below the camera and level enough; `scale` makes full pixels of the map's."""
        how = self.rectification
        a, b, c = plane
        across, down = a * how.focal_px / scale, b * how.focal_px / scale
        ahead = a * how.left.cx_px / scale + b * how.cy_px / scale + c
        if down <= 0:
            return False
        roll_deg = math.degrees(math.atan2(abs(across), down))
        pitch_deg = math.degrees(math.atan2(abs(ahead), down))
        return roll_deg <= _MOST_ROLL_DEG and pitch_deg <= _MOST_PITCH_DEG


def _inverse_depth(disparity: DisparityMap) -> NDArray[np.float32]:
    """Return disparity + offset, glass considered: (height, width) pixels, in proportion to 1 / depth; NaN unmatched."""
    window, found = disparity.window, disparity.disparity_px
    if window.glass is not None and found.shape == (window.glass.height, window.glass.width):
        found = found + window.glass.missing_px(found)
    return np.asarray(found + np.float32(window.offset_px), np.float32)


def _samples(inverse: NDArray[np.float32]) -> Array:
    """Return (N, 3) columns, rows and values of a grid of matched pixels in the lower part of the picture."""
    height, width = inverse.shape
    rows = np.linspace(_LOWER_PART * height, height - 1, _SAMPLES[0]).astype(int)
    columns = np.linspace(0, width - 1, _SAMPLES[1]).astype(int)
    x, y = np.meshgrid(columns, rows)
    points = np.stack([x, y, inverse[y, x]], axis=-1).reshape(-1, 3).astype(np.float64)
    return points[np.isfinite(points[:, 2])]


def _terms(points: Array) -> Array:
    return np.concatenate([points[:, :2], np.ones((len(points), 1))], axis=1)


def _near(points: Array, plane: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(_terms(points) @ plane - points[:, 2]) < _NEAR_PLANE_PX)


def _trials(points: Array) -> list[Array]:
    """Return planes through three samples each; the same samples, the same planes."""
    chosen = np.random.default_rng(len(points)).integers(0, len(points), (_TRIALS, 3))
    triples = points[chosen]
    terms = np.concatenate([triples[:, :, :2], np.ones((_TRIALS, 3, 1))], axis=2)
    apart = np.abs(np.linalg.det(terms)) > 1.0  # three points on a line span no plane
    return list(np.linalg.solve(terms[apart], triples[apart][:, :, 2:])[..., 0])


def _stands_out(inverse: NDArray[np.float32], floor: Array) -> NDArray[np.bool_]:
    """Tell which pixels are nearer than the floor would be there."""
    height, width = inverse.shape
    plane = floor[0] * np.arange(width) + floor[1] * np.arange(height)[:, None] + floor[2]
    return np.asarray(inverse - plane > np.maximum(_CLEAR_OF_FLOOR * plane, _CLEAR_OF_FLOOR_PX))


def _cut(picture: NDArray[np.float32], parts: int) -> list[NDArray[np.float32]]:
    """Cut (height, width) into bands of rows of next to equal height."""
    return np.array_split(picture, parts, axis=0)


def _nearest(seen: NDArray[np.float32], zone: NDArray[np.float32], scale: float) -> int:
    """Return the distance of the nearest thing of some size in a zone, mm; `seen` is the zone with its floor."""
    least = max(_LEAST_PIXELS, round(_NEAREST_SHARE * zone.size))
    if np.count_nonzero(np.isfinite(seen)) < least:
        return _NOTHING
    values = zone[np.isfinite(zone)]
    if len(values) < least:
        return _FAR
    value = float(np.partition(values, len(values) - least)[-least])
    return min(max(round(scale / value), 1), _FAR) if value > 0 else _FAR
