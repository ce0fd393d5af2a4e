"""The calibration as a file: JSON of a fixed form, every number with its unit in the key.

Lengths stand under `..._mm`, or under `..._squares` where the board's squares were never measured. `far_mm` null is
infinity. `sha256` is that of the canonical text (no spaces, fields in order) without itself; a file edited by hand may
leave it out. Nothing is taken on trust: a wrong type, a number that is not finite, or one out of its bounds, a missing
and an unknown key and one given twice are refused by name.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType
from msgspec.structs import replace

from prismstereo_calibration import photometry, static_mask
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.meeting_views import require_meeting
from prismstereo_calibration.model import Calibration, Model, Unit
from prismstereo_calibration.photometry import PhotometryPart
from prismstereo_calibration.schema_parts import (
    CovariancePart,
    LensPart,
    OutputPart,
    PlatePart,
    ViewPart,
    covariance_part,
    lens_of,
    lens_part,
    output_of,
    output_part,
    plate_of,
    plate_part,
    uncertainty_of,
    view_of,
    view_part,
)
from prismstereo_calibration.single_keys import require_single_keys
from prismstereo_calibration.static_mask import StaticMaskPart
from prismstereo_hw.errors import RigError
from prismstereo_hw.rig import RangeWish

__all__ = ["MAX_BYTES", "SCHEMA", "CalibrationFile", "decode", "encode", "from_file", "to_file"]

SCHEMA: Literal["prismstereo-calibration/1"] = "prismstereo-calibration/1"
MAX_BYTES = 256 * 1024

_Pixels = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Focal = Annotated[float, Meta(gt=0, le=1e6)]
_Coefficient = Annotated[float, Meta(ge=-1e9, le=1e9)]  # k3 of a narrow lens is large and harmless
_Cosine = Annotated[float, Meta(ge=-1.001, le=1.001)]
_Length = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Distance = Annotated[float, Meta(gt=0, le=1e9)]
_Fraction = Annotated[float, Meta(ge=0, le=1)]
_Count = Annotated[int, Meta(ge=0, le=1_000_000)]
_Size = Annotated[int, Meta(ge=1, le=65536)]
_Small = Annotated[int, Meta(ge=0, le=8)]
_Row = tuple[_Cosine, _Cosine, _Cosine]


class CalibrationFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The whole file, field by field in the order in which it is written."""

    schema: Literal["prismstereo-calibration/1"]
    rig: Annotated[str, Meta(max_length=1000)]
    model: Model
    unit: Unit
    frame_width_px: _Size
    frame_height_px: _Size
    left_view: ViewPart
    right_view: ViewPart
    left_lens: LensPart
    right_lens: LensPart
    R_right_from_left: tuple[_Row, _Row, _Row]
    t_right_from_left_mm: tuple[_Length, _Length, _Length] | UnsetType = UNSET
    t_right_from_left_squares: tuple[_Length, _Length, _Length] | UnsetType = UNSET
    near_mm: _Distance | UnsetType = UNSET
    far_mm: _Distance | UnsetType | None = UNSET
    near_squares: _Distance | UnsetType = UNSET
    far_squares: _Distance | UnsetType | None = UNSET
    labels: _Count
    lens_position: Annotated[int, Meta(ge=-1_000_000, le=1_000_000)] | None
    rms_px: Annotated[float, Meta(ge=0, le=1e6)] | None
    views_used: _Count
    glass: PlatePart | UnsetType = UNSET
    temperature_c: Annotated[float, Meta(ge=-100, le=200)] | UnsetType = UNSET
    outputs: Annotated[tuple[OutputPart, ...], Meta(max_length=16)] | UnsetType = UNSET
    covariance: CovariancePart | UnsetType = UNSET
    photometry: PhotometryPart | UnsetType = UNSET
    mask: StaticMaskPart | UnsetType = UNSET
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")] | UnsetType = UNSET


class _Head(msgspec.Struct):
    """What is looked at first, whatever else stands in the file."""

    schema: str


_decoder = msgspec.json.Decoder(CalibrationFile)
_head_decoder = msgspec.json.Decoder(_Head)


def _sha256(content: CalibrationFile) -> str:
    return hashlib.sha256(msgspec.json.encode(replace(content, sha256=UNSET))).hexdigest()


def to_file(calibration: Calibration) -> CalibrationFile:
    """Turn a calibration into its file form, the sha256 of the content included."""
    left, right, wish = calibration.left, calibration.right, calibration.range
    suffix = "mm" if calibration.unit == "mm" else "squares"
    lengths = {
        f"t_right_from_left_{suffix}": tuple(right.t_camera_from_left.tolist()),
        f"near_{suffix}": float(wish.near_mm),
        f"far_{suffix}": float(wish.far_mm) if math.isfinite(wish.far_mm) else None,
    }
    a, b, c = (tuple(row) for row in right.R_camera_from_left.tolist())
    content = CalibrationFile(
        schema=SCHEMA,
        rig=calibration.rig,
        model=calibration.model,
        unit=calibration.unit,
        frame_width_px=calibration.frame_width,
        frame_height_px=calibration.frame_height,
        left_view=view_part(calibration.left_view),
        right_view=view_part(calibration.right_view),
        left_lens=lens_part(left.lens),
        right_lens=lens_part(right.lens),
        R_right_from_left=(a, b, c),
        labels=wish.labels,
        lens_position=calibration.lens_position,
        rms_px=None if calibration.rms_px is None else float(calibration.rms_px),
        views_used=calibration.views_used,
        glass=UNSET if left.plate is None else plate_part(left.plate),
        temperature_c=UNSET if calibration.temperature_c is None else float(calibration.temperature_c),
        outputs=tuple(map(output_part, calibration.outputs)) or UNSET,
        covariance=UNSET if calibration.uncertainty is None else covariance_part(calibration.uncertainty),
        photometry=UNSET if calibration.photometry is None else photometry.part_of(calibration.photometry),
        mask=UNSET if calibration.mask is None else static_mask.part_of(calibration.mask),
    )
    content = replace(content, **lengths)
    return replace(content, sha256=_sha256(content))


def _lengths(content: CalibrationFile) -> tuple[tuple[float, float, float], float, float]:
    """Return translation, near and far end in the file's unit; refuse lengths that stand under the other unit."""
    values = {"mm": (content.t_right_from_left_mm, content.near_mm, content.far_mm)}
    values["squares"] = (content.t_right_from_left_squares, content.near_squares, content.far_squares)
    wanted, other = ("mm", "squares") if content.unit == "mm" else ("squares", "mm")
    for key, value in zip(("t_right_from_left", "near", "far"), values[other], strict=True):
        if value is not UNSET:
            raise CalibrationError(f"{key}_{other} has no place in a file whose unit is {content.unit!r}")
    for key, value in zip(("t_right_from_left", "near", "far"), values[wanted], strict=True):
        if value is UNSET:
            raise CalibrationError(f"{key}_{wanted} is missing, and unit is {content.unit!r}")
    t, near, far = values[wanted]
    assert not isinstance(t, UnsetType)
    assert not isinstance(near, UnsetType)
    assert not isinstance(far, UnsetType)
    return t, near, math.inf if far is None else far


def from_file(content: CalibrationFile) -> Calibration:
    """Make the calibration that a file describes; `CalibrationError` names the field that cannot be."""
    if content.sha256 is not UNSET and content.sha256 != _sha256(content):
        raise CalibrationError(
            "sha256 does not belong to this content: the file was damaged or edited; restore it, or leave sha256 out "
            "if the change was meant"
        )
    t, near, far = _lengths(content)
    try:
        wish = RangeWish(near_mm=near, far_mm=far, labels=content.labels)
        left_view, right_view = view_of(content.left_view), view_of(content.right_view)
    except RigError as error:
        raise CalibrationError(str(error)) from error
    plate = None if content.glass is UNSET else plate_of(content.glass)
    calibration = Calibration(
        rig=content.rig,
        frame_width=content.frame_width_px,
        frame_height=content.frame_height_px,
        left_view=left_view,
        right_view=right_view,
        left=Camera.at_origin(lens_of(content.left_lens), plate),
        right=Camera(lens_of(content.right_lens), np.array(content.R_right_from_left), np.array(t), plate),
        range=wish,
        model=content.model,
        unit=content.unit,
        lens_position=content.lens_position,
        rms_px=content.rms_px,
        views_used=content.views_used,
        temperature_c=None if content.temperature_c is UNSET else content.temperature_c,
        uncertainty=None if content.covariance is UNSET else uncertainty_of(content.covariance),
        outputs=() if content.outputs is UNSET else tuple(map(output_of, content.outputs)),
        photometry=None if content.photometry is UNSET else photometry.of_part(content.photometry),
        mask=None if content.mask is UNSET else static_mask.of_part(content.mask),
    )
    _require_sense(calibration)
    return calibration


def _require_sense(calibration: Calibration) -> None:
    """Refuse what is a calibration by all its numbers and of no use all the same."""
    names = [output.name for output in calibration.outputs]
    if len(set(names)) < len(names):
        raise CalibrationError(f"outputs have the names {', '.join(names)}: give each its own")
    require_meeting(calibration)


def encode(calibration: Calibration) -> bytes:
    """Return the canonical JSON text of a calibration, UTF-8; floats come back exactly.

    `CalibrationError` names a value that `decode` would refuse, so what is written can be read.
    """
    _require_sense(calibration)
    content = to_file(calibration)
    text = msgspec.json.encode(content)
    try:
        again = _decoder.decode(text)
    except msgspec.ValidationError as error:
        raise CalibrationError(f"this calibration cannot be kept in a file: {error}") from error
    if again != content:  # JSON writes null for what is not finite
        raise CalibrationError("this calibration cannot be kept in a file: it has a number that is not finite")
    return text


def decode(text: bytes, origin: str) -> Calibration:
    """Read a calibration from JSON text; `CalibrationError` names `origin` and the field that is wrong."""
    try:
        _require_head(text)
        content = _decoder.decode(text)
        require_single_keys(text)
        return from_file(content)
    except CalibrationError as error:
        raise CalibrationError(f"{origin}: {error}") from error
    except msgspec.ValidationError as error:
        raise CalibrationError(f"{origin} is not a calibration: {error}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise CalibrationError(f"{origin} is not JSON: {_not_a_number(text) or error}") from error


def _require_head(text: bytes) -> None:
    """Refuse another kind of file before its fields are looked at."""
    if text.startswith(b"\xef\xbb\xbf"):
        raise CalibrationError("it begins with a byte order mark: save it as plain UTF-8")
    schema = _head_decoder.decode(text).schema
    if schema.startswith("prismstereo-rectification/"):
        raise CalibrationError("it is a rectification from a scene, which has no scale: calibrate with a board")
    if schema != SCHEMA:
        raise CalibrationError(f"schema is {schema!r}, but only {SCHEMA!r} is read here: calibrate again")


def _not_a_number(text: bytes) -> str | None:
    """Name the field that holds NaN or Infinity: Python writes them, JSON has no such words."""
    try:
        content = json.loads(text, parse_constant=lambda word: {word: None})
        msgspec.convert(content, CalibrationFile)
    except msgspec.ValidationError as error:
        return f"NaN and Infinity are no numbers of JSON ({error})"
    except (ValueError, RecursionError):
        return None
    return None
