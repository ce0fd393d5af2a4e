"""Drawings of a quality report: inline SVG, every number of fixed length, so the same input gives the same bytes.

Colours are classes that the page's style sheet defines for light and dark.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from prismstereo.measuring.levels import Levels

__all__ = ["Curve", "curves", "level_bars"]

_WIDTH, _HEIGHT = 460.0, 200.0
_LEFT, _BELOW, _ABOVE = 56.0, 34.0, 20.0
_TICKS = 5


@dataclass(frozen=True, slots=True)
class Curve:
    """A named line through points (x, y), in order."""

    name: str
    points: tuple[tuple[float, float], ...]


def curves(lines: Sequence[Curve], x_label: str, y_label: str) -> str:
    """Draw lines over one pair of axes that both begin at zero; nothing where there is no point."""
    points = [point for line in lines for point in line.points]
    if not points:
        return ""
    x_most = _round_up(max(x for x, _ in points))
    y_most = _round_up(max(1e-9, *(y for _, y in points)))
    parts = _axes(x_most, y_most, x_label, y_label)
    for index, line in enumerate(lines):
        at = [(_LEFT + x / x_most * _WIDTH, _ABOVE + (1 - y / y_most) * _HEIGHT) for x, y in line.points]
        way = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        parts.append(f'<polyline class="curve curve{index % 3}" points="{way}"/>')
        parts += [
            f'<circle class="dot{index % 3}" cx="{x:.1f}" cy="{y:.1f}" r="3"><title>{escape(line.name)}: {value:.4g} at '
            f"{place:.4g}</title></circle>"
            for (x, y), (place, value) in zip(at, line.points, strict=True)
        ]
        parts.append(
            f'<text class="key curve{index % 3}" x="{_LEFT + 8 + 150 * index:.0f}" y="12">{escape(line.name)}</text>'
        )
    return _svg(f"{y_label} over {x_label}", parts)


def level_bars(levels: Levels) -> str:
    """Draw how many pixels have each whole disparity; nothing where nothing was matched."""
    if not levels.counts:
        return ""
    first, count = levels.first, len(levels.counts)
    most = max(levels.counts)
    wide = _WIDTH / count
    last = first + count - 1
    parts = [
        f'<rect class="bar" x="{_LEFT + index * wide:.2f}" y="{_ABOVE + (1 - pixels / most) * _HEIGHT:.1f}" '
        f'width="{max(wide - 0.3, 0.3):.2f}" height="{pixels / most * _HEIGHT:.1f}"><title>{first + index} px: {pixels}</title>'
        "</rect>"
        for index, pixels in enumerate(levels.counts)
        if pixels
    ]
    bottom = _ABOVE + _HEIGHT
    parts.append(f'<path class="axis" d="M{_LEFT:.0f} {_ABOVE:.0f}V{bottom:.0f}h{_WIDTH:.0f}"/>')
    for place in sorted({first, first + count // 2, last}):
        x = _LEFT + (place - first + 0.5) * wide
        parts.append(f'<text class="middle" x="{x:.1f}" y="{bottom + 14:.0f}">{place}</text>')
    parts.append(f'<text class="name" x="{_LEFT - 4:.0f}" y="{_ABOVE + 8:.0f}">{most}</text>')
    parts.append(f'<text class="middle" x="{_LEFT + _WIDTH / 2:.0f}" y="{bottom + 28:.0f}">whole disparity, px</text>')
    return _svg("pixels of each whole disparity", parts)


def _axes(x_most: float, y_most: float, x_label: str, y_label: str) -> list[str]:
    bottom = _ABOVE + _HEIGHT
    parts = [f'<path class="axis" d="M{_LEFT:.0f} {_ABOVE:.0f}V{bottom:.0f}h{_WIDTH:.0f}"/>']
    for step in range(_TICKS + 1):
        share = step / _TICKS
        x, y = _LEFT + share * _WIDTH, bottom - share * _HEIGHT
        parts.append(f'<path class="grid" d="M{_LEFT:.0f} {y:.1f}h{_WIDTH:.0f}"/>')
        parts.append(f'<text class="middle" x="{x:.1f}" y="{bottom + 14:.0f}">{share * x_most:.4g}</text>')
        parts.append(f'<text class="name" x="{_LEFT - 4:.0f}" y="{y + 4:.1f}">{share * y_most:.3g}</text>')
    parts.append(f'<text class="middle" x="{_LEFT + _WIDTH / 2:.0f}" y="{bottom + 28:.0f}">{escape(x_label)}</text>')
    parts.append(f'<text class="name" x="{_LEFT + _WIDTH:.0f}" y="12">{escape(y_label)}</text>')
    return parts


def _round_up(value: float) -> float:
    """Return the next number of two digits, the second one even or five, that is not below a positive value."""
    step = math.pow(10, math.floor(math.log10(value))) / 2
    return math.ceil(value / step - 1e-9) * step


def _svg(label: str, parts: Sequence[str]) -> str:
    width, height = _LEFT + _WIDTH + 16, _ABOVE + _HEIGHT + _BELOW
    body = "\n".join(parts)
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(label)}">\n{body}\n</svg>'
    )
