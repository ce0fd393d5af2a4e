"""The report of a calibration: one HTML page that needs nothing else, for a person and for a file cabinet.

Same input, same bytes: no date, no host, no random name. Every text from outside is escaped.
"""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.drawing import Box, bars, coverage, covered_share, magnification, residual_vectors
from prismstereo_calibration.fit import outlier_limit
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.quality import Quality, Verdict
from prismstereo_calibration.solve import Solution
from prismstereo_hw.view import View

__all__ = ["html"]

_SENTENCE: dict[Verdict, str] = {
    "good": "Good: every figure is within its first limit.",
    "usable": "Usable: a figure is beyond its first limit. It measures, with less than the accuracy this unit can have.",
    "redo": "Redo: a figure is beyond its last limit. Do not measure with this calibration.",
}

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --paper: #ffffff; --faint: #767676; --line: #c8c8c8;
  --mark: #0b62a4; --warn: #b3541e; --good: #1f7a3d; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #16181a; --faint: #9a9a9a; --line: #44484c;
  --mark: #6cb4ee; --warn: #f0a060; --good: #6fcf8e; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 56rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .2rem .9rem .2rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); } td.number { font-variant-numeric: tabular-nums; }
.verdict { font-size: 1.2rem; padding: .5rem .8rem; border-left: .4rem solid; }
.good { color: var(--good); } .usable { color: var(--warn); } .redo { color: var(--warn); font-weight: bold; }
.note { color: var(--faint); } .views { display: flex; flex-wrap: wrap; gap: 1rem; } figure { margin: 0; }
svg { max-width: 100%; height: auto; } svg text { font: 11px system-ui, sans-serif; fill: var(--ink); }
svg .name { text-anchor: end; } svg .middle { text-anchor: middle; } svg .bar, svg .cell { fill: var(--mark); }
svg .over { fill: var(--warn); } svg .limit { stroke: var(--warn); stroke-dasharray: 4 3; } svg .dot { fill: var(--ink); }
svg .border { fill: none; stroke: var(--line); } svg .arrow { stroke: var(--warn); fill: none; }
svg .scale { stroke: var(--ink); stroke-width: 2; fill: none; }
@media print { body { margin: 0; max-width: none; } }
"""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def html(solution: Solution, quality: Quality, *, title: str = "Calibration report") -> str:
    """Return the report page of a solution and its quality."""
    calibration = solution.calibration
    sections = [
        f'<p class="verdict {quality.verdict}">{escape(_SENTENCE[quality.verdict])}</p>',
        _section("What the verdict rests on", _criteria(quality)),
        _section("Cameras", _cameras(solution)),
        _section("Accuracy on the board", _figures(quality)),
        _section("Frames", _frames(solution)),
        _section("Where the corners were", _coverage(solution)),
        _section("What is left over", _leftover(solution)),
    ]
    body = "\n".join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}: {escape(calibration.rig)}</h1>\n{body}\n</body>\n</html>\n"
    )


def _section(heading: str, content: str) -> str:
    return f"<section>\n<h2>{escape(heading)}</h2>\n{content}\n</section>"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Draw a table; every cell but the first of a row is a number or a short word. Cells are escaped here."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = []
    for row in rows:
        first, *rest = row
        cells = "".join(f'<td class="number">{escape(cell)}</td>' for cell in rest)
        lines.append(f"<tr><td>{escape(first)}</td>{cells}</tr>")
    return f"<table>\n<thead><tr>{top}</tr></thead>\n<tbody>\n{chr(10).join(lines)}\n</tbody>\n</table>"


def _criteria(quality: Quality) -> str:
    rows = (
        (one.name, f"{one.value:.4f}", f"{one.good:g}", f"{one.usable:g}", one.unit, one.band)
        for one in quality.criteria
    )
    return _table(("figure", "value", "good up to", "usable up to", "unit", "band"), rows)


def _cameras(solution: Solution) -> str:
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
    cameras = _table(("view", "focal length fx, fy px", "principal point px", "distortion k1, k2, p1, p2, k3"), rows)
    unit = _unit(calibration)
    return (
        f"{cameras}\n<p>Model {calibration.model}, frame {calibration.frame_width} x {calibration.frame_height} px. "
        f"Baseline {calibration.baseline:.4f} &plusmn; {solution.baseline_sigma:.4f} {unit}, focal length &plusmn; "
        f"{solution.focal_sigma_px:.2f} px (one standard deviation).</p>"
    )


def _figures(quality: Quality) -> str:
    unit = "mm" if quality.unit == "mm" else "squares"
    gap, plane, row, scale = quality.triangulation_gap, quality.plane_fit, quality.row_error, quality.scale_error
    rows = (
        ("gap between the two rays of a corner", f"{gap.mean:.5f}", f"{gap.variance:.6f}", "-", unit),
        ("distance from the board's plane", f"{plane.mean:.5f}", f"{plane.variance:.6f}", f"{plane.rms:.5f}", unit),
        ("row error after rectification", f"{row.mean_px:.4f}", "-", f"95 %: {row.p95_px:.4f}", "px"),
        ("length of the board's sides, relative", f"{scale.mean:+.5f}", "-", f"{scale.rms:.5f}", ""),
    )
    note = f'<p class="note">Over {quality.views} frames with the board in both views.</p>'
    return _table(("figure", "mean", "variance", "rms", "unit"), rows) + "\n" + note


def _frames(solution: Solution) -> str:
    limit = outlier_limit(solution.frame_rms_px)
    chart = bars(solution.used, solution.frame_rms_px, limit, "rms of each frame in pixels")
    text = (
        f"<p>{len(solution.used)} frames, rms {solution.rms_px:.3f} px per corner (left {solution.rms_left_px:.3f}, right "
        f"{solution.rms_right_px:.3f}). A frame beyond the limit would have been rejected.</p>"
    )
    rejected = "<p>No frame was rejected.</p>"
    if solution.rejected:
        rejected = _table(("rejected frame", "reason"), ((entry.name, entry.reason) for entry in solution.rejected))
    return f"{text}\n<figure>{chart}</figure>\n{rejected}"


def _box(view: View, calibration: Calibration) -> Box:
    """Return the rectangle of a view in its upright coordinates."""
    x, y, _, _ = view.rectangle(calibration.frame_width, calibration.frame_height)
    width, height = view.upright_size(calibration.frame_width, calibration.frame_height)
    return x, y, width, height


def _per_view(solution: Solution) -> list[tuple[str, Box, NDArray[np.float64], NDArray[np.float64]]]:
    calibration = solution.calibration
    return [
        (name, _box(view, calibration), solution.corners_px[:, side], solution.residuals_px[:, side])
        for side, (name, view) in enumerate((("left", calibration.left_view), ("right", calibration.right_view)))
    ]


def _coverage(solution: Solution) -> str:
    figures = [
        f"<figure>{coverage(box, corners, f'corners seen in the {name} view')}<figcaption>{name} view: corners in "
        f"{100 * covered_share(box, corners):.0f} % of the cells</figcaption></figure>"
        for name, box, corners, _ in _per_view(solution)
    ]
    return f'<div class="views">{"".join(figures)}</div>'


def _leftover(solution: Solution) -> str:
    views = _per_view(solution)
    times = magnification(views[0][1][2], solution.residuals_px)
    figures = [
        f"<figure>{residual_vectors(box, corners, off, times, f'residuals in the {name} view')}"
        f"<figcaption>{name} view</figcaption></figure>"
        for name, box, corners, off in views
    ]
    note = (
        f'<p class="note">Projected minus measured corner, drawn {times} times as long. Arrows that agree with their '
        "neighbours mean an error of the model, arrows in all directions mean noise.</p>"
    )
    return f'<div class="views">{"".join(figures)}</div>\n{note}'


def _unit(calibration: Calibration) -> str:
    return "mm" if calibration.unit == "mm" else "squares"
