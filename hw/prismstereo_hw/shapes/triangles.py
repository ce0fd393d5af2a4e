"""Triangles in a body's frame, and which of them rays meet first: by numpy alone for few, by Embree for many."""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.shapes.culling import passing
from prismstereo_hw.shapes.shape import NEAREST_MM, Array

__all__ = ["MOST_BY_NUMPY", "Triangles", "box_triangles", "cylinder_triangles"]

Indices = NDArray[np.intp]
MOST_BY_NUMPY = 2000
_BLOCK = 1 << 15  # ray-triangle pairs looked at at once: what fits a core's cache
_SLACK = 1e-10  # of the barycentric coordinates: no ray slips through between two triangles
_FLAT = 1e-14  # of |direction x edge x edge|: a ray along its plane meets no triangle


@dataclass(frozen=True, eq=False)
class Triangles:
    """Vertices (V, 3) in mm and faces (F, 3), indices into them; `UsageError` for indices there are not.

    `embree` chooses the engine; None means numpy up to 2000 faces and Embree (extra `twin`) beyond. Embree finds the face in
    32 bits, and the distance is then computed from it in 64.
    """

    vertices: Array
    faces: Indices
    embree: bool | None = None

    def __post_init__(self) -> None:
        """Refuse faces that do not belong to the vertices, and vertices that are nowhere."""
        shapes = self.vertices.ndim == self.faces.ndim == 2 and self.vertices.shape[1] == self.faces.shape[1] == 3
        if not shapes or not len(self.faces) or not np.isfinite(self.vertices).all():
            raise UsageError(
                f"vertices {self.vertices.shape} and faces {self.faces.shape}: give (V, 3) finite mm and (F, 3) indices"
            )
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise UsageError(
                f"faces name vertices {self.faces.min()} to {self.faces.max()}, but there are {len(self.vertices)}: "
                "count them from 0"
            )

    @cached_property
    def normals(self) -> Array:
        """Unit normals (F, 3), outward where the vertices go round counter-clockwise as seen from outside."""
        a, b, c = self.corners
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(normal / np.where(length > 0, length, 1.0))

    @cached_property
    def corners(self) -> tuple[Array, Array, Array]:
        """The three corners of every face, (F, 3) each."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return a, b, c

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """Centre (3,) and radius of a ball around all vertices."""
        centre = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return centre, float(np.linalg.norm(self.vertices - centre, axis=1).max())

    @cached_property
    def _engine(self) -> Any:  # trimesh ships no types
        try:
            trimesh = importlib.import_module("trimesh")
            embree = importlib.import_module("trimesh.ray.ray_pyembree")
            importlib.import_module("embreex")
        except ImportError as error:
            raise UsageError(
                f"a mesh of {len(self.faces)} triangles needs Embree, and {error.name} is not installed: "
                f"`pip install 'prismstereo[twin]'`, or give at most {MOST_BY_NUMPY} triangles"
            ) from error
        return embree.RayMeshIntersector(trimesh.Trimesh(self.vertices, self.faces, process=False))

    def first(self, origin: Array, direction: Array) -> tuple[Array, Indices]:
        """Return how far along each ray (N, 3) a face is met first, (N,) mm or inf, and which face, -1 for none."""
        reach, which = np.full(len(origin), np.inf), np.full(len(origin), -1, np.intp)
        centre, radius = self.ball
        near = passing(origin, direction, centre, radius)
        if near.size:
            middle = np.einsum("ni,ni->n", centre - origin[near], direction[near])
            start = np.maximum(middle - 1.01 * radius, 0.0)  # close by, where 32 bits are enough
            by_embree = len(self.faces) > MOST_BY_NUMPY if self.embree is None else self.embree
            engine = self._first_by_embree if by_embree else self._first_by_numpy
            way, which[near] = engine(origin[near] + start[:, None] * direction[near], direction[near])
            reach[near] = start + way
        return reach, which

    def _first_by_embree(self, origin: Array, direction: Array) -> tuple[Array, Indices]:
        which = np.asarray(self._engine.intersects_first(origin, direction), np.intp)
        reach = np.full(len(origin), np.inf)
        met = which >= 0
        normal, corner = self.normals[which[met]], self.corners[0][which[met]]
        ahead = np.einsum("ni,ni->n", corner - origin[met], normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach[met] = ahead / np.einsum("ni,ni->n", direction[met], normal)
        met = np.isfinite(reach) & (reach > NEAREST_MM)
        return np.where(met, reach, np.inf), np.where(met, which, -1)

    def _first_by_numpy(self, origin: Array, direction: Array) -> tuple[Array, Indices]:
        blocks = max(1, math.ceil(len(origin) * len(self.faces) / _BLOCK))
        parts = [
            self._moeller_trumbore(o, d)
            for o, d in zip(np.array_split(origin, blocks), np.array_split(direction, blocks), strict=True)
        ]
        return np.concatenate([reach for reach, _ in parts]), np.concatenate([which for _, which in parts])

    @cached_property
    def _products(self) -> tuple[Array, Array, Array, Array, Array]:
        """What the intersection needs of the faces alone: e1 x e2, e1 x a, e2 x a (F, 3), a . e1 x e2 and |e1||e2| (F,)."""
        a, b, c = self.corners
        one, other = b - a, c - a
        plane = np.cross(one, other)
        sizes = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        return plane, np.cross(one, a), np.cross(other, a), np.einsum("fi,fi->f", a, plane), sizes

    def _moeller_trumbore(self, origin: Array, direction: Array) -> tuple[Array, Indices]:
        """Try every ray (N, 3) against every face; see Moeller and Trumbore 1997."""
        a, b, c = self.corners
        plane, one_a, other_a, height, sizes = self._products
        # triple products as matrix products, (N, F): d . (e1 x e2), (o - a) . (d x e) = (o x d) . e - d . (e x a)
        moment = np.cross(origin, direction)
        volume = -(direction @ plane.T)
        inverse = 1 / np.where(np.abs(volume) > _FLAT * sizes, volume, np.nan)
        u = (moment @ (c - a).T - direction @ other_a.T) * inverse
        v = (direction @ one_a.T - moment @ (b - a).T) * inverse
        reach = (origin @ plane.T - height) * inverse
        met = (u >= -_SLACK) & (v >= -_SLACK) & (u + v <= 1 + _SLACK) & (reach > NEAREST_MM)  # NaN is not
        reach = np.where(met, reach, np.inf)
        which = np.argmin(reach, axis=1)
        nearest = reach[np.arange(len(origin)), which]
        return nearest, np.where(np.isfinite(nearest), which, -1)

    def under(self, point: Array) -> Indices:
        """Return the face (N,) that each point (N, 3) lies on, -1 for a point off all of them.

        Short rays go through the point along each of the axes: any face is met squarely enough by one of them.
        """
        _, radius = self.ball
        before = 1e-4 * radius
        best, found = np.full(len(point), before / 2), np.full(len(point), -1, np.intp)
        for axis in np.eye(3):
            reach, which = self.first(point - before * axis, np.broadcast_to(axis, point.shape))
            miss = np.abs(reach - before)
            nearer = (miss < best) & (which >= 0)
            best[nearer], found[nearer] = miss[nearer], which[nearer]
        return found

    def weights(self, point: Array, which: Indices) -> Array:
        """Return the barycentric weights (N, 3) of points in faces (N,), none below 0 and their sum 1."""
        a, b, c = (corner[which] for corner in self.corners)
        whole = np.cross(b - a, c - a)
        area = np.maximum(np.einsum("ni,ni->n", whole, whole), 1e-300)
        by_b = np.einsum("ni,ni->n", np.cross(point - a, c - a), whole) / area
        by_c = np.einsum("ni,ni->n", np.cross(b - a, point - a), whole) / area
        weight = np.clip(np.stack([1 - by_b - by_c, by_b, by_c], axis=1), 0.0, 1.0)
        return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def box_triangles(half_mm: tuple[float, float, float]) -> Triangles:
    """Return the twelve triangles of a box about the origin, half sizes in mm."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return Triangles(signs * half_mm, np.array(faces, np.intp))


def cylinder_triangles(radius_mm: float, half_length_mm: float, sides: int = 24) -> Triangles:
    """Return a prism of many sides about the z axis, closed at z = -half_length_mm and +half_length_mm."""
    angle = 2 * math.pi * np.arange(sides) / sides
    rim = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([rim, np.full(sides, z)]) for z in (-half_length_mm, half_length_mm)]
    middles = np.array([[0, 0, -half_length_mm], [0, 0, half_length_mm]])
    faces = []
    for k in range(sides):
        after = (k + 1) % sides
        faces += [(k, after, sides + after), (k, sides + after, sides + k)]
        faces += [(2 * sides, after, k), (2 * sides + 1, sides + k, sides + after)]
    return Triangles(np.vstack([*ends, middles]), np.array(faces, np.intp))
