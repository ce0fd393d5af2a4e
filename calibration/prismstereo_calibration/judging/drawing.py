"""Drawings of a calibration report: inline SVG, every number of fixed length, so the same input gives the same bytes.

Colours are classes that the report's style sheet defines for light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

__all__ = ["Box", "bars", "coverage", "covered_share", "histogram", "magnification", "residual_vectors"]

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]  # x, y, width, height in pixels of the frame

_BAR_HEIGHT, _BAR_GAP, _NAME_WIDTH, _BAR_WIDTH, _VALUE_WIDTH = 14, 4, 190, 320, 60
_NAME_LETTERS = 28
_PICTURE_WIDTH = 380.0
_CELLS = 8
_BINS, _HISTOGRAM_HEIGHT = 41, 120
_ARROW_SHARE = 0.06  # of the picture's width: how long the arrow of the 95th percentile is
_ROUND_SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def _svg(width: float, height: float, label: str, parts: Sequence[str]) -> str:
    body = "\n".join(parts)
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(label)}">\n{body}\n</svg>'
    )


def bars(names: Sequence[str], values: Array, limit: float, label: str) -> str:
    """Draw one bar per name and view of its values (names, views) in pixels, NaN for none, and a line where the limit is."""
    full = 1.15 * max(limit, float(np.nanmax(values, initial=0.0)))
    thick = _BAR_HEIGHT / max(values.shape[1], 1)
    step = _BAR_HEIGHT + _BAR_GAP
    parts = []
    for index, (name, of_views) in enumerate(zip(names, values, strict=True)):
        y, short = index * step, name if len(name) <= _NAME_LETTERS else "..." + name[3 - _NAME_LETTERS :]
        parts.append(f'<text class="name" x="{_NAME_WIDTH - 6}" y="{y + 11}">{escape(short)}</text>')
        for side, value in enumerate(of_views):
            if np.isfinite(value):
                kind = f"bar side{side % 2}" if value <= limit else "bar over"
                parts.append(
                    f'<rect class="{kind}" x="{_NAME_WIDTH}" y="{y + side * thick:.1f}" '
                    f'width="{value / full * _BAR_WIDTH:.1f}" height="{thick - 1:.1f}"><title>{escape(name)}, view '
                    f"{side + 1}: {value:.3f} px</title></rect>"
                )
        longest = float(np.nanmax(of_views, initial=0.0))
        said = " ".join(f"{value:.3f}" if np.isfinite(value) else "-" for value in of_views)
        parts.append(f'<text x="{_NAME_WIDTH + longest / full * _BAR_WIDTH + 4:.1f}" y="{y + 11}">{said}</text>')
    x = _NAME_WIDTH + limit / full * _BAR_WIDTH
    bottom = len(names) * step
    parts += [
        f'<line class="limit" x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{bottom}"/>',
        f'<text class="middle" x="{x:.1f}" y="{bottom + 13}">limit {limit:.2f} px</text>',
    ]
    return _svg(_NAME_WIDTH + _BAR_WIDTH + _VALUE_WIDTH * values.shape[1], bottom + 18, label, parts)


def histogram(values: Array, limits: Sequence[float], label: str) -> str:
    """Draw how often values (N,), in pixels of either sign, occur, with lines at plus and minus each limit."""
    reach = 1.05 * max(float(np.abs(values).max(initial=0.0)), *limits)
    counts, _ = np.histogram(values, bins=_BINS, range=(-reach, reach))
    most, width = max(int(counts.max()), 1), _PICTURE_WIDTH / _BINS
    parts = [
        f'<rect class="bar" x="{index * width:.1f}" y="{_HISTOGRAM_HEIGHT * (1 - count / most):.1f}" '
        f'width="{width - 1:.1f}" height="{_HISTOGRAM_HEIGHT * count / most:.1f}"><title>{count} corners</title></rect>'
        for index, count in enumerate(counts)
        if count
    ]
    bottom = _HISTOGRAM_HEIGHT
    for limit in limits:
        for place in (-limit, limit):
            x = (place / reach + 1) / 2 * _PICTURE_WIDTH
            parts.append(f'<line class="limit" x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{bottom}"/>')
            parts.append(f'<text class="middle" x="{x:.1f}" y="{bottom + 13}">{place:g}</text>')
    parts.append(f'<text class="middle" x="{_PICTURE_WIDTH / 2:.1f}" y="{bottom + 13}">0 px</text>')
    parts.append(_border(bottom))
    return _svg(_PICTURE_WIDTH, bottom + 18, label, parts)


def coverage(box: Box, pixels: Array, label: str) -> str:
    """Draw where in a view corners (..., 2) were seen: shaded cells by their number, and each corner as a dot."""
    x0, y0, width, height = box
    scale = _PICTURE_WIDTH / width
    points = pixels.reshape(-1, 2)
    counts, _, _ = np.histogram2d(points[:, 1], points[:, 0], bins=_CELLS, range=((y0, y0 + height), (x0, x0 + width)))
    most = max(float(counts.max()), 1.0)
    cell_w, cell_h = _PICTURE_WIDTH / _CELLS, height * scale / _CELLS
    parts = [
        f'<rect class="cell" x="{column * cell_w:.1f}" y="{row * cell_h:.1f}" width="{cell_w:.1f}" height="{cell_h:.1f}" '
        f'fill-opacity="{0.08 + 0.6 * counts[row, column] / most:.2f}"><title>{counts[row, column]:.0f} corners</title></rect>'
        for row in range(_CELLS)
        for column in range(_CELLS)
        if counts[row, column]
    ]
    parts += [f'<circle class="dot" cx="{(x - x0) * scale:.1f}" cy="{(y - y0) * scale:.1f}" r="1"/>' for x, y in points]
    parts.append(_border(height * scale))
    return _svg(_PICTURE_WIDTH, height * scale, label, parts)


def covered_share(box: Box, pixels: Array) -> float:
    """Return the share of a view's 8 x 8 cells in which a corner was seen."""
    x0, y0, width, height = box
    points = pixels.reshape(-1, 2)
    counts, _, _ = np.histogram2d(points[:, 1], points[:, 0], bins=_CELLS, range=((y0, y0 + height), (x0, x0 + width)))
    return float(np.count_nonzero(counts)) / counts.size


def residual_vectors(box: Box, pixels: Array, residuals: Array, times: int, label: str) -> str:
    """Draw what is left over at each corner, projected minus measured, `times` as long as it is."""
    x0, y0, width, height = box
    scale = _PICTURE_WIDTH / width
    parts = []
    for (x, y), (dx, dy) in zip(pixels.reshape(-1, 2), residuals.reshape(-1, 2), strict=True):
        a, b = (x - x0) * scale, (y - y0) * scale
        parts.append(
            f'<path class="arrow" d="M{a:.1f} {b:.1f}l{dx * scale * times:.1f} {dy * scale * times:.1f}"/>'
            f'<circle class="dot" cx="{a:.1f}" cy="{b:.1f}" r="0.8"/>'
        )
    one = scale * times
    parts.append(_border(height * scale))
    unit = 0.5 if one > _PICTURE_WIDTH / 3 else 1.0
    parts.append(
        f'<path class="scale" d="M8 {height * scale - 10:.1f}h{one * unit:.1f}"/>'
        f'<text x="{12 + one * unit:.1f}" y="{height * scale - 6:.1f}">{unit:.1f} px (x{times})</text>'
    )
    return _svg(_PICTURE_WIDTH, height * scale, label, parts)


def magnification(width: float, residuals: Array) -> int:
    """Return the round factor that makes most residuals visible and none a streak across a view of that width."""
    length = float(np.nanpercentile(np.linalg.norm(residuals, axis=-1), 95.0))
    wanted = _ARROW_SHARE * width / max(length, 1e-6)
    return max((scale for scale in _ROUND_SCALES if scale <= wanted), default=1)


def _border(height: float) -> str:
    return f'<rect class="border" x="0.5" y="0.5" width="{_PICTURE_WIDTH - 1:.1f}" height="{height - 1:.1f}"/>'
