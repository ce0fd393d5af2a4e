"""Buffers as cameras fill them, and the grey or BGR pixels that are in them.

A buffer arrives as its bytes, rows possibly longer than the picture is wide. Every size is checked before anything is
decoded, a JPEG's by its own head.
"""

from __future__ import annotations

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from prismstereo_hw.errors import ImageError
from prismstereo_hw.picture_head import picture_head

__all__ = ["PIXEL_FORMATS", "pixels", "planar_pixels"]

PIXEL_FORMATS = ("YUYV", "UYVY", "NV12", "BGR3", "GREY", "MJPG", "JPEG")  # the more that is in it, the earlier
_PACKED = {  # bytes a pixel, where the brightness stands, how colour is made
    "YUYV": (2, 0, cv2.COLOR_YUV2BGR_YUYV),
    "UYVY": (2, 1, cv2.COLOR_YUV2BGR_UYVY),
}


def pixels(buffer: MatLike, pixel_format: str, size: tuple[int, int], *, colour: bool) -> NDArray[np.uint8]:
    """Return (height, width) grey or, with `colour` and if there is any, (height, width, 3) BGR uint8; `size` is (w, h).

    `pixel_format` is one of `PIXEL_FORMATS`. `ImageError` for a buffer that is too short, or no such picture.
    """
    content = np.ascontiguousarray(buffer).reshape(-1).view(np.uint8)
    if pixel_format in ("MJPG", "JPEG"):
        return _jpeg(content, size, colour=colour)
    if pixel_format == "NV12":
        return _nv12(content, size, colour=colour)
    if pixel_format in _PACKED:
        depth, brightness, code = _PACKED[pixel_format]
        found = _rows(content, size[1], size[0] * depth).reshape(size[1], size[0], depth)
        return _uint8(cv2.cvtColor(found, code)) if colour else np.ascontiguousarray(found[:, :, brightness])
    if pixel_format == "BGR3":
        found = _rows(content, size[1], size[0] * 3).reshape(size[1], size[0], 3)
        return found if colour else _uint8(cv2.cvtColor(found, cv2.COLOR_BGR2GRAY))
    return _rows(content, size[1], size[0])


def _rows(content: NDArray[np.uint8], rows: int, row_bytes: int) -> NDArray[np.uint8]:
    """Cut (rows, row_bytes) out of a buffer whose rows may end in padding, or the whole of it."""
    stride = row_bytes if content.size % rows else content.size // rows
    if stride < row_bytes or content.size < rows * row_bytes:
        raise ImageError(
            f"a buffer of {content.size} bytes is torn: {rows} rows of {row_bytes} bytes do not fit into it"
        )
    return np.ascontiguousarray(content[: rows * stride].reshape(rows, stride)[:, :row_bytes])


def _nv12(content: NDArray[np.uint8], size: tuple[int, int], *, colour: bool) -> NDArray[np.uint8]:
    width, height = size
    planes = _rows(content, height + height // 2, width)
    return _uint8(cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_NV12)) if colour else planes[:height]


def _jpeg(content: NDArray[np.uint8], size: tuple[int, int], *, colour: bool) -> NDArray[np.uint8]:
    head = picture_head(content.tobytes())
    if head is None or not head.whole:
        raise ImageError(f"a picture of {content.size} bytes is cut off, or no JPEG")
    if (head.width, head.height) != size:
        raise ImageError(f"a picture of {head.width}x{head.height} pixels came in a stream of {size[0]}x{size[1]}")
    flags = cv2.IMREAD_IGNORE_ORIENTATION | (cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
    try:
        found = cv2.imdecode(content, flags)
    except cv2.error as error:
        raise ImageError(f"a picture of {content.size} bytes is damaged: {error.err}") from error
    if found is None:
        raise ImageError(f"a picture of {content.size} bytes is damaged")
    return _uint8(found)


def _uint8(found: MatLike) -> NDArray[np.uint8]:
    return np.asarray(found).astype(np.uint8, copy=False)


def planar_pixels(planes: NDArray[np.uint8], size: tuple[int, int], *, colour: bool) -> NDArray[np.uint8]:
    """Return the grey or BGR pixels of full-range YUV 4:2:0 planes; `size` is (width, height), both even.

    `planes` is (height * 3 / 2, stride) uint8: brightness in the first rows, then both colour planes with half the stride.
    """
    width, height = size
    if planes.ndim != 2 or planes.shape[0] != height * 3 // 2 or planes.shape[1] < width or planes.shape[1] % 2:
        raise ImageError(f"planes of {planes.shape} bytes are no YUV 4:2:0 picture of {width}x{height} pixels")
    brightness = np.ascontiguousarray(planes[:height, :width])
    if not colour:
        return brightness
    halves = planes[height:].reshape(height, planes.shape[1] // 2)[:, : width // 2]
    blue, red = (cv2.resize(half, size, interpolation=cv2.INTER_LINEAR) for half in np.split(halves, 2))
    return _uint8(cv2.cvtColor(cv2.merge((brightness, red, blue)), cv2.COLOR_YCrCb2BGR))
