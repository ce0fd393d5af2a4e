"""Maps in colours, with the scale and the limit that they are read by: inline SVG, every number of fixed length.

The colours go from dark to light, so they read in print, in light and dark, and for people who do not tell red from green.
"""

from __future__ import annotations

from html import escape
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["colour_scale", "heat_map"]

Array = NDArray[np.float64]

_WIDTH = 250.0
_SHADES = 16
_STOPS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], np.float64)
_SCALE_WIDTH, _SCALE_HEIGHT = 320.0, 14.0


def heat_map(values: Array, top: float, limit: float, label: str) -> str:
    """Draw values (rows, columns) from 0 to `top`, nothing where they are NaN, a frame round those beyond the limit."""
    rows, columns = values.shape
    size = _WIDTH / columns
    parts = []
    for row in range(rows):
        shades = [_shade(value, top) for value in values[row]]
        over = [bool(value > limit) for value in values[row]]
        parts += [
            f'<rect class="heat" x="{begin * size:.1f}" y="{row * size:.1f}" width="{count * size:.1f}" height="{size:.1f}" '
            f'fill="{_colour(shade)}"/>'
            for begin, count, shade in _runs(shades)
            if shade is not None
        ]
        parts += [_edges(over, row, size, values > limit)]
    parts.append(f'<rect class="border" x="0.5" y="0.5" width="{_WIDTH - 1:.1f}" height="{rows * size - 1:.1f}"/>')
    return _svg(_WIDTH, rows * size, label, parts)


def colour_scale(top: float, limits: tuple[float, ...], label: str) -> str:
    """Draw the colours from 0 to `top` with a mark at each limit that is on the scale."""
    step = _SCALE_WIDTH / _SHADES
    left = 12.0
    parts = [
        f'<rect class="heat" x="{left + shade * step:.1f}" y="16" width="{step:.1f}" height="{_SCALE_HEIGHT:.0f}" '
        f'fill="{_colour(shade)}"/>'
        for shade in range(_SHADES)
    ]
    bottom = 16 + _SCALE_HEIGHT
    for limit in limits:
        if limit < top:
            x = left + limit / top * _SCALE_WIDTH
            parts.append(f'<line class="limit" x1="{x:.1f}" y1="14" x2="{x:.1f}" y2="{bottom + 4:.0f}"/>')
            parts.append(f'<text class="middle" x="{x:.1f}" y="{bottom + 15:.0f}">limit {limit:g}</text>')
    parts.append(f'<text x="{left:.0f}" y="11">{escape(label)}</text>')
    parts.append(f'<text class="middle" x="{left:.0f}" y="{bottom + 15:.0f}">0</text>')
    parts.append(f'<text x="{left + _SCALE_WIDTH + 6:.0f}" y="{bottom - 2:.0f}">{top:.1f}</text>')
    return _svg(left + _SCALE_WIDTH + 50, bottom + 20, label, parts)


def _shade(value: float, top: float) -> int | None:
    return int(np.clip(value / top * _SHADES, 0, _SHADES - 1)) if np.isfinite(value) else None


def _colour(shade: int) -> str:
    place = shade / (_SHADES - 1) * (len(_STOPS) - 1)
    low = min(int(place), len(_STOPS) - 2)
    red, green, blue = _STOPS[low] + (place - low) * (_STOPS[low + 1] - _STOPS[low])
    return f"#{round(red):02x}{round(green):02x}{round(blue):02x}"


def _runs(shades: list[int | None]) -> list[tuple[int, int, int | None]]:
    """Return begin, length and shade of the runs of equal neighbours."""
    found, begin = [], 0
    for shade, run in groupby(shades):
        count = len(list(run))
        found.append((begin, count, shade))
        begin += count
    return found


def _edges(over: list[bool], row: int, size: float, beyond: NDArray[np.bool_]) -> str:
    """Draw the outline of what is beyond the limit along one row: its upright edges, and those above and below it."""
    moves = []
    padded = [False, *over, False]
    for column, (here, there) in enumerate(pairwise(padded)):
        if here != there:
            moves.append(f"M{column * size:.1f} {row * size:.1f}v{size:.1f}")
    above = beyond[row - 1] if row else np.zeros(len(over), bool)
    last = row == len(beyond) - 1
    for column, inside in enumerate(over):
        if inside != above[column]:
            moves.append(f"M{column * size:.1f} {row * size:.1f}h{size:.1f}")
        if last and inside:
            moves.append(f"M{column * size:.1f} {(row + 1) * size:.1f}h{size:.1f}")
    return f'<path class="beyond" d="{"".join(moves)}"/>' if moves else ""


def _svg(width: float, height: float, label: str, parts: list[str]) -> str:
    body = "\n".join(part for part in parts if part)
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(label)}">\n{body}\n</svg>'
    )
