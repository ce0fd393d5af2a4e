"""What a calibration is worth: the criteria, the cameras with their sigmas, the board's figures, the maps of depth."""

from __future__ import annotations

import math

from prismstereo_calibration.judging.criteria import Criterion
from prismstereo_calibration.judging.quality import Quality
from prismstereo_calibration.judging.report.heat_map import colour_scale, heat_map
from prismstereo_calibration.judging.report.table import table, unit_name
from prismstereo_calibration.judging.uncertainty_map import MATCHING_NOISE_PX
from prismstereo_calibration.solving.solve import Solution

__all__ = ["cameras", "criteria", "figures", "maps"]

_LIMIT_PERCENT, _LAST_PERCENT = 0.5, 2.0  # those of the criterion for depth


def criteria(quality: Quality) -> str:
    """Return the table of criteria, in their own units and as lengths at one distance."""
    unit = unit_name(quality.unit)
    at = f"{unit} at {quality.yardstick:g} {unit}"
    head = ("figure", "value", "good", "usable", "unit", f"value, {at}", f"good, {at}", f"usable, {at}", "band")
    rows = [_row(one) for one in quality.criteria]
    note = '<p class="note">The verdict is the worst band. A figure in pixels is also said as the length that it is worth.</p>'
    return table(head, rows) + "\n" + note


def _row(one: Criterion) -> tuple[str, ...]:
    rule = "from" if one.at_least else "up to"
    lengths = ("-", "-", "-") if one.lengths is None else tuple(f"{length:.3g}" for length in one.lengths)
    return (
        one.name,
        f"{one.value:.4g}",
        f"{rule} {one.good:g}",
        f"{rule} {one.usable:g}",
        one.unit,
        *lengths,
        one.band,
    )


def cameras(solution: Solution) -> str:
    """Return the lenses of both views, and the baseline."""
    calibration = solution.calibration
    rows = []
    for name, camera in (("left", calibration.left), ("right", calibration.right)):
        lens = camera.lens
        rows.append(
            (
                name,
                f"{lens.fx_px:.2f}, {lens.fy_px:.2f}",
                f"{lens.cx_px:.2f}, {lens.cy_px:.2f}",
                ", ".join(f"{number:.5f}" for number in lens.distortion),
            )
        )
    lenses = table(("view", "focal length fx, fy px", "principal point px", "distortion k1, k2, p1, p2, k3"), rows)
    unit, plate = unit_name(calibration.unit), calibration.left.plate
    glass = "" if plate is None else f" Behind {plate.thickness_mm:g} mm of glass of index {plate.index:g}."
    warp = ""
    if solution.warp is not None:
        bends = " and ".join(f"{bend:+.3f}" for bend in solution.warp)
        warp = f" The board is bent: its middle stands off by {bends} {unit} along its rows and columns."
    return (
        f"{lenses}\n<p>Model {calibration.model}, frame {calibration.frame_width} x {calibration.frame_height} px. "
        f"Baseline {calibration.baseline:.4f} &plusmn; {solution.baseline_sigma:.4f} {unit}, focal length &plusmn; "
        f"{solution.focal_sigma_px:.2f} px (one standard deviation).{glass}{warp}</p>"
    )


def figures(quality: Quality) -> str:
    """Return how the board came out of the two views, beside what noise alone would make of it."""
    unit = unit_name(quality.unit)
    gap, plane, row, scale = quality.triangulation_gap, quality.plane_fit, quality.row_error, quality.scale_error
    floor = quality.floor
    floors = ("-", "-") if floor is None else (f"{floor.triangulation_gap:.5f}", f"{floor.plane_fit:.5f}")
    rows = (
        ("gap between the two rays of a corner", f"{gap.mean:.5f}", f"{gap.variance:.6f}", "-", floors[0], unit),
        (
            "distance from the board's plane",
            f"{plane.mean:.5f}",
            f"{plane.variance:.6f}",
            f"{plane.rms:.5f}",
            floors[1],
            unit,
        ),
        ("the same, nearest nine tenths", f"{plane.inlier_mean:.5f}", "-", "-", "-", unit),
        ("row error after rectification", f"{row.mean_px:.4f}", "-", f"95 %: {row.p95_px:.4f}", "-", "px"),
        ("size of the board, relative error", f"{scale.mean:+.5f}", "-", f"{scale.rms:.5f}", "-", ""),
    )
    note = (
        f'<p class="note">Over {quality.views} frames with the board in both views. Noise alone: the mean that the corners\' '
        "own noise makes at their mean distance; what is far above it is an error of the model or of the board.</p>"
    )
    return table(("figure", "mean", "variance", "rms", "noise alone", "unit"), rows) + "\n" + note


def maps(quality: Quality) -> str:
    """Return the uncertainty of depth over the left view, map by map, on one scale of colours."""
    unit = unit_name(quality.unit)
    if not quality.maps:
        return "<p>This calibration does not say how well its numbers are known, so there is no map.</p>"
    worst = max(100 * one.worst / one.depth for one in quality.maps)
    top = max(math.ceil(10 * worst) / 10, 2 * _LIMIT_PERCENT)
    drawings = []
    for one in quality.maps:
        label = f"one standard deviation of depth at {one.depth:.4g} {unit}"
        picture = heat_map(100 * one.calibration_sigma / one.depth, top, _LIMIT_PERCENT, label)
        drawings.append(
            f"<figure>{picture}<figcaption>at {one.depth:.4g} {unit}: typically {one.typical:.3g}, at worst {one.worst:.3g} "
            f"{unit}, limit {_LIMIT_PERCENT / 100 * one.depth:.3g} {unit}; the matcher adds {one.typical_matching:.3g} {unit}"
            "</figcaption></figure>"
        )
    scale = colour_scale(top, (_LIMIT_PERCENT, _LAST_PERCENT), "one standard deviation, % of depth")
    note = (
        '<p class="note">Over the left view, where both views see the point. What the calibration leaves open; framed fields '
        f"are beyond the limit of {_LIMIT_PERCENT:g} %. A matcher with {MATCHING_NOISE_PX:g} px of noise adds its own share, "
        "pixel by pixel.</p>"
    )
    return f'<figure>{scale}</figure>\n<div class="views maps">{"".join(drawings)}</div>\n{note}'
