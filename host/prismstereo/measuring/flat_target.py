"""How good depth is on a flat target: the figures that makers of depth cameras state, by their definitions.

See `definitions` for what each of them means, word by word.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.patch import Patch
from prismstereo.measuring.relief import Relief
from prismstereo_calibration.judging.plane import PlaneFit
from prismstereo_hw.errors import UsageError

__all__ = ["ROI_SHARE", "FlatFigures", "PlaneDistances", "flat_figures"]

Array = NDArray[np.float64]

ROI_SHARE = 0.4  # of the picture, each way
_DROPPED = 0.005  # of the points, nearest and farthest, each
_FEWEST = 100
_SAMPLE = 1000  # points that the plane by trials is sought among
_FEWEST_FRAMES = 2


@dataclass(frozen=True, slots=True)
class PlaneDistances:
    """Absolute distances from the plane that 90 % of the points agree on: of all points, and the mean of those 90 %."""

    mean: float
    variance: float
    inlier_mean: float


@dataclass(frozen=True, slots=True)
class FlatFigures:
    """Figures of one target at one distance, means over its frames; `z_accuracy_percent` where the true distance is known.

    `temporal_noise_*` are None for a single frame.
    """

    frames: int
    roi: Patch
    distance_mm: float
    true_mm: float | None
    tilt_deg: float
    fill_percent: float
    z_accuracy_percent: float | None
    plane_rms_mm: float
    plane_rms_percent: float
    subpixel_rms_px: float
    plane_fit_mm: PlaneDistances
    temporal_noise_mm: float | None
    temporal_noise_percent: float | None
    temporal_rms_mm: float | None


@dataclass(frozen=True, slots=True)
class _Still:
    """The figures of one frame."""

    distance_mm: float
    tilt_deg: float
    fill: float
    off_mm: float
    rms_mm: float
    rms_px: float
    fit: PlaneFit


def flat_figures(reliefs: Sequence[Relief], true_mm: float | None = None, roi: Patch | None = None) -> FlatFigures:
    """Judge depth by frames of a flat target that fills the region of interest, by default the middle of the picture.

    `true_mm` is the distance of the target from the left pinhole, square to the target. `UsageError` for no frame, a frame with
    too little depth, or frames of several sizes.
    """
    if not reliefs:
        raise UsageError("0 frames: figures of a flat target need one or more")
    height, width = reliefs[0].inverse_px.shape
    if any(one.inverse_px.shape != (height, width) for one in reliefs):
        raise UsageError("the frames have depth maps of several sizes: give frames of one mode")
    patch = Patch.centred(width, height, ROI_SHARE) if roi is None else roi
    reliefs[0].require_inside(patch)
    stills = [_still(one, patch, true_mm) for one in reliefs]
    distance = float(np.mean([one.distance_mm for one in stills]))
    rms = float(np.mean([one.rms_mm for one in stills]))
    noise, noise_rms = _temporal_noise_mm(reliefs, patch)
    return FlatFigures(
        frames=len(stills),
        roi=patch,
        distance_mm=distance,
        true_mm=true_mm,
        tilt_deg=float(np.mean([one.tilt_deg for one in stills])),
        fill_percent=100 * float(np.mean([one.fill for one in stills])),
        z_accuracy_percent=None if true_mm is None else 100 * float(np.mean([one.off_mm for one in stills])) / true_mm,
        plane_rms_mm=rms,
        plane_rms_percent=100 * rms / distance,
        subpixel_rms_px=float(np.mean([one.rms_px for one in stills])),
        plane_fit_mm=PlaneDistances(
            float(np.mean([one.fit.mean for one in stills])),
            float(np.mean([one.fit.variance for one in stills])),
            float(np.mean([one.fit.inlier_mean for one in stills])),
        ),
        temporal_noise_mm=noise,
        temporal_noise_percent=None if noise is None else 100 * noise / distance,
        temporal_rms_mm=noise_rms,
    )


def _still(relief: Relief, patch: Patch, true_mm: float | None) -> _Still:
    points = relief.points(patch)
    if len(points) < _FEWEST:
        raise UsageError(
            f"{len(points)} of the {patch.pixels} pixels of {patch} have a depth, and a flat target needs {_FEWEST}: let the "
            "target fill the region, give it texture, or give another --roi"
        )
    order = np.argsort(points[:, 2], kind="stable")
    cut = int(_DROPPED * len(points))
    kept = points[order[cut : len(points) - cut]]
    middle = kept.mean(axis=0)
    normal = np.linalg.svd((kept - middle).T @ (kept - middle))[0][:, 2]  # the least axis of the scatter
    normal = normal if normal[2] > 0 else -normal
    distance = float(middle @ normal)
    off = kept @ normal - distance
    on_plane = kept - off[:, None] * normal
    rms_px = math.sqrt(float(np.mean((relief.scale_px / kept[:, 2] - relief.scale_px / on_plane[:, 2]) ** 2)))
    some = np.linspace(0, len(points) - 1, min(len(points), _SAMPLE)).astype(int)
    return _Still(
        distance_mm=distance,
        tilt_deg=math.degrees(math.acos(min(float(normal[2]), 1.0))),
        fill=len(points) / patch.pixels,
        off_mm=0.0 if true_mm is None else float(np.median(off)) + distance - true_mm,
        rms_mm=math.sqrt(float(np.mean(off**2))),
        rms_px=rms_px,
        fit=PlaneFit.of([points[some]]),
    )


def _temporal_noise_mm(reliefs: Sequence[Relief], patch: Patch) -> tuple[float | None, float | None]:
    """Return median and root mean square over pixels of the standard deviation of depth, of pixels matched in all frames."""
    if len(reliefs) < _FEWEST_FRAMES:
        return None, None
    rows, columns = slice(patch.y, patch.bottom), slice(patch.x, patch.right)
    depth = np.stack([one.scale_px / one.inverse_px[rows, columns] for one in reliefs])
    always = np.isfinite(depth).all(axis=0)
    if not always.any():
        return None, None
    moved = depth[:, always] - depth[0, always]
    deviation = moved.std(axis=0, ddof=1)
    return float(np.median(deviation)), float(np.sqrt(np.mean(deviation**2)))
