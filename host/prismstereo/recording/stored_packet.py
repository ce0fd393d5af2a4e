"""A packet of the device as a recording keeps it: what it was, when it came, in which session, and its own check sum."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import google_crc32c

from prismstereo.recording.container import TopicKind
from prismstereo_device.framing import Packet
from prismstereo_device.wire import LIMITS, RESERVED

__all__ = ["PACKETS", "PACKET_TOPIC", "StoredPacket"]

PACKET_TOPIC = "/prismstereo/packets"
_LAYOUT = struct.Struct("<QIBBHHH")
_CRC = struct.Struct("<I")
_CHANNELS = 16
PACKETS = TopicKind(
    encoding="x-prismstereo-packet",
    schema_name="prismstereo.Packet",
    schema_encoding="x-prismstereo-layout",
    schema=json.dumps(
        {
            "version": 1,
            "byte_order": "little endian",
            "about": "a packet of the wire format of device/PROTOCOL.md, out of its frame",
            "fields": [
                {"name": "host_us", "type": "u64", "about": "the host's monotonic clock when it came"},
                {"name": "session", "type": "u32", "about": "which session of the recording's camera, from 1"},
                {"name": "channel", "type": "u8", "about": "0..15"},
                {"name": "flags", "type": "u8", "about": "0x10 first, 0x20 last fragment, 0x40 reply"},
                {"name": "seq", "type": "u16"},
                {"name": "msg", "type": "u16"},
                {"name": "frag", "type": "u16"},
                {"name": "payload", "type": "bytes", "about": "all but the last 4"},
                {"name": "crc", "type": "u32", "about": "CRC-32C of everything before it"},
            ],
        }
    ).encode(),
)


@dataclass(frozen=True, slots=True)
class StoredPacket:
    """A good packet, the host's monotonic clock in microseconds when it came, and its session (from 1)."""

    packet: Packet
    host_us: int
    session: int

    def pack(self) -> bytes:
        """Give the message's bytes."""
        packet = self.packet
        head = (packet.channel, packet.flags, packet.seq, packet.msg, packet.frag)
        body = _LAYOUT.pack(self.host_us, self.session & 0xFFFF_FFFF, *head) + packet.payload
        return body + _CRC.pack(google_crc32c.value(body))

    @classmethod
    def unpack(cls, data: bytes) -> StoredPacket | None:
        """Read a message; None where its check sum says that it is not what was written."""
        if not _LAYOUT.size + _CRC.size <= len(data) <= _LAYOUT.size + LIMITS.payload + _CRC.size:
            return None
        body = data[: -_CRC.size]
        if _CRC.pack(google_crc32c.value(body)) != data[-_CRC.size :]:
            return None
        host_us, session, channel, flags, seq, msg, frag = _LAYOUT.unpack_from(body)
        if channel >= _CHANNELS or flags & (RESERVED | 0x0F):
            return None
        return cls(Packet(channel, body[_LAYOUT.size :], flags, seq, msg, frag), host_us, session)
