"""The fixed numbers of wire format version 1, and the one error its parsers raise.

Stream = packets separated by 0x00. Packet = COBS( header | payload | crc ). All numbers little endian.

    offset size  header field
    0      1     bits 0-3 channel; 0x10 first, 0x20 last fragment; 0x40 reply; 0x80 reserved, must be 0
    1      2     seq   per channel and direction, +1 each packet: loss statistics only
    3      2     msg   frame id low bits (video) or request id (commands, bulk)
    5      2     frag  fragment index in the message
    7      0..   payload
    7+n    4     CRC-32C over bytes 0..6+n followed by the 4 session bytes (not sent); session 0 on the hello channel
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from prismstereo_hw.errors import DataError

__all__ = [
    "FIRST",
    "LAST",
    "LIMITS",
    "REPLY",
    "RESERVED",
    "VERSION_MAX",
    "VERSION_MIN",
    "Channel",
    "Limits",
    "WireError",
]

VERSION_MIN = 1
VERSION_MAX = 1

FIRST = 0x10  # this packet begins its message
LAST = 0x20  # this packet ends its message
REPLY = 0x40  # the answer to a request with the same `msg`
RESERVED = 0x80  # never sent by version 1; a packet that has it is dropped


class WireError(DataError):
    """Bytes that do not follow the wire format."""


class Channel(IntEnum):
    """What a packet is about; a reader ignores and counts the ones it does not know."""

    CTRL = 0  # ping, pong, frame acknowledgement
    CMD = 1  # commands
    DISP = 2  # disparity stripes, newest frame wins
    IMG = 3  # preview pictures, newest wins
    BULK = 4  # objects by offset: calibration, stills, logs, updates
    HEALTH = 5  # counters, once a second
    ZONES = 6  # nearest distance of each zone of the picture
    REASON = 7  # why pixels are unmatched, at a quarter of the resolution
    CONFIDENCE = 8  # how sure matches are, at a quarter of the resolution
    RAW = 9  # the sensor's own frames, for recording and calibration
    HELLO = 15  # versions and session; the only channel outside a session


@dataclass(frozen=True, slots=True)
class Limits:
    """What a reader accepts at most; checked before anything is allocated; what exceeds it is dropped and counted."""

    payload_min: int = 128  # smallest MTU: a frame's head has to fit
    payload: int = 4096  # bytes of one packet's payload, the largest MTU
    packet_encoded: int = 4096 + 28  # bytes between two 0x00: 11 of header and CRC, 17 of COBS in the worst case
    message: int = 9 << 20  # bytes of one frame's stripes: the largest frame, incompressible, has 8 MiB and a little
    frame_side: int = 2048  # pixels, width and height
    stripes: int = 1024  # of one frame
    stripe: int = 65535  # bytes of one compressed stripe
    stripe_pixels: int = 32_000  # so that even an incompressible stripe stays within `stripe` bytes
    frames_in_assembly: int = 3
    frames_unacknowledged: int = 3
    requests_outstanding: int = 32  # of a host; an id that lies further behind is stale
    replies_kept: int = 128  # by a device, to answer a repeated request without running it again
    table: int = 1024  # bytes of a frame's own coding tables
    picture: int = 8 << 20  # bytes of one compressed picture
    picture_side: int = 8192  # pixels, of a raw frame; what is rectified has `frame_side`
    picture_samples: int = 32 << 20  # bytes of one picture, decoded
    object: int = 64 << 20  # bytes of one bulk object
    calibration: int = 256 << 10  # bytes of the calibration object


LIMITS = Limits()
