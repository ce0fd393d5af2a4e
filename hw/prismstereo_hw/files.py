"""Files written whole or not at all, and pictures read with one clear complaint."""

from __future__ import annotations

import os
import secrets
import tokenize
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import DataError, ImageError
from prismstereo_hw.picture_head import picture_head

__all__ = ["read_array", "read_depth_png", "read_picture", "write_picture", "write_whole"]

_MOST_PIXELS = 64 * 1024 * 1024
_BAD_ARRAY = (OSError, ValueError, EOFError, OverflowError)
_BAD_HEADER = (SyntaxError, tokenize.TokenError, RecursionError, MemoryError)  # an NPY header is a Python literal
_AS_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION  # the rig's views stand as the sensor has them


def write_whole(path: str | Path, content: bytes) -> None:
    """Write a file so that a reader, or a power cut, sees the old content or the new one and nothing between."""
    path = Path(path)
    unfinished = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with unfinished.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(unfinished, path)
    except OSError as error:
        _forget(unfinished)
        raise DataError(
            f"cannot write {path}: {error.strerror}: nothing was changed, give a folder that can be written to"
        ) from error
    except BaseException:
        _forget(unfinished)
        raise


def _forget(path: Path) -> None:
    with suppress(OSError):  # where it could not be made, there is nothing to remove
        path.unlink()


def write_picture(path: str | Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write a picture, grey or BGR, in the format that the file name's ending says."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise DataError(f"cannot write {path}: a picture ends in .png, .jpg or .jpeg")
    depths = (np.uint8, np.uint16) if suffix == ".png" else (np.uint8,)
    if pixels.dtype not in depths or pixels.ndim not in (2, 3) or pixels.shape[2:] not in ((), (3,)) or not pixels.size:
        raise DataError(
            f"cannot write {path}: {pixels.dtype} {pixels.shape} does not fit a {suffix} file: give 8-bit grey or BGR"
        )
    write_whole(path, cv2.imencode(suffix, pixels)[1].tobytes())


def _read(path: Path, flags: int) -> NDArray[np.generic]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ImageError(f"cannot read {path}: {error.strerror}") from error
    head = picture_head(content)
    if head is None:
        raise ImageError(f"{path} is not a picture that can be read: give PNG, JPEG, PGM, BMP or TIFF")
    if head.width * head.height > _MOST_PIXELS:  # asked before decoding: a small file can claim gigabytes
        raise ImageError(f"{path} claims {head.width}x{head.height} pixels: at most {_MOST_PIXELS} are read")
    if not head.whole:
        raise ImageError(f"{path} is cut off or empty ({len(content)} bytes): copy it again")
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise ImageError(f"{path} is a damaged picture: copy it again")
    return np.asarray(pixels)


def read_picture(path: str | Path, *, grey: bool = False) -> NDArray[np.uint8]:
    """Read an 8-bit picture, (height, width, 3) BGR or, with `grey` or if it has no colour, (height, width)."""
    pixels = _read(Path(path), _AS_STORED | (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_ANYCOLOR))
    if pixels.dtype != np.uint8:
        raise ImageError(f"{path} has {pixels.dtype} pixels: a raw frame has 8 bits a channel")
    return pixels.astype(np.uint8, copy=False)


def read_depth_png(path: str | Path) -> NDArray[np.uint16]:
    """Read a 16-bit single-channel PNG (height, width), as disparity files are."""
    pixels = _read(Path(path), cv2.IMREAD_UNCHANGED)
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise ImageError(f"{path} is {pixels.dtype} {pixels.shape}: a disparity PNG has one 16-bit channel")
    return pixels.astype(np.uint16, copy=False)


def read_array(path: str | Path) -> NDArray[np.generic]:
    """Read an NPY file of plain numbers, of any shape; `DataError` for anything else, however large it says it is."""
    try:
        mapped = np.lib.format.open_memmap(os.fspath(path), mode="r")
        return np.array(mapped)
    except (*_BAD_ARRAY, *_BAD_HEADER) as error:
        raise DataError(f"{path} is not a readable NPY file: {error}") from error
