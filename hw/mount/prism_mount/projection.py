"""Views of solids on paper: hidden lines removed by the kernel, curves turned into polylines, and cuts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from build123d import Compound, Edge, Face, GeomType, Keep, Part, Plane, Vector

from prism_mount.sheet import Point, Sheet

__all__ = ["View", "cut_below"]

_FAR_MM = 2000.0
_CURVE_STEPS = 24
Direction = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class View:
    """A parallel projection: seen from a direction, with `right` and `up` as paper axes, `origin` on the sheet."""

    right: Direction
    up: Direction
    origin: Point
    scale: float = 1.0

    @classmethod
    def from_above(cls, towards: Direction, origin: Point, scale: float) -> View:
        """Return the upright view from a direction that points to the onlooker."""
        eye = np.array(towards) / np.linalg.norm(towards)
        right = np.cross([0.0, -1.0, 0.0], eye)
        right /= np.linalg.norm(right)
        return cls(tuple(right), tuple(np.cross(eye, right)), origin, scale)

    def place(self, point: Sequence[float] | np.ndarray) -> Point:
        """Take a point of the rig frame to the sheet."""
        x, y = float(np.dot(point, self.right)), float(np.dot(point, self.up))
        return self.origin[0] + self.scale * x, self.origin[1] - self.scale * y

    def draw(self, sheet: Sheet, parts: Iterable[Part], style: str = "outline", hidden: str = "") -> None:
        """Draw the visible edges of solids, and the hidden ones too if they are given a style."""
        towards = np.cross(self.right, self.up)
        eye = Vector(*map(float, _FAR_MM * towards))
        visible, covered = Compound(children=[Part() + part for part in parts]).project_to_viewport(
            eye, Vector(*self.up), Vector(0, 0, 0)
        )
        for edges, line in ((covered, hidden), (visible, style)):
            for edge in edges if line else ():
                sheet.polyline([self._paper(point) for point in _points(edge)], line)

    def _paper(self, point: Vector) -> Point:
        return self.origin[0] + self.scale * point.X, self.origin[1] - self.scale * point.Y

    def fill(self, sheet: Sheet, faces: Iterable[Face], colour: str) -> None:
        """Fill plane faces of the rig frame, their holes left open."""
        for face in faces:
            loops = [face.outer_wire(), *face.inner_wires()]
            path = " ".join(
                "M " + " L ".join(f"{x:.2f},{y:.2f}" for x, y in _loop(loop.order_edges(), self.place)) + " Z"
                for loop in loops
            )
            sheet.elements.append(f'<path d="{path}" style="fill:{colour};fill-rule:evenodd;stroke:none"/>')


def _points(edge: Edge) -> list[Vector]:
    steps = 1 if edge.geom_type == GeomType.LINE else _CURVE_STEPS
    return [edge @ (step / steps) for step in range(steps + 1)]


def _loop(edges: Iterable[Edge], place: Callable[[np.ndarray], Point]) -> list[Point]:
    return [place(np.array([p.X, p.Y, p.Z])) for edge in edges for p in _points(edge)]


def cut_below(parts: Iterable[Part], y_mm: float) -> tuple[list[Part], list[Face]]:
    """Cut solids level at y: what lies below (greater y), and the cut faces."""
    plane = Plane(origin=(0, y_mm, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    rest = []
    for part in parts:
        lower = part.split(plane, keep=Keep.BOTTOM)
        solids = [
            solid for piece in (lower if isinstance(lower, list) else [lower]) if piece for solid in piece.solids()
        ]
        if solids:
            rest.append(Part() + solids)
    faces = [
        face
        for part in rest
        for face in part.faces()
        if face.geom_type == GeomType.PLANE and abs(face.center().Y - y_mm) < 1e-6 and abs(face.normal_at().Y) > 0.999
    ]
    return rest, faces
