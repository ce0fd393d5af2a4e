"""Disparity files: PFM (float, Middlebury's convention), 16-bit PNG (sixteenths of a pixel), NPY.

In memory an unmatched pixel is NaN. In a PFM it is +inf and rows run bottom-up; in a PNG it is 0; in an NPY it is NaN.
"""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.files import read_array, read_depth_png, write_whole

__all__ = ["FORMATS", "decode", "encode", "read", "read_disparity", "require_format", "write", "write_disparity"]

FORMATS = (".pfm", ".png", ".npy")
_HEADER = re.compile(
    rb"^Pf[ \t]*\r?\n(?:#[^\n]*\n)*[ \t]*(\d{1,6})[ \t]+(\d{1,6})[ \t]*\r?\n[ \t]*([-+0-9.eE]{1,32})[ \t]*\r?\n"
)
_MOST_PIXELS = 64 * 1024 * 1024
_PNG_STEPS = 16


def encode(values: NDArray[np.float32]) -> bytes:
    """Return a (height, width) float32 map as the bytes of a PFM file; NaN becomes +inf."""
    if values.ndim != 2:
        raise UsageError(f"a PFM holds one (height, width) map, not {values.shape}")
    rows = np.where(np.isnan(values), np.float32(np.inf), values).astype("<f4")[::-1]
    return f"Pf\n{values.shape[1]} {values.shape[0]}\n-1.0\n".encode() + rows.tobytes()


def decode(content: bytes, origin: str) -> NDArray[np.float32]:
    """Return the map in the bytes of a PFM file, inf as NaN; `DataError` names `origin`."""
    header = _HEADER.match(content)
    if header is None:
        raise DataError(f"{origin} is not a single-channel PFM file: it must begin with Pf, width, height, scale")
    width, height = int(header[1]), int(header[2])
    try:
        scale = float(header[3])
    except ValueError:
        scale = math.nan
    if not width * height or width * height > _MOST_PIXELS or not math.isfinite(scale) or scale == 0:
        raise DataError(f"{origin} claims {width}x{height} pixels at scale {header[3].decode()}: that is no picture")
    body = content[header.end() :]
    if len(body) < 4 * width * height:
        raise DataError(f"{origin} is cut off: {len(body)} of {4 * width * height} bytes of pixels are there")
    values = np.frombuffer(body, "<f4" if scale < 0 else ">f4", width * height).reshape(height, width)[::-1]
    return np.where(np.isinf(values), np.float32(np.nan), values).astype(np.float32)


def write(path: str | Path, values: NDArray[np.float32]) -> None:
    """Write a (height, width) float32 map as PFM, whole or not at all."""
    write_whole(path, encode(values))


def read(path: str | Path) -> NDArray[np.float32]:
    """Read a PFM file; unmatched pixels are NaN."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}") from error
    return decode(content, str(path))


def require_format(path: str | Path) -> None:
    """Refuse a name whose ending is no disparity format, before any work is done for it."""
    if Path(path).suffix.lower() not in FORMATS:
        raise UsageError(f"cannot write {path}: a disparity file ends in {', '.join(FORMATS)}")


def write_disparity(path: str | Path, disparity_px: NDArray[np.float32]) -> None:
    """Write a disparity map (height, width), NaN where unmatched, in the format the name's ending says."""
    require_format(path)
    suffix = Path(path).suffix.lower()
    if disparity_px.ndim != 2 or not disparity_px.size:
        raise UsageError(f"cannot write {path}: a disparity map is (height, width), not {disparity_px.shape}")
    if suffix == ".pfm":
        write(path, disparity_px)
    elif suffix == ".png":
        matched = np.isfinite(disparity_px)
        steps = np.clip(np.rint(np.where(matched, disparity_px, 0.0) * _PNG_STEPS), 1, 65535)
        content = cv2.imencode(".png", np.where(matched, steps, 0).astype(np.uint16))[1]
        write_whole(path, content.tobytes())
    else:
        buffer = io.BytesIO()
        np.save(buffer, disparity_px.astype(np.float32), allow_pickle=False)
        write_whole(path, buffer.getvalue())


def read_disparity(path: str | Path) -> NDArray[np.float32]:
    """Read a disparity map (height, width) float32, NaN where unmatched, from PFM, 16-bit PNG or NPY."""
    suffix = Path(path).suffix.lower()
    if suffix == ".pfm":
        return read(path)
    if suffix == ".png":
        steps = read_depth_png(path)
        return np.where(steps == 0, np.float32(np.nan), steps.astype(np.float32) / _PNG_STEPS)
    if suffix == ".npy":
        values = read_array(path)
        if values.ndim != 2 or values.dtype.kind != "f":
            raise DataError(f"{path} holds {values.dtype} {values.shape}: a disparity map is (height, width) float")
        return np.asarray(values, np.float32)
    raise UsageError(f"cannot read {path}: a disparity file ends in {', '.join(FORMATS)}")
