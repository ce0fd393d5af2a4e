"""How good a form of rectification is, in figures: how far matches miss their rows, and how the pictures are bent for it.

Measured on matches that it was not fitted to. Bending is that of the worse of the two views: an ordinary rotation leaves the
axes of a picture square (skew 0), its sides as long as they were (aspect 1) and its corners about as large (area ratio 1).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_calibration.uncalibrated.epipolar import homogeneous, mapped, row_errors, sampson
from prismstereo_calibration.uncalibrated.pictures import ViewPictures

__all__ = ["FORMS", "Form", "FormFigures", "evened", "figures"]

Array = NDArray[np.float64]
Form = Literal["quasi-euclidean-5", "quasi-euclidean-6", "quasi-euclidean-8", "hartley"]
FORMS: tuple[Form, ...] = ("quasi-euclidean-5", "quasi-euclidean-6", "quasi-euclidean-8", "hartley")

_Pixels = Annotated[float, Meta(ge=0, le=1e6)]
_BASELINE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # rows of both pictures are epipolar lines
_MOST_BENT = 1e3  # area ratio


class FormFigures(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One form, judged. Row errors are in rectified pixels of about the size of the raw ones, `sampson_px` in raw pixels.

    `focal_px` of a form that has one; `skew_deg` off a right angle; `aspect` and `area_ratio` as ratios, one being best.
    """

    form: Form
    focal_px: Annotated[float, Meta(gt=0, le=1e7)] | None
    row_error_mean_px: _Pixels
    row_error_median_px: _Pixels
    row_error_p95_px: _Pixels
    sampson_px: _Pixels
    skew_deg: Annotated[float, Meta(ge=0, le=180)]
    aspect: Annotated[float, Meta(gt=0, le=1e6)]
    area_ratio: Annotated[float, Meta(ge=1, le=1e6)]


def evened(H_left: Array, H_right: Array, pictures: ViewPictures) -> tuple[Array, Array] | None:
    """Scale both homographies alike so that the pictures keep their size in their middles; signs so that depth is positive.

    A smaller picture would have smaller row errors, and be no better. None where a view would be turned inside out.
    """
    scaled, area = [], 1.0
    for side, H in ((0, H_left), (1, H_right)):
        corners, middle = pictures.corners(side), pictures.corners(side).mean(axis=0)
        H = H / (homogeneous(middle) @ H[2])
        ahead = homogeneous(corners) @ H[2]
        if not (np.isfinite(H).all() and np.all(ahead > 1 / _MOST_BENT) and np.linalg.det(H) > 0):
            return None
        area *= _area(H, middle) / pictures.row_steps[side]  # left-out rows are to be filled
        scaled.append(H)
    smaller = np.diag([area**-0.25, area**-0.25, 1.0])
    return smaller @ scaled[0], smaller @ scaled[1]


def figures(
    form: Form, H_left: Array, H_right: Array, left: Array, right: Array, pictures: ViewPictures,
    focal_px: float | None = None,
) -> FormFigures | None:  # fmt: skip
    """Judge a pair of evened homographies on matches (N, 2); None where a view is bent beyond all use."""
    errors = np.abs(row_errors(H_left, H_right, left, right))
    apart = np.abs(sampson(H_right.T @ _BASELINE @ H_left, left, right))
    shapes = [_shape(H, pictures.corners(side), pictures.row_steps[side]) for side, H in ((0, H_left), (1, H_right))]
    skew, aspect, area = (max(one, other) for one, other in zip(*shapes, strict=True))
    if not (np.isfinite([skew, aspect, area]).all() and area <= _MOST_BENT and np.isfinite(errors).all()):
        return None
    return FormFigures(
        form=form,
        focal_px=focal_px,
        row_error_mean_px=float(errors.mean()),
        row_error_median_px=float(np.median(errors)),
        row_error_p95_px=float(np.percentile(errors, 95)),
        sampson_px=float(apart.mean()),
        skew_deg=skew,
        aspect=aspect,
        area_ratio=area,
    )


def _area(H: Array, pixel: Array) -> float:
    """Return by how much a homography enlarges the area around a pixel (2,)."""
    return float(np.linalg.det(H) / (homogeneous(pixel) @ H[2]) ** 3)


def _shape(H: Array, corners: Array, row_step: int) -> tuple[float, float, float]:
    """Return skew in degrees, aspect and ratio of areas of a picture with these corners (4, 2), each as far off as it is."""
    sides = (corners + np.roll(corners, -1, axis=0)) / 2  # top, right, bottom, left
    top, right, bottom, left = mapped(H, sides)
    across, down = right - left, bottom - top
    wide, high = float(np.hypot(*across)), float(np.hypot(*down))
    skew = abs(90 - math.degrees(math.acos(np.clip(across @ down / (wide * high), -1, 1))))
    aspect = wide / np.hypot(*(sides[1] - sides[3])) / (high / row_step / np.hypot(*(sides[2] - sides[0])))
    areas = [_area(H, corner) for corner in corners]
    return skew, float(max(aspect, 1 / aspect)), max(areas) / min(areas) if min(areas) > 0 else math.inf
