"""The binary PLY file of a mesh: points, normals, colours, one sigma of each point, and the pixel that names it."""

from __future__ import annotations

import numpy as np

from prismstereo.reconstruction.mesh import Mesh

__all__ = ["mesh_ply"]

_CORNERS = 3


def mesh_ply(mesh: Mesh) -> bytes:
    """Return a mesh as the bytes of a binary little-endian PLY file; unit, frame and what is ours stand in its comments."""
    columns = [*zip("xyz", mesh.points.T, strict=True), *zip(("nx", "ny", "nz"), mesh.normals.T, strict=True)]
    columns.append(("sigma", mesh.sigma))
    fields = [(name, "<f4") for name, _ in columns]
    if mesh.colours is not None:
        shades = list(zip(("red", "green", "blue"), mesh.colours.T, strict=True))
        columns += shades
        fields += [(name, "u1") for name, _ in shades]
    columns.append(("pixel", mesh.pixels))
    fields.append(("pixel", "<u4"))
    vertices = np.empty(len(mesh.points), fields)
    for name, values in columns:
        vertices[name] = values
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<u4", (_CORNERS,))])
    faces["count"], faces["corners"] = _CORNERS, mesh.triangles
    names = {"<f4": "float", "u1": "uchar", "<u4": "uint"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment unit {mesh.unit}",
        "comment frame rectified left camera: x right, y down, z forward",
        "comment sigma is one standard deviation along the ray, in the unit; pixel is row * width + column of the grid",
        f"element vertex {len(vertices)}",
        *(f"property {names[form]} {name}" for name, form in fields),
        f"element face {len(faces)}",
        "property list uchar uint vertex_indices",
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode("ascii") + vertices.tobytes() + faces.tobytes()
