"""The messages of the wire format, both directions: frozen types that pack themselves to bytes and unpack from any.

device/PROTOCOL.md is the format as one page.
"""

from __future__ import annotations

from prismstereo_device.protocol.answered import AnsweredRequests, Verdict
from prismstereo_device.protocol.assembler import AssemblyStatistics, FrameAssembler
from prismstereo_device.protocol.bulk import (
    BulkRequest,
    ReadReply,
    ReadRequest,
    ReadStatus,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    answer_read,
    read_bulk_reply,
    read_bulk_request,
)
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus, Value, Verb
from prismstereo_device.protocol.control import FrameAck, Ping, Pong, read_control
from prismstereo_device.protocol.frame_head import DisparityHead
from prismstereo_device.protocol.frames import fragment
from prismstereo_device.protocol.health import Health, HealthFlag
from prismstereo_device.protocol.hello import Capability, Hello, HelloKind, HelloReply, calibration_hash, read_hello
from prismstereo_device.protocol.open_frame import ReceivedFrame
from prismstereo_device.protocol.picture import (
    PictureAssembler,
    PictureStatistics,
    ReceivedPicture,
    picture_fragments,
)
from prismstereo_device.protocol.picture_head import PictureEncoding, PictureHead, PictureKind
from prismstereo_device.protocol.zones import ZonesMessage

__all__ = [
    "AnsweredRequests",
    "AssemblyStatistics",
    "BulkRequest",
    "Capability",
    "Command",
    "CommandReply",
    "CommandStatus",
    "DisparityHead",
    "FrameAck",
    "FrameAssembler",
    "Health",
    "HealthFlag",
    "Hello",
    "HelloKind",
    "HelloReply",
    "PictureAssembler",
    "PictureEncoding",
    "PictureHead",
    "PictureKind",
    "PictureStatistics",
    "Ping",
    "Pong",
    "ReadReply",
    "ReadRequest",
    "ReadStatus",
    "ReceivedFrame",
    "ReceivedPicture",
    "Value",
    "Verb",
    "Verdict",
    "WriteBegin",
    "WriteCommit",
    "WritePart",
    "WriteReply",
    "ZonesMessage",
    "answer_read",
    "calibration_hash",
    "fragment",
    "picture_fragments",
    "read_bulk_reply",
    "read_bulk_request",
    "read_control",
    "read_hello",
]
