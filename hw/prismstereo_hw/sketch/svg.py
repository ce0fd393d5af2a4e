"""The few shapes a technical drawing needs, as SVG text that is legible on a dark and on a light screen.

A `Panel` takes millimetres (x to the right, z upwards) to pixels of the picture; the shapes are plain strings.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

__all__ = ["Panel", "Point", "document", "words"]

Point = tuple[float, float]
_STYLE = """
:root { --paper: #ffffff; --ink: #1c2430; --faint: #8a94a3; --left: #1769c2; --right: #c2571a; --glass: #5aa9c9;
  --both: #2f9e61; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #14181e; --ink: #e6eaf0; --faint: #7d8896; --left: #6db3ff; --right: #ff9e5e; --glass: #7fd0ee;
    --both: #5fd394; }
}
text { font: 12px system-ui, sans-serif; fill: var(--ink); paint-order: stroke; stroke: var(--paper); stroke-width: 3px;
  stroke-linejoin: round; }
.title { font-size: 17px; font-weight: 600; } .small { font-size: 11px; } .faint { fill: var(--faint); }
.line { fill: none; stroke: var(--ink); stroke-width: 1; } .axis { stroke: var(--faint); stroke-dasharray: 9 3 2 3; }
.dimension { fill: none; stroke: var(--faint); stroke-width: 0.8; } .arrow { fill: var(--faint); }
.glass { fill: var(--glass); fill-opacity: 0.22; stroke: var(--glass); stroke-width: 1.5; }
.mirror { fill: none; stroke: var(--ink); stroke-width: 4; } .pupil { stroke: var(--ink); stroke-width: 5; }
.left, .right { fill: none; stroke-width: 1.2; } .left { stroke: var(--left); } .right { stroke: var(--right); }
.left.area { fill: var(--left); } .right.area { fill: var(--right); } .both.area { fill: var(--both); }
.area { fill-opacity: 0.14; stroke: none; } .both.area { fill-opacity: 0.4; }
.behind { stroke-dasharray: 3 4; stroke-opacity: 0.7; }
.left.camera { fill: var(--left); } .right.camera { fill: var(--right); }
"""


def document(width: int, height: int, title: str, shapes: Iterable[str]) -> str:
    """Return a whole SVG file with its own background, which follows the screen's dark or light scheme."""
    body = "\n".join(shapes)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img">\n<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n'
        f'<rect width="{width}" height="{height}" fill="var(--paper)"/>\n{body}\n</svg>\n'
    )


def words(x_px: float, y_px: float, said: str, style: str = "") -> str:
    """Write words at a pixel of the picture, beginning there."""
    return f'<text x="{x_px}" y="{y_px}" class="{style}">{escape(said)}</text>'


@dataclass(frozen=True, slots=True)
class Panel:
    """A part of the picture, in pixels, that shows a part of the rig's plane, in mm, without distortion."""

    left_px: float
    top_px: float
    width_px: float
    height_px: float
    low: Point  # least x and z in mm
    high: Point

    @property
    def scale(self) -> float:
        """Pixels per millimetre."""
        return min(self.width_px / (self.high[0] - self.low[0]), self.height_px / (self.high[1] - self.low[1]))

    def at(self, point: Point) -> Point:
        """Return the pixel of a point in mm; what is shown stands in the middle of the panel."""
        middle = (self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2
        return (
            self.left_px + self.width_px / 2 + (point[0] - middle[0]) * self.scale,
            self.top_px + self.height_px / 2 - (point[1] - middle[1]) * self.scale,
        )

    def line(self, points: Iterable[Point], style: str, *, closed: bool = False) -> str:
        """Draw a line, or a closed area, through points in mm."""
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in map(self.at, points))
        return f'<{"polygon" if closed else "polyline"} points="{path}" class="{style}"/>'

    def label(self, point: Point, said: str, style: str = "", anchor: str = "middle", turn_deg: float = 0.0) -> str:
        """Write words at a point in mm, turned counter-clockwise."""
        x, y = self.at(point)
        turn = f' transform="rotate({-turn_deg:.2f} {x:.2f} {y:.2f})"' if turn_deg else ""
        return f'<text x="{x:.2f}" y="{y:.2f}" class="{style}" text-anchor="{anchor}"{turn}>{escape(said)}</text>'

    def dot(self, point: Point, style: str, radius_px: float = 4.0) -> str:
        """Draw a dot at a point in mm."""
        x, y = self.at(point)
        return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius_px}" class="{style}"/>'

    def dimension(self, begin: Point, end: Point, said: str, aside_px: float = -5.0) -> list[str]:
        """Draw a dimension line with arrows between two points in mm, its words `aside_px` to the right of its direction."""
        (x0, y0), (x1, y1) = self.at(begin), self.at(end)
        length = math.hypot(x1 - x0, y1 - y0)
        if length < 1e-9:
            return []
        u, v = (x1 - x0) / length, (y1 - y0) / length
        x, y = (x0 + x1) / 2 - aside_px * v, (y0 + y1) / 2 + aside_px * u
        turn = math.degrees(math.atan2(v, u))
        return [
            f'<line x1="{x0:.2f}" y1="{y0:.2f}" x2="{x1:.2f}" y2="{y1:.2f}" class="dimension"/>',
            _arrow(x0, y0, -u, -v),
            _arrow(x1, y1, u, v),
            f'<text x="{x:.2f}" y="{y:.2f}" class="small" text-anchor="middle" '
            f'transform="rotate({turn:.2f} {x:.2f} {y:.2f})">{escape(said)}</text>',
        ]


def _arrow(x: float, y: float, u: float, v: float) -> str:
    back_x, back_y = x - 6 * u, y - 6 * v
    return (
        f'<polygon points="{x:.2f},{y:.2f} {back_x - 2 * v:.2f},{back_y + 2 * u:.2f} '
        f'{back_x + 2 * v:.2f},{back_y - 2 * u:.2f}" class="arrow"/>'
    )
