"""What the frames say: their rms, what was rejected and why, where the corners were, what is left over, and the rows."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.judging import drawing
from prismstereo_calibration.judging.drawing import Box
from prismstereo_calibration.judging.quality import Quality
from prismstereo_calibration.judging.report.table import table
from prismstereo_calibration.judging.summary import view_rms_px
from prismstereo_calibration.solving.fit import outlier_limit
from prismstereo_calibration.solving.solve import Solution

__all__ = ["bars_and_rejections", "coverage", "leftover", "rows"]

Array = NDArray[np.float64]
_VIEWS = ("left", "right")
_ROW_LIMITS_PX = (0.4, 0.8)  # those of the criterion for rows


def bars_and_rejections(solution: Solution) -> str:
    """Return a bar for each frame and view, and the tables of rejected frames and corners."""
    limit = outlier_limit(solution.frame_rms_px)
    by_view = [[float("nan") if rms is None else rms for rms in row] for row in view_rms_px(solution)]
    chart = drawing.bars(solution.used, np.array(by_view), limit, "rms of each frame and view in pixels")
    text = (
        f"<p>{len(solution.used)} frames, rms {solution.rms_px:.3f} px per corner (left {solution.rms_left_px:.3f}, right "
        f"{solution.rms_right_px:.3f}). Dark: left view, light: right view. A frame beyond the limit would have been "
        "rejected.</p>"
    )
    rejected = "<p>No frame was rejected.</p>"
    if solution.rejected:
        rejected = table(("rejected frame", "reason"), ((entry.name, entry.reason) for entry in solution.rejected))
    return f"{text}\n<figure>{chart}</figure>\n{rejected}\n{_rejected_corners(solution)}"


def _rejected_corners(solution: Solution) -> str:
    if not solution.rejected_corners:
        return "<p>No single corner was rejected.</p>"
    counts = Counter((one.name, one.view) for one in solution.rejected_corners)
    rows = []
    for (name, view), count in counts.items():
        ones = [one for one in solution.rejected_corners if (one.name, one.view) == (name, view)]
        which = ", ".join(f"{one.corner} ({one.off_px:.1f} px)" for one in ones)
        rows.append((name, _name(view), f"{count}", which))
    return table(("frame with rejected corners", "view", "corners", "which, and how far off"), rows)


def coverage(solution: Solution, quality: Quality) -> str:
    """Return where in each view corners were seen."""
    figures = []
    for name, box, corners, _ in _per_view(solution):
        picture = drawing.coverage(box, corners, f"corners seen in the {name} view")
        shares = dict(zip(_VIEWS, quality.coverage, strict=False))
        share = shares.get(name, float("nan"))
        share = share if np.isfinite(share) else drawing.covered_share(box, corners)
        figures.append(
            f"<figure>{picture}<figcaption>{name} view: corners in {100 * share:.0f} % of the cells that both views can "
            "show</figcaption></figure>"
        )
    return f'<div class="views">{"".join(figures)}</div>'


def leftover(solution: Solution) -> str:
    """Return the residuals of each view as arrows, at a stated scale."""
    views = _per_view(solution)
    times = drawing.magnification(views[0][1][2], solution.residuals_px)
    figures = [
        f"<figure>{drawing.residual_vectors(box, corners, off, times, f'residuals in the {name} view')}"
        f"<figcaption>{name} view</figcaption></figure>"
        for name, box, corners, off in views
    ]
    note = (
        f'<p class="note">Projected minus measured corner, drawn {times} times as long. Arrows that agree with their '
        "neighbours mean an error of the model, arrows in all directions mean noise.</p>"
    )
    return f'<div class="views">{"".join(figures)}</div>\n{note}'


def rows(quality: Quality) -> str:
    """Return the histogram of row errors after rectification."""
    chart = drawing.histogram(quality.row_error.all_px, _ROW_LIMITS_PX, "row errors of all corners in pixels")
    text = (
        f"<p>Row in the left picture less row in the right one, of every corner: {quality.row_error.mean_px:.3f} px off on "
        f"average, 95 % within {quality.row_error.p95_px:.3f} px. The limits are those of the average.</p>"
    )
    return f"{text}\n<figure>{chart}</figure>"


def _name(view: int) -> str:
    return _VIEWS[view] if view < len(_VIEWS) else f"number {view + 1}"


def _per_view(solution: Solution) -> list[tuple[str, Box, Array, Array]]:
    """Return name, rectangle in upright pixels, corners (N, 2) and residuals (N, 2) of the ones that count, view by view."""
    calibrations = solution.calibration, *solution.others
    views = [calibrations[0].left_view, *(one.right_view for one in calibrations)]
    size = calibrations[0].frame_width, calibrations[0].frame_height
    found: list[tuple[str, Box, Array, Array]] = []
    for side, view in enumerate(views):
        corners, off = solution.corners_px[:, side].reshape(-1, 2), solution.residuals_px[:, side].reshape(-1, 2)
        kept = np.isfinite(corners).all(axis=1) & np.isfinite(off).all(axis=1)
        x, y, _, _ = view.rectangle(*size)
        found.append((_name(side), (x, y, *view.upright_size(*size)), corners[kept], off[kept]))
    return found
