"""The rules of glTF 2.0 that a GLB file of ours can break, checked by reading the file anew; nothing of the writer is used.

Numbers in brackets are sections of the specification (Khronos, version 2.0.1).
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_ATTRIBUTES = {  # 3.7.2.1: semantic -> what its accessor may be
    "POSITION": {("VEC3", 5126, False)},
    "TEXCOORD_0": {("VEC2", 5126, False), ("VEC2", 5121, True), ("VEC2", 5123, True)},
    "COLOR_0": {(kind, *how) for kind in ("VEC3", "VEC4") for how in ((5126, False), (5121, True), (5123, True))},
}
_VERTICES, _INDICES = 34962, 34963


class Broken(AssertionError):
    """A rule of glTF 2.0 that a file breaks."""


@dataclass(frozen=True, slots=True)
class Glb:
    """A file that keeps all rules: its JSON, and its bytes."""

    json: dict[str, Any]
    binary: bytes

    def accessor(self, number: int) -> NDArray[Any]:
        """The numbers of an accessor, (count,) or (count, components)."""
        return _values(self.json, self.binary, number)

    def attribute(self, name: str) -> NDArray[Any]:
        return self.accessor(self.primitive["attributes"][name])

    @property
    def primitive(self) -> dict[str, Any]:
        found: dict[str, Any] = self.json["meshes"][0]["primitives"][0]
        return found

    def texture(self) -> NDArray[np.uint8]:
        view = self.json["bufferViews"][self.json["images"][0]["bufferView"]]
        data = self.binary[view["byteOffset"] :][: view["byteLength"]]
        return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def checked(content: bytes) -> Glb:
    """Read a file; `Broken` says which rule it breaks."""
    text, binary = _chunks(content)
    gltf = json.loads(text.decode("utf-8"))
    _require(gltf["asset"]["version"] == "2.0", "3.2: asset.version is 2.0")
    _buffer(gltf, binary)
    for view in gltf.get("bufferViews", ()):
        _view(gltf, view)
    for number, accessor in enumerate(gltf.get("accessors", ())):
        _accessor(gltf, binary, number, accessor)
    for mesh in gltf.get("meshes", ()):
        for primitive in mesh["primitives"]:
            _primitive(gltf, binary, primitive)
    _references(gltf, binary)
    return Glb(gltf, binary)


def _require(kept: bool, rule: str) -> None:
    if not kept:
        raise Broken(rule)


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    magic, version, length = struct.unpack_from("<III", content)
    _require((magic, version, length) == (0x46546C67, 2, len(content)), "4.4.2: magic, version 2, length of the file")
    found: list[tuple[int, bytes]] = []
    at = 12
    while at < len(content):
        size, kind = struct.unpack_from("<II", content, at)
        _require(size % 4 == 0 and at + 8 + size <= len(content), "4.4.3: chunks are of whole fours, inside the file")
        found.append((kind, content[at + 8 : at + 8 + size]))
        at += 8 + size
    _require([kind for kind, _ in found] in ([0x4E4F534A], [0x4E4F534A, 0x004E4942]), "4.4.3: JSON first, then BIN")
    _require(not found[0][1].rstrip(b" ").endswith(b"\0"), "4.4.3.2: JSON is filled up with spaces")
    return found[0][1], found[1][1] if len(found) > 1 else b""


def _buffer(gltf: dict[str, Any], binary: bytes) -> None:
    buffers = gltf.get("buffers", [])
    _require(len(buffers) == bool(binary), "4.4.3.3: one buffer for one BIN chunk")
    for buffer in buffers:
        spare = len(binary) - buffer["byteLength"]
        _require("uri" not in buffer and 0 <= spare <= 3, "4.4.3.3: the chunk is up to 3 bytes longer than its buffer")
        _require(not any(binary[buffer["byteLength"] :]), "4.4.3.3: the binary chunk is filled up with zeros")


def _view(gltf: dict[str, Any], view: dict[str, Any]) -> None:
    end = view.get("byteOffset", 0) + view["byteLength"]
    _require(
        view["byteLength"] >= 1 and end <= gltf["buffers"][view["buffer"]]["byteLength"], "5.11: inside its buffer"
    )
    _require(view.get("target") in (None, _VERTICES, _INDICES), "5.11.5: a known target")


def _accessor(gltf: dict[str, Any], binary: bytes, number: int, accessor: dict[str, Any]) -> None:
    view = gltf["bufferViews"][accessor["bufferView"]]
    size = np.dtype(_COMPONENTS[accessor["componentType"]]).itemsize
    element = size * _TYPES[accessor["type"]]
    offset = accessor.get("byteOffset", 0)
    _require(accessor["count"] >= 1, "5.1.4: count is 1 or more")
    _require((view.get("byteOffset", 0) + offset) % size == 0, "3.6.2.4: aligned to its component")
    _require(offset + element * accessor["count"] <= view["byteLength"], "3.6.2.4: inside its view")
    if view.get("target") == _VERTICES:
        _require(element % 4 == 0 and (view.get("byteOffset", 0) + offset) % 4 == 0, "3.6.2.4: vertices by fours")
    values = _values(gltf, binary, number)
    if accessor["componentType"] == 5126:
        _require(bool(np.isfinite(values).all()), "3.6.2.1: no infinity and no NaN")
    for key, found in (("min", values.min(axis=0)), ("max", values.max(axis=0))):
        if key in accessor:
            _require(np.array_equal(np.float32(accessor[key]), found), f"3.6.2.5: {key} is that of the values")


def _values(gltf: dict[str, Any], binary: bytes, number: int) -> NDArray[Any]:
    accessor = gltf["accessors"][number]
    view = gltf["bufferViews"][accessor["bufferView"]]
    _require("byteStride" not in view, "these tests read tightly packed values only")
    parts = _TYPES[accessor["type"]]
    at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(binary, _COMPONENTS[accessor["componentType"]], accessor["count"] * parts, at)
    return values if parts == 1 else values.reshape(-1, parts)


def _primitive(gltf: dict[str, Any], binary: bytes, primitive: dict[str, Any]) -> None:
    accessors = gltf["accessors"]
    counts = set()
    for name, number in primitive["attributes"].items():
        accessor = accessors[number]
        how = accessor["type"], accessor["componentType"], accessor.get("normalized", False)
        _require(how in _ATTRIBUTES[name], f"3.7.2.1: {name} is of a form that it may have")
        _require(gltf["bufferViews"][accessor["bufferView"]].get("target") == _VERTICES, "5.11.5: vertices' target")
        counts.add(accessor["count"])
    _require(len(counts) == 1, "3.7.2.1: all attributes have one count")
    position = accessors[primitive["attributes"]["POSITION"]]
    _require({"min", "max"} <= position.keys(), "3.7.2.1: POSITION says its box")
    if "indices" in primitive:
        accessor = accessors[primitive["indices"]]
        _require(
            (accessor["type"], accessor["componentType"]) in {("SCALAR", c) for c in (5121, 5123, 5125)}, "3.7.2.1"
        )
        _require(gltf["bufferViews"][accessor["bufferView"]].get("target") == _INDICES, "5.11.5: indices' target")
        values = _values(gltf, binary, primitive["indices"])
        _require(int(values.max()) < counts.pop(), "3.7.2.1: indices point at vertices")
        _require(primitive.get("mode", 4) != 4 or len(values) % 3 == 0, "3.7.2.1: triangles have three corners")


def _references(gltf: dict[str, Any], binary: bytes) -> None:
    _require(
        set(gltf.get("extensionsUsed", ())) >= _extensions(gltf.get("materials", [])), "3.12: extensions are listed"
    )
    _require(all(node < len(gltf["nodes"]) for scene in gltf["scenes"] for node in scene["nodes"]), "3.5: nodes exist")
    for picture in gltf.get("images", ()):
        view = gltf["bufferViews"][picture["bufferView"]]
        start = binary[view.get("byteOffset", 0) :][:3]
        _require(picture["mimeType"] == "image/jpeg" and start == b"\xff\xd8\xff", "3.8.3: what the type says")
        _require("target" not in view, "5.11.5: pictures have no target")
    for texture in gltf.get("textures", ()):
        _require(texture["source"] < len(gltf["images"]) and texture["sampler"] < len(gltf["samplers"]), "3.8.2")


def _extensions(materials: list[dict[str, Any]]) -> set[str]:
    return {name for material in materials for name in material.get("extensions", {})}
