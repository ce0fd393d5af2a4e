"""A rigid thing made of triangles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from prismstereo_hw.errors import UsageError
from prismstereo_hw.shapes.culling import among_passing
from prismstereo_hw.shapes.pose import Motion, Pose
from prismstereo_hw.shapes.shape import Array
from prismstereo_hw.shapes.triangles import Indices, Triangles
from prismstereo_hw.shapes.triplanar import triplanar
from prismstereo_hw.texture import Texture

__all__ = ["Mesh"]


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles in a pose, coloured by a texture or by a grey level per vertex, (V,) float64.

    `UsageError` for neither or both of them; beyond 2000 triangles the extra `twin` is needed, see `Triangles`.
    """

    name: str
    pose: Pose
    triangles: Triangles
    texture: Texture | None = None
    vertex_grey: Array | None = None
    motion: Motion = field(default_factory=Motion)

    def __post_init__(self) -> None:
        """Refuse a mesh without a look, or with two."""
        if (self.texture is None) == (self.vertex_grey is None):
            raise UsageError(f"mesh {self.name!r}: give either a texture or a grey level per vertex")
        vertices = len(self.triangles.vertices)
        if self.vertex_grey is not None and self.vertex_grey.shape != (vertices,):
            raise UsageError(
                f"mesh {self.name!r}: {self.vertex_grey.shape} grey levels for {vertices} vertices: give one each"
            )

    def at(self, seconds: float) -> Mesh:
        """Return this mesh where it is at a time."""
        return replace(self, pose=self.pose.at(self.motion, seconds))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) the mesh is met, (N,) mm; inf where it is not."""
        centre, radius = self.triangles.ball
        middle = self.pose.centre_mm + self.pose.direction_to_rig(centre[None])[0]
        return among_passing(origin, direction, middle, radius, self._distance)

    def _distance(self, origin: Array, direction: Array) -> Array:
        return self.triangles.first(self.pose.to_body(origin), self.pose.direction_to_body(direction))[0]

    def _on(self, point: Array) -> tuple[Array, Indices]:
        body = self.pose.to_body(point)
        return body, self.triangles.under(body)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        body, which = self._on(point)
        if self.vertex_grey is None:
            assert self.texture is not None
            return triplanar(self.texture, body, self.triangles.normals[which], pixel_mm)
        corners = self.vertex_grey[self.triangles.faces[which]]
        return np.asarray(np.einsum("ni,ni->n", corners, self.triangles.weights(body, which)))

    def normals(self, point: Array) -> Array:
        """Return unit normals (N, 3) of the triangles that points (N, 3) of the mesh lie on."""
        _, which = self._on(point)
        return self.pose.direction_to_rig(self.triangles.normals[which])
