"""The messages of the wire format, both directions: frozen types that pack themselves to bytes and unpack from any."""

from __future__ import annotations

from prismstereo_device.protocol.bulk import CALIBRATION, ReadReply, ReadRequest, ReadStatus, answer_read
from prismstereo_device.protocol.control import FrameAck, Ping, Pong, read_control
from prismstereo_device.protocol.frame_head import DisparityHead
from prismstereo_device.protocol.frames import AssemblyStatistics, FrameAssembler, ReceivedFrame, fragment
from prismstereo_device.protocol.health import Health, HealthFlag
from prismstereo_device.protocol.hello import Hello, HelloKind, HelloReply, calibration_hash, read_hello

__all__ = [
    "CALIBRATION",
    "AssemblyStatistics",
    "DisparityHead",
    "FrameAck",
    "FrameAssembler",
    "Health",
    "HealthFlag",
    "Hello",
    "HelloKind",
    "HelloReply",
    "Ping",
    "Pong",
    "ReadReply",
    "ReadRequest",
    "ReadStatus",
    "ReceivedFrame",
    "answer_read",
    "calibration_hash",
    "fragment",
    "read_control",
    "read_hello",
]
