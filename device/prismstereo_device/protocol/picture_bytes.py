"""Compressed pictures: made of pixels, and turned back only after their own heads say what was announced.

A few hundred kilobytes of PNG can unfold to gigabytes, so the size that the file itself states is read first, and every form
that this product does not write (further chunks in a PNG, a JPEG of several scans: each is a pass over all pixels) is refused.
"""

from __future__ import annotations

import re
import struct

import cv2
import numpy as np
import zstandard
from numpy.typing import NDArray

from prismstereo_device.protocol.picture_head import PictureEncoding, PictureHead
from prismstereo_device.wire import WireError

__all__ = ["check_bytes", "compress", "decompress"]

Pixels = NDArray[np.uint8]

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHUNK = struct.Struct(">I4s")
_PNG_HEADER = struct.Struct(">IIBBBBB")
_PNG_CRC = 4
_PNG_COLOUR = {1: 0, 3: 2}  # colour type of a picture with so many channels
_JPEG_SEQUENTIAL = (0xC0, 0xC1)
_JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # what may state a size
_JPEG_SIZE = struct.Struct(">BHHB")
_JPEG_SCAN = 0xDA
_JPEG_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")  # what may not stand within a scan
_ZSTD_LEVEL = 1


def compress(pixels: Pixels, encoding: PictureEncoding, quality: int) -> bytes:
    """Compress pixels (height, width[, 3]) uint8; `quality` (1..100) is JPEG's. Raises WireError where OpenCV cannot."""
    if encoding is PictureEncoding.ZSTD:
        compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_checksum=True, write_content_size=True)
        return compressor.compress(pixels.tobytes())
    name, options = (".png", [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if encoding is PictureEncoding.JPEG:
        name, options = ".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality]
    try:
        done, data = cv2.imencode(name, pixels, options)
    except cv2.error as error:
        raise WireError(f"pixels {pixels.dtype} {pixels.shape} that {name[1:]} cannot hold ({error})") from error
    if not done:
        raise WireError(f"pixels {pixels.dtype} {pixels.shape} that {name[1:]} cannot hold")
    return data.tobytes()


def check_bytes(head: PictureHead, data: bytes) -> None:
    """Raise WireError where the file's own head differs from what was announced, or it is of a form that is not read."""
    if head.encoding is PictureEncoding.PNG:
        _check_png(head, data)
    elif head.encoding is PictureEncoding.JPEG:
        _check_jpeg(head, data)
    else:
        _check_zstd(head, data)


def decompress(head: PictureHead, data: bytes) -> Pixels:
    """Restore the pixels, (height, width[, 3]) uint8; raises WireError on anything else, before it unfolds."""
    check_bytes(head, data)
    if head.encoding is PictureEncoding.ZSTD:
        return _inflate(head, data)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise WireError(f"a picture of {len(data)} bytes that cannot be decoded ({error})") from error
    if pixels is None or pixels.dtype != np.uint8 or pixels.shape != head.shape:
        raise WireError(f"a picture of {len(data)} bytes that does not decode to {head.shape}")
    return pixels.astype(np.uint8, copy=False)


def _inflate(head: PictureHead, data: bytes) -> Pixels:
    try:
        plain = zstandard.ZstdDecompressor().decompress(data, max_output_size=head.samples, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise WireError(f"a picture of {len(data)} bytes that is not zstd: {error}") from error
    if len(plain) != head.samples:
        raise WireError(f"a picture of {len(plain)} bytes: {head.samples} are due")
    return np.frombuffer(plain, np.uint8).reshape(head.shape)


def _check_zstd(head: PictureHead, data: bytes) -> None:
    try:
        declared = zstandard.get_frame_parameters(data)
    except zstandard.ZstdError as error:
        raise WireError(f"a picture of {len(data)} bytes that is not zstd: {error}") from error
    if declared.content_size != head.samples or not declared.has_checksum or declared.dict_id:
        raise WireError(f"a picture that unpacks to {declared.content_size} bytes: {head.samples} are due")


def _check_png(head: PictureHead, data: bytes) -> None:
    names: list[bytes] = []
    at = len(_PNG)
    while at + _PNG_CHUNK.size <= len(data) and names[-1:] != [b"IEND"]:
        length, name = _PNG_CHUNK.unpack_from(data, at)
        names.append(name)
        at += _PNG_CHUNK.size + length + _PNG_CRC
    due = [b"IHDR", *[b"IDAT"] * max(1, len(names) - 2), b"IEND"]
    if data[: len(_PNG)] != _PNG or names != due or at != len(data):
        raise WireError(f"a picture of {len(data)} bytes that is not a PNG of header, pixels and end alone")
    stated = _PNG_HEADER.unpack_from(data, len(_PNG) + _PNG_CHUNK.size)
    announced = (head.width, head.height, 8, _PNG_COLOUR[head.channels], 0, 0, 0)
    if stated != announced:
        raise WireError(f"a PNG with header {stated}: {announced} is announced")


def _check_jpeg(head: PictureHead, data: bytes) -> None:
    frames, at = [], 2
    while data[at : at + 1] == b"\xff" and at + 4 <= len(data) and data[at + 1] != _JPEG_SCAN:
        if data[at + 1] in _JPEG_FRAMES:
            frames.append((data[at + 1], *_jpeg_size(data, at)))
        at += 2 + max(2, int.from_bytes(data[at + 2 : at + 4], "big"))
    scan = data[:2] == b"\xff\xd8" and data[at : at + 2] == bytes([0xFF, _JPEG_SCAN])
    end = _JPEG_MARKER.search(data, at + 2)
    if not scan or end is None or end.group() != b"\xff\xd9" or end.end() != len(data):
        raise WireError(f"a picture of {len(data)} bytes that is not a JPEG of one scan from start to end")
    due = [8, head.height, head.width, head.channels]
    if len(frames) != 1 or frames[0][0] not in _JPEG_SEQUENTIAL or list(frames[0][1:]) != due:
        raise WireError(
            f"a JPEG with kind, depth, height, width, colours {frames}: one, sequential, {due} is announced"
        )


def _jpeg_size(data: bytes, at: int) -> tuple[int, int, int, int]:
    if at + 4 + _JPEG_SIZE.size > len(data):
        raise WireError(f"a JPEG of {len(data)} bytes that ends within its head")
    depth, height, width, colours = _JPEG_SIZE.unpack_from(data, at + 4)
    return depth, height, width, colours
