"""How `prismstereo calibrate` tells what it found: one object with stable keys, or lines for people."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from prismstereo_calibration.common_field import SIDES
from prismstereo_calibration.judging.summary import summary
from prismstereo_calibration.rectification import rectification

if TYPE_CHECKING:
    from prismstereo_calibration.boards.board import Board
    from prismstereo_calibration.judging.quality import Quality
    from prismstereo_calibration.photometry import Photometry
    from prismstereo_calibration.seam import Seam
    from prismstereo_calibration.solving.solve import Solution

__all__ = ["account", "lines"]


def account(
    solution: Solution, quality: Quality, board: Board, seam: Seam | None, out: Path, others: list[Path]
) -> dict[str, object]:
    """Return everything that `--json` says."""
    calibration = solution.calibration
    window = rectification(calibration).window
    suffix = "mm" if calibration.unit == "mm" else "squares"
    return {
        **summary(solution, quality),
        "board": board.name,
        f"square_{suffix}": board.square,
        "glass": None
        if calibration.left.plate is None
        else {"thickness_mm": calibration.left.plate.thickness_mm, "index": calibration.left.plate.index},
        "seam": None
        if seam is None
        else {"column_px": seam.column_px, "slant_deg": seam.slant_deg, "width_px": seam.width_px},
        "outputs": [
            {
                "name": one.name,
                "width_px": one.width,
                "height_px": one.height,
                "scale": one.scale,
                "shift_px": [one.shift_x_px, one.shift_y_px],
                "rms_px": one.rms_px,
            }
            for one in calibration.outputs
        ],
        "light": None if calibration.photometry is None else _light(calibration.photometry),
        "masked_share": None
        if calibration.mask is None
        else {"left": calibration.mask.shares("left"), "right": calibration.mask.shares("right")},
        "lens_position": calibration.lens_position,
        "temperature_c": calibration.temperature_c,
        f"range_min_{suffix}": window.nearest,
        f"range_max_{suffix}": window.farthest,
        "labels": window.labels,
        "out": out,
        "further_views": others,
    }


def _light(photometry: Photometry) -> dict[str, object]:
    return {
        side: {"gain_min": float(view.gain.min()), "gain_max": float(view.gain.max()), "black_grey": view.black_grey}
        for side, view in (("left", photometry.left), ("right", photometry.right))
    }


def lines(
    solution: Solution, quality: Quality, board: Board, seam: Seam | None, out: Path, others: list[Path]
) -> list[str]:
    """Return what people read."""
    calibration = solution.calibration
    unit, lens, gap, plate = calibration.unit, calibration.left.lens, quality.triangulation_gap, calibration.left.plate
    told = [
        f"{out}: {calibration.model}, {board.name}, {len(solution.used)} views used, {len(solution.rejected)} rejected",
        *(f"  rejected {entry.name}: {entry.reason}" for entry in solution.rejected),
        *(f"  {path}: the left view with a further one" for path in others),
        f"  reprojection RMS    {solution.rms_px:.3f} px, {len(solution.rejected_corners)} corners rejected",
        f"  baseline            {calibration.baseline:.3f} +- {solution.baseline_sigma:.3f} {unit}"
        + ("" if plate is None else f", behind {plate.thickness_mm:.1f} mm of glass"),
        f"  focal length        {lens.fx_px:.1f} +- {solution.focal_sigma_px:.1f} px, principal point "
        f"{lens.cx_px:.1f}, {lens.cy_px:.1f}",
    ]
    if seam is not None:
        lean = "" if math.isnan(seam.slant_deg) else f", leaning {seam.slant_deg:.2f} deg"
        told.append(f"  seam                at column {seam.column_px:.1f}{lean}, {seam.width_px:.0f} px wide")
    if solution.warp is not None:
        told.append(f"  board               bends by {solution.warp[0]:.3f} and {solution.warp[1]:.3f} {unit}")
    told += [
        f"  {one.name:<19} {one.scale:.5f} times the video, shifted by {one.shift_x_px:.2f}, {one.shift_y_px:.2f} px"
        for one in calibration.outputs
    ]
    if calibration.photometry is not None:
        grids = calibration.photometry.left.gain, calibration.photometry.right.gain
        least, most = min(float(grid.min()) for grid in grids), max(float(grid.max()) for grid in grids)
        told.append(f"  light               evened out by gains of {least:.2f} to {most:.2f}")
    if calibration.mask is not None:
        shares = (sum(calibration.mask.shares(side).values()) for side in SIDES)
        told.append("  never matched       {:.1%} of the left view, {:.1%} of the right one".format(*shares))
    told += [
        f"  triangulation gap   {gap.mean:.4f} {unit} (variance {gap.variance:.2g})",
        f"  plane fit           {quality.plane_fit.mean:.4f} {unit} (variance {quality.plane_fit.variance:.2g}), "
        f"RMS {quality.plane_fit.rms:.4f}",
        f"  row error           {quality.row_error.mean_px:.3f} px, 95 % below {quality.row_error.p95_px:.3f}",
        *(f"  depth at {one.depth:<10.4g} +- {one.typical:.3g} {unit} by the calibration" for one in quality.maps),
        f"  verdict             {quality.verdict}",
    ]
    return told + [f"  add next            {view.sentence}" for view in quality.next_views[:1]]
