r"""The calibration as the bytes that a camera keeps: `store`'s JSON in an envelope that notices any flipped bit.

    offset  bytes
    0       4       magic "PSC\n"
    4       2       version of the envelope, 1, little-endian
    6       4       length of the text, little-endian
    10      n       canonical JSON (see `schema`)
    10+n    4       CRC-32C of everything before, little-endian

`digest` of these bytes is the calibration's hash on the wire: eight bytes that tell a host whether its copy is the one
the camera computes with.
"""

from __future__ import annotations

import hashlib
import struct

import google_crc32c

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.schema import MAX_BYTES, decode, encode

__all__ = ["DIGEST_BYTES", "digest", "pack", "unpack"]

DIGEST_BYTES = 8
_MAGIC = b"PSC\n"
_VERSION = 1
_HEAD = struct.Struct("<4sHI")
_CRC = struct.Struct("<I")
_MEND = "write it again with `prismstereo flash`"


def pack(calibration: Calibration) -> bytes:
    """Return the bytes to keep on the camera, at most 256 KiB."""
    text = encode(calibration)
    body = _HEAD.pack(_MAGIC, _VERSION, len(text)) + text
    packed = body + _CRC.pack(google_crc32c.value(body))
    if len(packed) > MAX_BYTES:
        raise CalibrationError(f"the calibration takes {len(packed)} bytes of flash, but {MAX_BYTES} are there")
    return packed


def unpack(data: bytes) -> Calibration:
    """Read the calibration back, exactly as it was packed; `CalibrationError` if a single bit is not as it was."""
    if len(data) > MAX_BYTES:
        raise CalibrationError(f"flash holds {len(data)} bytes, but a calibration has at most {MAX_BYTES}: {_MEND}")
    if len(data) < _HEAD.size + _CRC.size:
        raise CalibrationError(f"flash holds {len(data)} bytes, too few for a calibration: {_MEND}")
    magic, version, length = _HEAD.unpack_from(data)
    if magic != _MAGIC:
        raise CalibrationError(f"flash begins with {magic!r}, not with {_MAGIC!r}: no calibration was written; {_MEND}")
    if version != _VERSION:
        raise CalibrationError(f"flash has envelope version {version}, but {_VERSION} is read here: {_MEND}")
    if len(data) != _HEAD.size + length + _CRC.size:
        raise CalibrationError(
            f"flash holds {len(data)} bytes, but says {_HEAD.size + length + _CRC.size}: it was cut; {_MEND}"
        )
    (said,) = _CRC.unpack_from(data, len(data) - _CRC.size)
    found = google_crc32c.value(data[: -_CRC.size])
    if said != found:
        raise CalibrationError(f"flash has CRC {found:08x}, but says {said:08x}: it was damaged; {_MEND}")
    return decode(data[_HEAD.size : -_CRC.size], "flash")


def digest(data: bytes) -> bytes:
    """Return the first 8 bytes of the sha256 of packed bytes: the calibration's hash on the wire."""
    return hashlib.sha256(data).digest()[:DIGEST_BYTES]
