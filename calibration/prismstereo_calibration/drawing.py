"""Drawings of a calibration report: inline SVG, every number of fixed length, so the same input gives the same bytes.

Colours are classes that the report's style sheet defines for light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

__all__ = ["Box", "bars", "coverage", "covered_share", "magnification", "residual_vectors"]

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]  # x, y, width, height in pixels of the frame

_BAR_HEIGHT, _BAR_GAP, _NAME_WIDTH, _BAR_WIDTH, _VALUE_WIDTH = 14, 4, 190, 320, 60
_NAME_LETTERS = 28
_PICTURE_WIDTH = 380.0
_CELLS = 8
_ARROW_SHARE = 0.06  # of the picture's width: how long the arrow of the 95th percentile is
_ROUND_SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def _svg(width: float, height: float, label: str, parts: Sequence[str]) -> str:
    body = "\n".join(parts)
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(label)}">\n{body}\n</svg>'
    )


def bars(names: Sequence[str], values: Array, limit: float, label: str) -> str:
    """Draw one bar per name with its value in pixels, and a line where the limit is."""
    full = 1.15 * max(limit, float(values.max(initial=0.0)))
    step = _BAR_HEIGHT + _BAR_GAP
    height = len(names) * step + 18
    parts = []
    for index, (name, value) in enumerate(zip(names, values, strict=True)):
        y, short = index * step, name if len(name) <= _NAME_LETTERS else "..." + name[3 - _NAME_LETTERS :]
        kind = "bar" if value <= limit else "bar over"
        parts += [
            f'<text class="name" x="{_NAME_WIDTH - 6}" y="{y + 11}">{escape(short)}</text>',
            f'<rect class="{kind}" x="{_NAME_WIDTH}" y="{y}" width="{value / full * _BAR_WIDTH:.1f}" '
            f'height="{_BAR_HEIGHT}"><title>{escape(name)}: {value:.3f} px</title></rect>',
            f'<text x="{_NAME_WIDTH + value / full * _BAR_WIDTH + 4:.1f}" y="{y + 11}">{value:.3f}</text>',
        ]
    x = _NAME_WIDTH + limit / full * _BAR_WIDTH
    bottom = len(names) * step
    parts += [
        f'<line class="limit" x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{bottom}"/>',
        f'<text class="middle" x="{x:.1f}" y="{bottom + 13}">limit {limit:.2f} px</text>',
    ]
    return _svg(_NAME_WIDTH + _BAR_WIDTH + _VALUE_WIDTH, height, label, parts)


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
    length = float(np.percentile(np.linalg.norm(residuals, axis=-1), 95.0))
    wanted = _ARROW_SHARE * width / max(length, 1e-6)
    return max((scale for scale in _ROUND_SCALES if scale <= wanted), default=1)


def _border(height: float) -> str:
    return f'<rect class="border" x="0.5" y="0.5" width="{_PICTURE_WIDTH - 1:.1f}" height="{height - 1:.1f}"/>'
