"""How far off a depth may be, over the image: by what the calibration does not know, and by what a matcher does not see.

Depth is z in the left camera's frame, as `triangulate` returns it. The left pixel stands fixed, and so does the right one,
where the calibration says that it is: what moves is the point that both are taken for. All figures are one standard
deviation, in the calibration's unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.sensitivity import derivative
from prismstereo_calibration.judging.triangulation import Rays, meet
from prismstereo_calibration.judging.view_field import at_depth, common, grid
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.uncertainty import Uncertainty

__all__ = [
    "MATCHING_NOISE_PX",
    "UncertaintyMap",
    "baseline_sigma",
    "depth_gradient",
    "depth_sigma",
    "matching_sigma",
    "scale_sigma",
    "uncertainty_maps",
    "usual_depths",
    "yardstick",
]

Array = NDArray[np.float64]

MATCHING_NOISE_PX = 0.25  # of a disparity, one standard deviation: what a matcher on plain surfaces leaves
_COLUMNS = 20
_METRE_MM = 1000.0
_STEPS_MM = (500.0, 1000.0, 2000.0)
_NEARLY = 0.02  # two depths so near each other, relative, are one


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyMap:
    """Standard deviations of depth at one depth, (rows, columns) over the left upright view; NaN outside the common field.

    `pixels` (rows, columns, 2) are the middles of the fields. `calibration_sigma` is the share of the calibration's numbers,
    `matching_sigma` that of a disparity with `MATCHING_NOISE_PX` of noise.
    """

    depth: float
    pixels: Array
    calibration_sigma: Array
    matching_sigma: Array

    @property
    def typical(self) -> float:
        """The median of the calibration's share."""
        return float(np.nanmedian(self.calibration_sigma))

    @property
    def worst(self) -> float:
        """The greatest of the calibration's share."""
        return float(np.nanmax(self.calibration_sigma))

    @property
    def typical_matching(self) -> float:
        """The median of the matcher's share."""
        return float(np.nanmedian(self.matching_sigma))


def depth_sigma(calibration: Calibration, left_px: Array, depth: float | Array) -> Array:
    """Return one standard deviation (...) of the depth of left upright pixels (..., 2) at depths (...).

    NaN where a pixel has no ray or its point is behind the right camera; `CalibrationError` without an uncertainty.
    """
    return _known(calibration).along(np.asarray(depth_gradient(calibration, left_px, depth)))


def depth_gradient(calibration: Calibration, left_px: Array, depth: float | Array) -> Array:
    """Return how the depths of left upright pixels (..., 2) at depths (...) move with the 24 numbers, (..., 24)."""
    left_px = np.asarray(left_px, np.float64)
    left_rays = calibration.left.rays(left_px)
    right_px = calibration.right.project(at_depth(calibration.left, left_px, depth))
    right_rays = calibration.right.rays(right_px)

    def found(left: Camera, right: Camera) -> Array:
        a: Rays = left_rays if left is calibration.left else left.rays(left_px)
        b: Rays = right_rays if right is calibration.right else right.rays(right_px)
        return np.asarray(meet(a, b)[0][..., 2])

    return derivative(calibration, found)


def matching_sigma(
    calibration: Calibration, left_px: Array, depth: float | Array, noise_px: float = MATCHING_NOISE_PX
) -> Array:
    """Return one standard deviation (...) of depth where a match in the right view is off by `noise_px` along its line."""
    nudge = 1e-5 * np.asarray(depth, np.float64)
    ahead, behind = (
        calibration.right.project(at_depth(calibration.left, np.asarray(left_px, np.float64), depth + by))
        for by in (nudge, -nudge)
    )
    return np.asarray(noise_px * 2 * nudge / np.linalg.norm(ahead - behind, axis=-1))


def uncertainty_maps(calibration: Calibration, depths: tuple[float, ...] | None = None) -> tuple[UncertaintyMap, ...]:
    """Return the maps at some depths, by default those of `usual_depths`, nearest first; none without an uncertainty.

    A depth at which the views have nothing in common is left out.
    """
    if calibration.uncertainty is None:
        return ()
    width, height = calibration.left_view.upright_size(calibration.frame_width, calibration.frame_height)
    rows = max(round(_COLUMNS * height * calibration.left_view.row_step / width), 2)
    pixels = grid(calibration, "left", _COLUMNS, rows)
    asked = sorted(usual_depths(calibration) if depths is None else depths)
    fields = [(depth, seen) for depth in asked if (seen := common(calibration, "left", pixels, depth)).any()]
    if not fields:
        return ()
    at = np.concatenate([np.full(int(seen.sum()), depth) for depth, seen in fields])
    where = np.concatenate([pixels[seen] for _, seen in fields])
    sigmas, noises = depth_sigma(calibration, where, at), matching_sigma(calibration, where, at)
    ends = np.cumsum([int(seen.sum()) for _, seen in fields])[:-1]
    return tuple(
        UncertaintyMap(depth, pixels, _spread(seen, sigma), _spread(seen, noise))
        for (depth, seen), sigma, noise in zip(fields, np.split(sigmas, ends), np.split(noises, ends), strict=True)
    )


def _spread(seen: NDArray[np.bool_], values: Array) -> Array:
    spread = np.full(seen.shape, np.nan)
    spread[seen] = values
    return spread


def usual_depths(calibration: Calibration) -> tuple[float, ...]:
    """Return 0.5, 1 and 2 m and the finite ends of the range; in squares: the near end, two and four times it, the far end."""
    near, far = calibration.range.near_mm, calibration.range.far_mm
    inner = _STEPS_MM if calibration.unit == "mm" else (2 * near, 4 * near)
    depths: list[float] = []
    for depth in (*inner, yardstick(calibration), near, far):
        if math.isfinite(depth) and all(abs(depth / other - 1) > _NEARLY for other in depths):
            depths.append(depth)
    return tuple(depths)


def yardstick(calibration: Calibration) -> float:
    """Return the depth at which figures are compared: 1 m if it is in the range, else the middle of the range."""
    near, far = calibration.range.near_mm, calibration.range.far_mm
    if calibration.unit == "mm" and near <= _METRE_MM <= far:
        return _METRE_MM
    return math.sqrt(near * far) if math.isfinite(far) else 2 * near


def baseline_sigma(calibration: Calibration) -> float:
    """Return one standard deviation of the baseline; `CalibrationError` without an uncertainty."""
    gradient = np.zeros(24)
    gradient[-3:] = calibration.right.t_camera_from_left / calibration.baseline
    return float(_known(calibration).along(gradient))


def scale_sigma(calibration: Calibration, depth: float) -> float:
    """Return one standard deviation of the relative depth error that the whole common field shares at a depth.

    NaN where there is no common field; `CalibrationError` without an uncertainty.
    """
    pixels = grid(calibration, "left", _COLUMNS, _COLUMNS)
    pixels = pixels[common(calibration, "left", pixels, depth)]
    if not len(pixels):
        return math.nan
    return float(_known(calibration).along(depth_gradient(calibration, pixels, depth).mean(axis=0) / depth))


def _known(calibration: Calibration) -> Uncertainty:
    if calibration.uncertainty is None:
        raise CalibrationError(
            f"the calibration of {calibration.rig!r} does not say how well its numbers are known: calibrate with this version"
        )
    return calibration.uncertainty
