"""The account of a calibration as one plain object, for `--json`: stable keys, the unit in each."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np

from prismstereo_calibration.judging.criteria import Criterion
from prismstereo_calibration.judging.next_view import NextView
from prismstereo_calibration.judging.quality import Quality
from prismstereo_calibration.solving.solve import Solution

__all__ = ["summary", "view_rms_px"]

Account = dict[str, object]


def summary(solution: Solution, quality: Quality) -> Account:
    """Return the figures of a solution and its quality; `baseline_mm` or `baseline_squares` is null, as the unit says.

    `focal_px`, `principal_point_px` and `distortion` (k1, k2, p1, p2, k3) are the left view's in upright full-frame
    pixels, the same with `right_` in front the right view's; with one lens and no mirrored view they are equal. Lengths
    have `_mm` or `_squares` in their keys.
    """
    suffix = "mm" if solution.calibration.unit == "mm" else "squares"
    return _fit(solution, suffix) | _accuracy(quality, suffix) | _advice(quality, suffix)


def view_rms_px(solution: Solution) -> list[list[float | None]]:
    """Return the reprojection rms of each frame (rows) in each view, left first; None where a view shows no corner."""
    square = np.sum(solution.residuals_px**2, axis=-1)
    counts = np.isfinite(square).sum(axis=2)
    means = np.nansum(square, axis=2) / np.maximum(counts, 1)
    return [
        [math.sqrt(mean) if count else None for mean, count in zip(*row, strict=True)]
        for row in zip(means.tolist(), counts.tolist(), strict=True)
    ]


def _fit(solution: Solution, suffix: str) -> Account:
    """Tell what was solved, from which frames, and how well they are met."""
    calibration = solution.calibration
    metric = calibration.unit == "mm"
    corners = np.isfinite(solution.residuals_px).all(axis=-1).sum(axis=2).tolist()
    account: Account = {
        "model": calibration.model,
        "rounds": solution.rounds,
        "rms_px": solution.rms_px,
        "rms_left_px": solution.rms_left_px,
        "rms_right_px": solution.rms_right_px,
        "views_used": len(solution.used),
        "views_rejected": [{"file": entry.name, "reason": entry.reason} for entry in solution.rejected],
        "views": [
            {"file": name, "rms_px": float(rms), "rms_by_view_px": by_view, "corners_by_view": count}
            for name, rms, by_view, count in zip(
                solution.used, solution.frame_rms_px, view_rms_px(solution), corners, strict=True
            )
        ],
        "corners_rejected": [
            {"file": one.name, "view": one.view, "corner": one.corner, "off_px": one.off_px}
            for one in solution.rejected_corners
        ],
        "baseline_mm": calibration.baseline if metric else None,
        "baseline_squares": None if metric else calibration.baseline,
        f"baseline_sigma_{suffix}": solution.baseline_sigma,
        "focal_sigma_px": solution.focal_sigma_px,
        f"board_warp_{suffix}": None if solution.warp is None else [float(bend) for bend in solution.warp],
    }
    for prefix, camera in (("", calibration.left), ("right_", calibration.right)):
        lens = camera.lens
        account[f"{prefix}focal_px"] = lens.fx_px
        account[f"{prefix}principal_point_px"] = [lens.cx_px, lens.cy_px]
        account[f"{prefix}distortion"] = list(lens.distortion)
    return account


def _accuracy(quality: Quality, suffix: str) -> Account:
    """Tell how well the board comes out, and how well depth will."""
    gap, plane, floor = quality.triangulation_gap, quality.plane_fit, quality.floor
    return {
        f"triangulation_gap_{suffix}": {"mean": gap.mean, "variance": gap.variance},
        f"plane_fit_{suffix}": asdict(plane),
        f"noise_floor_{suffix}": floor and {"triangulation_gap": floor.triangulation_gap, "plane_fit": floor.plane_fit},
        "row_error_px": {"mean": quality.row_error.mean_px, "p95": quality.row_error.p95_px},
        "scale_error": {"mean": quality.scale_error.mean, "rms": quality.scale_error.rms},
        "coverage": dict(zip(("left", "right"), map(_finite, quality.coverage), strict=False)) or None,
        "depth_uncertainty": [
            {
                f"depth_{suffix}": one.depth,
                f"sigma_{suffix}": one.typical,
                f"worst_sigma_{suffix}": one.worst,
                f"matching_sigma_{suffix}": one.typical_matching,
            }
            for one in quality.maps
        ],
        "verdict": quality.verdict,
        "criteria": [_criterion(one, quality.yardstick, suffix) for one in quality.criteria],
    }


def _criterion(one: Criterion, depth: float, suffix: str) -> Account:
    """Tell a criterion in its own unit and, where it is worth a length, as that."""
    lengths = one.lengths
    return {
        "name": one.name,
        "value": one.value,
        "good": one.good,
        "usable": one.usable,
        "unit": one.unit,
        "at_least": one.at_least,
        "band": one.band,
        f"worth_{suffix}": lengths
        and dict(zip((f"at_depth_{suffix}", "value", "good", "usable"), (depth, *lengths), strict=True)),
    }


def _advice(quality: Quality, suffix: str) -> Account:
    """Tell how well the rig was put together, and what view to add."""
    built = quality.assembly
    return {
        "assembly": {
            "turn_deg": built.turn_deg,
            "axis_off_columns_deg": built.axis_off_columns_deg,
            f"shift_along_axis_{suffix}": built.shift_along_axis,
            "shift_share": built.shift_share,
            "pitch_deg": built.pitch_deg,
            "roll_deg": built.roll_deg,
            "asymmetry_deg": built.asymmetry_deg,
        },
        "next_views": [_next_view(view, suffix) for view in quality.next_views],
    }


def _next_view(view: NextView, suffix: str) -> Account:
    return {
        "advice": view.sentence,
        f"board_depth_{suffix}": view.place.depth,
        "board_middle_px": [float(pixel) for pixel in view.place.middle_px],
        "tilt_about": view.place.about or None,
        "tilt_deg": view.place.tilt_deg,
        f"depth_{suffix}": view.depth_of_sigma,
        f"sigma_before_{suffix}": view.sigma_before,
        f"sigma_after_{suffix}": view.sigma_after,
        "mean_share_before": view.share_before,
        "mean_share_after": view.share_after,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
