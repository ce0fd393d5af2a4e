"""Packets on the line: stuffing, check sum, and finding the packets again in any stream of bytes.

An encoded packet holds no 0x00, so a 0x00 on a clean line is always a true boundary: after any damage the first 0x00
that follows restores the reader, which holds no more than one packet of memory meanwhile.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

import google_crc32c
import numpy as np

from prismstereo_device import kernels
from prismstereo_device.wire import FIRST, LAST, LIMITS, RESERVED, Channel, WireError

__all__ = ["Deframer", "Framer", "LineStatistics", "Packet", "encode"]

_HEADER = struct.Struct("<BHHH")
_CRC = struct.Struct("<I")
_SESSION = struct.Struct("<I")
_LEAST = _HEADER.size + _CRC.size
_PIECE = re.compile(rb"[^\0]+")
_CHANNEL_BITS = 0x0F


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet: `channel` 0..15, `flags` of FIRST | LAST | REPLY, three 16-bit numbers and up to 4096 bytes."""

    channel: int
    payload: bytes
    flags: int = FIRST | LAST
    seq: int = 0
    msg: int = 0
    frag: int = 0


@dataclass(frozen=True, slots=True)
class LineStatistics:
    """What a reader has seen: packets that were `good`, `bad` (damaged or of another session), too long; all bytes."""

    good: int = 0
    bad: int = 0
    oversize: int = 0
    received_bytes: int = 0


def encode(packet: Packet, session: int) -> bytes:
    """Turn a packet into its bytes on the line, 0x00 at the end included.

    The hello channel is outside every session, whatever `session` says. Raises WireError if the payload is too long.
    """
    if len(packet.payload) > LIMITS.payload:
        raise WireError(f"a payload of {len(packet.payload)} bytes: a packet carries at most {LIMITS.payload}")
    header = _HEADER.pack(packet.channel | packet.flags, packet.seq, packet.msg, packet.frag)
    body = header + packet.payload
    body += _CRC.pack(google_crc32c.value(body + _salt(packet.channel, session)))
    out = np.empty(len(body) + len(body) // 254 + 2, np.uint8)
    length = kernels.cobs_encode(np.frombuffer(body, np.uint8), out)
    out[length] = 0
    return out[: length + 1].tobytes()


def _salt(channel: int, session: int) -> bytes:
    return _SESSION.pack(0 if channel == Channel.HELLO else session)


class Framer:
    """Numbers the packets of one session, per channel, and encodes them; for one thread at a time."""

    def __init__(self, session: int) -> None:
        self._session = session
        self._seq = [0] * 16

    def encode(self, channel: int, payload: bytes, *, flags: int = FIRST | LAST, msg: int = 0, frag: int = 0) -> bytes:
        """Make the next packet of the channel; `msg` and `frag` count modulo 65536. Raises WireError as `encode`."""
        seq = self._seq[channel]
        self._seq[channel] = (seq + 1) & 0xFFFF
        return encode(Packet(channel, payload, flags, seq, msg & 0xFFFF, frag & 0xFFFF), self._session)


class Deframer:
    """Finds the packets of one session in a stream of bytes; never raises, whatever the bytes are.

    Session 0 stands for *none yet*: only the hello channel is heard. Memory stays within one packet.
    """

    def __init__(self, session: int = 0) -> None:
        self._session = session
        self._pending = bytearray()
        self._skipping = False
        self._good = self._bad = self._oversize = self._received = 0
        self._scratch = np.empty(LIMITS.packet_encoded, np.uint8)

    def adopt(self, session: int) -> None:
        """Hear this session from the next packet on; the counters go on."""
        self._session = session

    @property
    def statistics(self) -> LineStatistics:
        """The counters so far."""
        return LineStatistics(self._good, self._bad, self._oversize, self._received)

    def feed(self, data: bytes) -> list[Packet]:
        """Take the next bytes of the stream, as many as there are, and return the packets that they complete."""
        found: list[Packet] = []
        self._received += len(data)
        boundary = data.find(0)
        if boundary < 0:
            self._keep(data, 0, len(data))
            return found
        self._keep(data, 0, boundary)
        self._close(found)
        for piece in _PIECE.finditer(data, boundary + 1):  # runs of 0x00 are skipped inside the regular expression
            begin, end = piece.span()
            self._keep(data, begin, end)
            if end < len(data):
                self._close(found)
        return found

    def _keep(self, data: bytes, begin: int, end: int) -> None:
        if self._skipping:
            return
        if len(self._pending) + end - begin > LIMITS.packet_encoded:
            self._pending.clear()
            self._skipping = True
            self._oversize += 1
            return
        self._pending += memoryview(data)[begin:end]

    def _close(self, found: list[Packet]) -> None:
        if self._skipping:
            self._skipping = False
            return
        if not self._pending:
            return
        packet = self._decode()
        self._pending.clear()
        if packet is None:
            self._bad += 1
        else:
            self._good += 1
            found.append(packet)

    def _decode(self) -> Packet | None:
        length = kernels.cobs_decode(np.frombuffer(bytes(self._pending), np.uint8), self._scratch)
        if length < _LEAST:
            return None
        body = self._scratch[:length].tobytes()
        first, seq, msg, frag = _HEADER.unpack_from(body)
        channel = first & _CHANNEL_BITS
        if first & RESERVED or (channel != Channel.HELLO and self._session == 0):
            return None
        covered, crc = body[: -_CRC.size], _CRC.unpack_from(body, length - _CRC.size)[0]
        if google_crc32c.value(covered + _salt(channel, self._session)) != crc:
            return None
        payload = covered[_HEADER.size :]
        if len(payload) > LIMITS.payload:
            return None
        return Packet(channel, payload, first & ~_CHANNEL_BITS, seq, msg, frag)
