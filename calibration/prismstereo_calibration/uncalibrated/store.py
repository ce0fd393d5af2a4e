"""A scale-free rectification as a file: JSON of a fixed form, written whole or not at all.

The views stand as in a calibration file, as fractions of the frame. `sha256` is that of the canonical text without itself;
a file edited by hand may leave it out. Nothing is taken on trust: what is missing, unknown, given twice, of another type or
out of its bounds is refused by name.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType
from msgspec.structs import replace

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.schema_parts import ViewPart, view_of, view_part
from prismstereo_calibration.single_keys import require_single_keys
from prismstereo_calibration.uncalibrated.form_figures import Form, FormFigures, evened
from prismstereo_calibration.uncalibrated.pictures import ViewPictures
from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification, SceneView
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.errors import RigError
from prismstereo_hw.files import write_whole

__all__ = ["SCHEMA", "decode", "encode", "is_scene_rectification", "read", "write"]

SCHEMA: Literal["prismstereo-rectification/1"] = "prismstereo-rectification/1"
_MAX_BYTES = 256 * 1024

_Entry = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Row = tuple[_Entry, _Entry, _Entry]
_Size = Annotated[int, Meta(ge=1, le=65536)]


class _SidePart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One view, and the homography from its upright pixels to rectified ones."""

    view: ViewPart
    H_rectified_from_upright: tuple[_Row, _Row, _Row]


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The whole file, field by field in the order in which it is written."""

    schema: Literal["prismstereo-rectification/1"]
    rig: Annotated[str, Meta(max_length=1000)]
    frame_width_px: _Size
    frame_height_px: _Size
    left: _SidePart
    right: _SidePart
    width_px: _Size
    height_px: _Size
    labels: Annotated[int, Meta(ge=16, le=1024, multiple_of=16)]
    scale: Annotated[float, Meta(gt=0, le=1)]
    form: Form
    reason: Annotated[str, Meta(max_length=1000)]
    matches: Annotated[int, Meta(ge=0, le=1_000_000)]
    figures: Annotated[tuple[FormFigures, ...], Meta(min_length=1, max_length=8)]
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")] | UnsetType = UNSET


class _Head(msgspec.Struct):
    """What is looked at first, whatever else stands in the file."""

    schema: str


_decoder = msgspec.json.Decoder(_File)
_head_decoder = msgspec.json.Decoder(_Head)


def write(path: str | Path, made: SceneRectification) -> None:
    """Write a rectification file; on any failure the old file stays as it was and `DataError` says why."""
    write_whole(path, msgspec.json.format(encode(made), indent=2) + b"\n")


def read(path: str | Path) -> SceneRectification:
    """Read a rectification file; `CalibrationError` names the file and the field that is wrong."""
    return decode(_bytes(Path(path)), str(path))


def is_scene_rectification(path: str | Path) -> bool:
    """Tell whether a file says that it is a scale-free rectification, whatever else may be wrong with it."""
    try:
        return _head_decoder.decode(_bytes(Path(path))).schema == SCHEMA
    except (CalibrationError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return False


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise CalibrationError(
            f"{path} cannot be read: {error.strerror}: make one with `prismstereo calibrate --from-scene`"
        ) from error
    if len(text) > _MAX_BYTES:
        raise CalibrationError(f"{path} has more than {_MAX_BYTES} bytes: a rectification file is far smaller")
    return text


def _sha256(content: _File) -> str:
    return hashlib.sha256(msgspec.json.encode(replace(content, sha256=UNSET))).hexdigest()


def _part(side: SceneView) -> _SidePart:
    a, b, c = (tuple(row) for row in side.H_rectified_from_upright.tolist())
    return _SidePart(view=view_part(side.view), H_rectified_from_upright=(a, b, c))


def encode(made: SceneRectification) -> bytes:
    """Return the canonical JSON text of a rectification, UTF-8; floats come back exactly.

    `CalibrationError` names a value that `decode` would refuse, so what is written can be read.
    """
    content = _File(
        schema=SCHEMA,
        rig=made.rig,
        frame_width_px=made.frame_width,
        frame_height_px=made.frame_height,
        left=_part(made.left),
        right=_part(made.right),
        width_px=made.width,
        height_px=made.height,
        labels=made.window.labels,
        scale=made.scale,
        form=made.form,
        reason=made.reason,
        matches=made.matches,
        figures=made.figures,
    )
    try:
        content = _decoder.decode(msgspec.json.encode(content))  # a whole number given for a fraction becomes one
    except msgspec.ValidationError as error:
        raise CalibrationError(f"this rectification cannot be kept in a file: {error}") from error
    text = msgspec.json.encode(replace(content, sha256=_sha256(content)))
    decode(text, "this rectification")
    return text


def decode(text: bytes, origin: str) -> SceneRectification:
    """Read a rectification from JSON text; `CalibrationError` names `origin` and the field that is wrong."""
    try:
        _require_plain(text)
        _require_schema(text)
        content = _decoder.decode(text)
        require_single_keys(text)
        return _from_file(content)
    except (CalibrationError, RigError) as error:
        raise CalibrationError(f"{origin}: {error}") from error
    except msgspec.ValidationError as error:
        raise CalibrationError(f"{origin} is not a rectification: {error}") from error
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise CalibrationError(f"{origin} is not JSON: {error}") from error


def _require_plain(text: bytes) -> None:
    """Refuse what Python would read, and other readers in another way or not at all."""
    if text.startswith(b"\xef\xbb\xbf"):
        raise CalibrationError("it begins with a byte order mark: save it as plain UTF-8")
    json.loads(text, object_pairs_hook=_plain, parse_constant=_NoNumber)


def _require_schema(text: bytes) -> None:
    """Refuse another kind of file before its fields are looked at."""
    schema = _head_decoder.decode(text).schema
    if schema.startswith("prismstereo-calibration/"):
        raise CalibrationError(f"schema is {schema!r}: a calibration with a scale, and no rectification from a scene")
    if schema != SCHEMA:
        raise CalibrationError(f"schema is {schema!r}, but only {SCHEMA!r} is read here: make the file again")


@dataclass(frozen=True, slots=True)
class _NoNumber:
    """A word that Python writes for a number and JSON does not know: NaN, Infinity."""

    word: str


def _plain(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Refuse a number that is none by the name of its field."""
    for key, value in pairs:
        odd = _no_number(value)
        if odd is not None:
            raise CalibrationError(f"{key} has {odd.word}, which is no number of JSON: give finite numbers")
    return dict(pairs)


def _no_number(value: object) -> _NoNumber | None:
    if isinstance(value, list):
        return next((odd for odd in map(_no_number, value) if odd is not None), None)
    return value if isinstance(value, _NoNumber) else None


def _from_file(content: _File) -> SceneRectification:
    if content.sha256 is not UNSET and content.sha256 != _sha256(content):
        raise CalibrationError(
            "sha256 does not belong to this content: the file was damaged or edited; restore it, or leave sha256 out if the "
            "change was meant"
        )
    if content.form not in {one.form for one in content.figures}:
        raise CalibrationError(f"form is {content.form!r}, but figures has no entry for it")
    sides = [
        SceneView(view_of(part.view), np.array(part.H_rectified_from_upright, float))
        for part in (content.left, content.right)
    ]
    pictures = ViewPictures.of((sides[0].view, sides[1].view), content.frame_width_px, content.frame_height_px)
    if evened(sides[0].H_rectified_from_upright, sides[1].H_rectified_from_upright, pictures) is None:
        raise CalibrationError(
            "H_rectified_from_upright of left or right turns its view inside out: make the file again"
        )
    return SceneRectification(
        left=sides[0],
        right=sides[1],
        width=content.width_px,
        height=content.height_px,
        frame_width=content.frame_width_px,
        frame_height=content.frame_height_px,
        window=DisparityWindow(content.labels),
        scale=content.scale,
        form=content.form,
        reason=content.reason,
        figures=content.figures,
        matches=content.matches,
        rig=content.rig,
    )
