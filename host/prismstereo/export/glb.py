"""Point clouds and textured meshes as binary glTF 2.0 files: metres, y up, so a point is (x, -y, -z) of the optical frame."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.export.grid_mesh import GridMesh
from prismstereo_hw.errors import DataError

__all__ = ["mesh_glb", "points_glb"]

_MAGIC, _VERSION = 0x46546C67, 2
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_ALIGNED = 4
_MOST_BYTES = (1 << 32) - 1
_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963  # bufferView.target
_POINTS, _TRIANGLES = 0, 4  # primitive.mode
_LINEAR, _REPEAT_NOT = 9729, 33071
_QUALITY = 90
_OPENGL_FROM_OPTICAL = np.array([1.0, -1.0, -1.0])


class _Asset:
    """A file in the making: its JSON, and the bytes that this points into."""

    def __init__(self, name: str) -> None:
        self.bytes = bytearray()
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "prismstereo"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": name}],
        }

    def view(self, content: bytes, target: int | None = None) -> int:
        """Add bytes, aligned, and return the number of their view."""
        self.bytes += b"\0" * (-len(self.bytes) % _ALIGNED)
        found: dict[str, int] = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(content)}
        if target is not None:
            found["target"] = target
        self.bytes += content
        return self._add("bufferViews", found)

    def positions(self, points: NDArray[np.float32]) -> int:
        """Add points of the optical frame in metres and return the number of their accessor, which must say its box."""
        own = np.ascontiguousarray(points * _OPENGL_FROM_OPTICAL, "<f4") + np.float32(0)  # no -0, which prints oddly
        box = {"min": [float(v) for v in own.min(axis=0)], "max": [float(v) for v in own.max(axis=0)]}
        return self._accessor(own, _FLOAT, "VEC3", _VERTICES, box)

    def colours(self, rgb: NDArray[np.uint8]) -> int:
        """Add colours: glTF wants them linear, for which 8 bits are too coarse in the dark."""
        share = rgb / 255.0
        linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        rgba = np.full((len(rgb), 4), 65535, "<u2")
        rgba[:, :3] = np.rint(65535 * linear)
        return self._accessor(rgba, _UNSIGNED_SHORT, "VEC4", _VERTICES, {"normalized": True})

    def places(self, uv: NDArray[np.float32]) -> int:
        """Add places in the texture."""
        return self._accessor(np.ascontiguousarray(uv, "<f4"), _FLOAT, "VEC2", _VERTICES, {})

    def indices(self, triangles: NDArray[np.uint32]) -> int:
        """Add the corners of triangles (N, 3)."""
        return self._accessor(np.ascontiguousarray(triangles, "<u4").reshape(-1), _UNSIGNED_INT, "SCALAR", _INDICES, {})

    def unlit(self, jpeg: bytes | None = None) -> int:
        """Add a material that shows its own colours: what a camera saw is lit already."""
        how: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        if jpeg is not None:
            picture = self._add("images", {"bufferView": self.view(jpeg), "mimeType": "image/jpeg"})
            wrap = {"wrapS": _REPEAT_NOT, "wrapT": _REPEAT_NOT}
            sampler = self._add("samplers", {"magFilter": _LINEAR, "minFilter": _LINEAR, **wrap})
            how["baseColorTexture"] = {"index": self._add("textures", {"source": picture, "sampler": sampler})}
        self.json["extensionsUsed"] = ["KHR_materials_unlit"]
        unlit: dict[str, Any] = {"KHR_materials_unlit": {}}
        return self._add("materials", {"pbrMetallicRoughness": how, "doubleSided": True, "extensions": unlit})

    def show(self, primitive: dict[str, Any]) -> None:
        """Let the scene's node show a primitive."""
        self.json["nodes"][0]["mesh"] = self._add("meshes", {"primitives": [primitive]})

    def packed(self) -> bytes:
        """Return the file; DataError where it is too large for one."""
        if self.bytes:
            self.json["buffers"] = [{"byteLength": len(self.bytes)}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        chunks = _chunk(_JSON_CHUNK, text, b" ")
        if self.bytes:
            chunks += _chunk(_BINARY_CHUNK, bytes(self.bytes), b"\0")
        size = 12 + len(chunks)
        if size > _MOST_BYTES:
            raise DataError(f"a GLB file of {size} bytes: it holds at most {_MOST_BYTES}, export fewer points")
        return struct.pack("<III", _MAGIC, _VERSION, size) + chunks

    def _accessor(
        self, values: NDArray[Any], component: int, kind: str, target: int, more: Mapping[str, object]
    ) -> int:
        view = self.view(values.tobytes(), target)
        return self._add(
            "accessors",
            {"bufferView": view, "componentType": component, "count": len(values), "type": kind, **more},
        )

    def _add(self, what: str, item: dict[str, Any]) -> int:
        held: list[Any] = self.json.setdefault(what, [])
        held.append(item)
        return len(held) - 1


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    content += filler * (-len(content) % _ALIGNED)
    return struct.pack("<II", len(content), kind) + content


def points_glb(points_m: NDArray[np.float32], colours: NDArray[np.uint8] | None = None, name: str = "points") -> bytes:
    """Return points (N, 3) of the optical frame, with colours (N, 3) RGB; without points, a scene of an empty node."""
    asset = _Asset(name)
    if len(points_m):
        attributes = {"POSITION": asset.positions(points_m)}
        if colours is not None:
            attributes["COLOR_0"] = asset.colours(colours)
        asset.show({"attributes": attributes, "mode": _POINTS, "material": asset.unlit()})
    return asset.packed()


def mesh_glb(mesh: GridMesh, picture: NDArray[np.uint8] | None = None, name: str = "mesh") -> bytes:
    """Return a mesh whose texture is the rectified left picture (grey or BGR) as JPEG; without triangles, an empty node."""
    asset = _Asset(name)
    if len(mesh.triangles):
        attributes = {"POSITION": asset.positions(mesh.points_m)}
        jpeg = None
        if picture is not None:
            attributes["TEXCOORD_0"] = asset.places(mesh.texture)
            jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        faces = {"indices": asset.indices(mesh.triangles), "mode": _TRIANGLES, "material": asset.unlit(jpeg)}
        asset.show({"attributes": attributes, **faces})
    return asset.packed()
