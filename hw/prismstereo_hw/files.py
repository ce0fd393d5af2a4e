"""Files written whole or not at all, and pictures read with one clear complaint."""

from __future__ import annotations

import os
import struct
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import DataError, ImageError

__all__ = ["read_depth_png", "read_picture", "write_picture", "write_whole"]

_MOST_PIXELS = 64 * 1024 * 1024
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


def write_whole(path: str | Path, content: bytes) -> None:
    """Write a file so that a reader, or a power cut, sees the old content or the new one and nothing between."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror}: give a folder that can be written to") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise DataError(f"cannot write {path}: {error.strerror}: nothing was changed") from error
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_picture(path: str | Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write a picture, grey or BGR, in the format that the file name's ending says."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise DataError(f"cannot write {path}: a picture ends in .png, .jpg or .jpeg")
    done, content = cv2.imencode(suffix, pixels)
    if not done:
        raise DataError(f"cannot write {path}: {pixels.dtype} {pixels.shape} does not fit a {suffix} file")
    write_whole(path, content.tobytes())


def _read(path: Path, flags: int) -> NDArray[np.generic]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ImageError(f"cannot read {path}: {error.strerror}") from error
    if content.startswith(_PNG_MAGIC) and len(content) >= 24:
        width, height = struct.unpack(">II", content[16:24])
        if width * height > _MOST_PIXELS:  # asked before decoding: a small file can claim gigabytes
            raise ImageError(f"{path} claims {width}x{height} pixels: at most {_MOST_PIXELS} are read")
    if not content or not _complete(content):
        raise ImageError(f"{path} is cut off or empty ({len(content)} bytes): copy it again")
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise ImageError(f"{path} is not a picture that can be read: give PNG, JPEG, PGM or TIFF")
    if pixels.shape[0] * pixels.shape[1] > _MOST_PIXELS:
        raise ImageError(f"{path} has {pixels.shape[1]}x{pixels.shape[0]} pixels: at most {_MOST_PIXELS} are read")
    return np.asarray(pixels)


def _complete(content: bytes) -> bool:
    """Tell a truncated PNG or JPEG, which decoders fill up with grey, from a whole one."""
    if content.startswith(_PNG_MAGIC):
        return content.rstrip(b"\0").endswith(b"IEND\xaeB`\x82") or b"IEND\xaeB`\x82" in content[-64:]
    if content.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in content[-4096:]
    return True


def read_picture(path: str | Path, *, grey: bool = False) -> NDArray[np.uint8]:
    """Read an 8-bit picture, (height, width, 3) BGR or, with `grey` or if it has no colour, (height, width)."""
    flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_ANYCOLOR
    pixels = _read(Path(path), flags)
    if pixels.dtype != np.uint8:
        raise ImageError(f"{path} has {pixels.dtype} pixels: a raw frame has 8 bits a channel")
    return pixels.astype(np.uint8, copy=False)


def read_depth_png(path: str | Path) -> NDArray[np.uint16]:
    """Read a 16-bit single-channel PNG (height, width), as disparity files are."""
    pixels = _read(Path(path), cv2.IMREAD_UNCHANGED)
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise ImageError(f"{path} is {pixels.dtype} {pixels.shape}: a disparity PNG has one 16-bit channel")
    return pixels.astype(np.uint16, copy=False)
