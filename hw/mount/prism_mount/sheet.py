"""A drawing sheet as SVG: lines, texts, arrows, and dimensions with extension lines. Units are sheet millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

__all__ = ["STYLES", "Sheet"]

Point = tuple[float, float]
STYLES = {
    "outline": "stroke:#111;stroke-width:0.35;fill:none",
    "hidden": "stroke:#999;stroke-width:0.13;stroke-dasharray:1.2 0.8;fill:none",
    "glass": "stroke:#1769aa;stroke-width:0.35;fill:none",
    "glass-hidden": "stroke:#7fb2dd;stroke-width:0.25;stroke-dasharray:1.6 0.8;fill:none",
    "ray": "stroke:#d9480f;stroke-width:0.13;fill:none",
    "thin": "stroke:#111;stroke-width:0.15;fill:none",
    "axis": "stroke:#555;stroke-width:0.15;stroke-dasharray:5 1 1 1;fill:none",
}
_ARROW_MM, _GAP_MM, _OVER_MM = 2.0, 1.0, 1.5


@dataclass
class Sheet:
    """Collects SVG elements; `text()` gives the file."""

    width_mm: float
    height_mm: float
    elements: list[str] = field(default_factory=list)

    def polyline(self, points: Iterable[Point], style: str) -> None:
        """Draw an open line of a named style."""
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
        self.elements.append(f'<polyline points="{path}" style="{STYLES[style]}"/>')

    def write(self, at: Point, words: str, size_mm: float = 3.0, anchor: str = "start", turn_deg: float = 0.0) -> None:
        """Write one line of text, its baseline at a point."""
        x, y = at
        self.elements.append(
            f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size_mm}" text-anchor="{anchor}" '
            f'transform="rotate({turn_deg:.2f} {x:.2f} {y:.2f})">{escape(words)}</text>'
        )

    def arrow(self, tip: Point, tail: Point) -> None:
        """Draw a filled arrow head at `tip`, coming from `tail`."""
        along = math.atan2(tip[1] - tail[1], tip[0] - tail[0])
        wings = [
            (tip[0] - _ARROW_MM * math.cos(along + turn), tip[1] - _ARROW_MM * math.sin(along + turn))
            for turn in (-0.16, 0.16)
        ]
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in (tip, *wings))
        self.elements.append(f'<polygon points="{path}" style="fill:#111"/>')

    def leader(self, at: Point, to: Point, words: str) -> None:
        """Point at something with an arrow and write beside the line's other end."""
        self.polyline([at, to], "thin")
        self.arrow(at, to)
        right = to[0] >= at[0]
        self.write((to[0] + (1 if right else -1), to[1] + 1), words, 2.8, "start" if right else "end")

    def balloon(self, at: Point, centre: Point, words: str) -> None:
        """Mark a part with a number in a circle."""
        self.polyline([at, centre], "thin")
        self.elements.append(f'<circle cx="{at[0]:.2f}" cy="{at[1]:.2f}" r="0.7" style="fill:#111"/>')
        self.elements.append(
            f'<circle cx="{centre[0]:.2f}" cy="{centre[1]:.2f}" r="3.6" style="fill:#fff;stroke:#111;stroke-width:0.3"/>'
        )
        self.write((centre[0], centre[1] + 1.3), words, 3.8, "middle")

    def dimension(self, a: Point, b: Point, direction: Point, distance_mm: float, words: str) -> None:
        """Dimension the distance of two points along a direction, the line set off to its left by `distance_mm`.

        Sheet y points down, so a positive distance lies on the right-hand side of `direction` as seen on paper.
        """
        length = math.hypot(*direction)
        d = direction[0] / length, direction[1] / length
        n = -d[1], d[0]
        base = max(a[0] * n[0] + a[1] * n[1], b[0] * n[0] + b[1] * n[1], key=lambda value: value * distance_mm)
        level = base + distance_mm
        ends = []
        for point in (a, b):
            along, off = point[0] * d[0] + point[1] * d[1], point[0] * n[0] + point[1] * n[1]
            sense = math.copysign(1.0, level - off)
            foot = (along * d[0] + level * n[0], along * d[1] + level * n[1])
            self.polyline(
                [
                    (point[0] + sense * _GAP_MM * n[0], point[1] + sense * _GAP_MM * n[1]),
                    (foot[0] + sense * _OVER_MM * n[0], foot[1] + sense * _OVER_MM * n[1]),
                ],
                "thin",
            )
            ends.append(foot)
        self._dimension_line(ends[0], ends[1], words)

    def _dimension_line(self, start: Point, end: Point, words: str) -> None:
        span = math.hypot(end[0] - start[0], end[1] - start[1])
        turn = math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
        if turn > 89.99 or turn <= -90.01:  # text is read from below or from the right
            turn += 180 if turn <= -90.01 else -180
            start, end = end, start
        self.polyline([start, end], "thin")
        roomy = span > 5 + 1.7 * len(words)
        middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
        along = math.radians(turn)
        for tip, other in ((start, end), (end, start)):
            outside = (2 * tip[0] - other[0], 2 * tip[1] - other[1])
            self.arrow(tip, other if span > 5 else outside)
        if not roomy and span <= 5 + 1.0 * len(words):
            tail = 3 + 1.8 * len(words)
            middle = end[0] + 3 * math.cos(along), end[1] + 3 * math.sin(along)
            self.polyline([end, (end[0] + tail * math.cos(along), end[1] + tail * math.sin(along))], "thin")
            self.write(
                (middle[0] + 0.9 * math.sin(along), middle[1] - 0.9 * math.cos(along)), words, 3.0, "start", turn
            )
            return
        at = middle[0] + 0.9 * math.sin(along), middle[1] - 0.9 * math.cos(along)
        self.write(at, words, 3.0, "middle", turn)

    def text(self) -> str:
        """Return the SVG file."""
        size = f'width="{self.width_mm}mm" height="{self.height_mm}mm" viewBox="0 0 {self.width_mm} {self.height_mm}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="DejaVu Sans, Arial, sans-serif">'
        white = f'<rect width="{self.width_mm}" height="{self.height_mm}" fill="#fff"/>'
        return "\n".join([head, white, *self.elements, "</svg>", ""])
