"""What the first bytes of a picture file claim, asked before a decoder is let loose on the rest.

Decoders allocate what the header says and fill up with grey what is missing. So the size is read here, and whether the
file runs to its end.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

__all__ = ["PictureHead", "picture_head"]

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_JPEG_END = b"\xff\xd9"
_JPEG_SCAN = 0xDA
_JPEG_ALONE = {0x01, *range(0xD0, 0xD8)}  # markers with no length behind them
_JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_BMP_INFO_BYTES = 40
_PNM = re.compile(
    rb"P([2356])((?:\s+|#[^\n]*\n)+)(\d{1,9})((?:\s+|#[^\n]*\n)+)(\d{1,9})((?:\s+|#[^\n]*\n)+)(\d{1,5})\s"
)
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_SHORT = 256, 257, 3


@dataclass(frozen=True, slots=True)
class PictureHead:
    """The claimed size in pixels, and whether the file is all there."""

    width: int
    height: int
    whole: bool


def picture_head(content: bytes) -> PictureHead | None:
    """Return what PNG, JPEG, BMP, PGM, PPM or TIFF bytes claim; None for anything else."""
    try:
        if content.startswith(_PNG):
            width, height = struct.unpack_from(">II", content, 16)
            return PictureHead(width, height, _PNG_END in content[-64:])
        if content.startswith(b"\xff\xd8"):
            return _jpeg(content)
        if content.startswith(b"BM"):
            return _bmp(content)
        if content[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(content)
    except struct.error:  # it ends within its own header
        return PictureHead(0, 0, whole=False)
    return _pnm(content) if content else PictureHead(0, 0, whole=False)


def _jpeg(content: bytes) -> PictureHead:
    at, size = 2, (0, 0)
    while True:
        fill, marker = struct.unpack_from(">BB", content, at)
        if fill != 0xFF or marker == 0xFF:
            at += 1
        elif marker in _JPEG_ALONE:
            at += 2
        elif marker == _JPEG_SCAN:  # a preview picture ends before it, the picture itself behind it
            return PictureHead(*size, whole=_JPEG_END in content[at:])
        else:
            if marker in _JPEG_FRAMES:
                height, width = struct.unpack_from(">HH", content, at + 5)
                size = width, height
            at += 2 + struct.unpack_from(">H", content, at + 2)[0]


def _bmp(content: bytes) -> PictureHead:
    file_bytes, header_bytes = struct.unpack_from("<I", content, 2)[0], struct.unpack_from("<I", content, 14)[0]
    width, height = struct.unpack_from("<ii" if header_bytes >= _BMP_INFO_BYTES else "<HH", content, 18)
    return PictureHead(abs(width), abs(height), whole=len(content) >= file_bytes)


def _tiff(content: bytes) -> PictureHead:
    order = "<" if content.startswith(b"II") else ">"
    directory = struct.unpack_from(order + "I", content, 4)[0]
    values = {_TIFF_WIDTH: 0, _TIFF_HEIGHT: 0}
    for entry in range(struct.unpack_from(order + "H", content, directory)[0]):
        at = directory + 2 + 12 * entry
        tag, kind = struct.unpack_from(order + "HH", content, at)
        if tag in values:
            values[tag] = struct.unpack_from(order + ("H" if kind == _TIFF_SHORT else "I"), content, at + 8)[0]
    return PictureHead(values[_TIFF_WIDTH], values[_TIFF_HEIGHT], whole=True)


def _pnm(content: bytes) -> PictureHead | None:
    head = _PNM.match(content)
    if head is None:
        return None
    width, height = int(head[3]), int(head[5])
    sample_bytes = (2 if int(head[7]) > 255 else 1) * (3 if head[1] in b"36" else 1)
    needed = 2 if head[1] in b"23" else sample_bytes  # in plain text, a digit and a space at least
    return PictureHead(width, height, whole=len(content) + 1 - head.end() >= needed * width * height)
