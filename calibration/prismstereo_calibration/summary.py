"""The account of a calibration as one plain object, for `--json`: stable keys, the unit in each."""

from __future__ import annotations

from prismstereo_calibration.quality import Quality
from prismstereo_calibration.solve import Solution

__all__ = ["summary"]


def summary(solution: Solution, quality: Quality) -> dict[str, object]:
    """Return the figures of a solution and its quality; `baseline_mm` or `baseline_squares` is null, as the unit says.

    `focal_px`, `principal_point_px` and `distortion` (k1, k2, p1, p2, k3) are the left view's in upright full-frame
    pixels, the same with `right_` in front the right view's; with one lens and no mirrored view they are equal.
    """
    calibration = solution.calibration
    metric = calibration.unit == "mm"
    suffix = "mm" if metric else "squares"
    gap, plane = quality.triangulation_gap, quality.plane_fit
    account: dict[str, object] = {
        "model": calibration.model,
        "rms_px": solution.rms_px,
        "rms_left_px": solution.rms_left_px,
        "rms_right_px": solution.rms_right_px,
        "views_used": len(solution.used),
        "views_rejected": [{"file": entry.name, "reason": entry.reason} for entry in solution.rejected],
        "baseline_mm": calibration.baseline if metric else None,
        "baseline_squares": None if metric else calibration.baseline,
        f"baseline_sigma_{suffix}": solution.baseline_sigma,
        "focal_sigma_px": solution.focal_sigma_px,
    }
    for prefix, camera in (("", calibration.left), ("right_", calibration.right)):
        lens = camera.lens
        account[f"{prefix}focal_px"] = lens.fx_px
        account[f"{prefix}principal_point_px"] = [lens.cx_px, lens.cy_px]
        account[f"{prefix}distortion"] = list(lens.distortion)
    return account | {
        f"triangulation_gap_{suffix}": {"mean": gap.mean, "variance": gap.variance},
        f"plane_fit_{suffix}": {"mean": plane.mean, "variance": plane.variance, "rms": plane.rms},
        "row_error_px": {"mean": quality.row_error.mean_px, "p95": quality.row_error.p95_px},
        "scale_error": {"mean": quality.scale_error.mean, "rms": quality.scale_error.rms},
        "verdict": quality.verdict,
        "criteria": [
            {
                "name": one.name,
                "value": one.value,
                "good": one.good,
                "usable": one.usable,
                "unit": one.unit,
                "band": one.band,
            }
            for one in quality.criteria
        ],
    }
