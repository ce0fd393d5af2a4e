"""The test vectors of device/PROTOCOL.md: what they mean, both ways; and its packets."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.framing import Deframer, Packet, encode
from prismstereo_device.objects import WriteStatus
from prismstereo_device.protocol import (
    Capability,
    Command,
    CommandReply,
    CommandStatus,
    DisparityHead,
    FrameAck,
    Health,
    HealthFlag,
    Hello,
    HelloKind,
    HelloReply,
    PictureEncoding,
    PictureHead,
    PictureKind,
    Ping,
    Pong,
    ReadReply,
    ReadRequest,
    ReadStatus,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    ZonesMessage,
)
from prismstereo_device.wire import FIRST, LAST, Channel
from prismstereo_device.zones import ZoneDistances

PAGE = (Path(__file__).parents[2] / "device" / "PROTOCOL.md").read_text()
VECTORS = {
    name: bytes.fromhex(data) for name, data in re.findall(r"^\| ([a-z ]+) \| `([0-9a-f]+)` \|$", PAGE, re.MULTILINE)
}
SHA256 = bytes(range(32))

MEANING = {
    "hello": Hello(0x12345678, 1, 1, capabilities=Capability.COMPACT),
    "hello refused": Hello(0x12345678, 1, 1, HelloKind.REFUSE),
    "hello reply": HelloReply(1, 0x12345678, 512, b"serial-1", 99, b"calibrat", Capability(7)),
    "ping": Ping(1_000_000),
    "pong": Pong(1_000_000, 2_000_000, 2_000_050),
    "frame acknowledgement": FrameAck(70_000, 3, 12),
    "command": Command("set", "exposure_us", 8000),
    "command reply": CommandReply(CommandStatus.OK, 8000),
    "command refused": CommandReply(CommandStatus.REFUSED, why="gain 99: at most 16"),
    "health": Health(
        frames_captured=1000,
        frames_sent=990,
        frames_dropped=10,
        packets_good=500,
        packets_bad=2,
        packets_oversize=1,
        uptime_us=60_000_000,
        temperature_c=41.5,
        flags=HealthFlag.END_OF_STREAM,
        bound=2,
        half_resolution=True,
        pictures_dropped=3,
        line_bytes_per_s=80_000,
        last_error="no lens",
    ),
    "read request": ReadRequest(1, 0, 200, 4096),
    "read reply": ReadReply(ReadStatus.OK, 1, 7, 203, 200, b"end"),
    "write begin": WriteBegin(1, 3, SHA256),
    "write part": WritePart(1, SHA256[:4], 0, b"abc"),
    "write commit": WriteCommit(1, 3, SHA256),
    "write reply": WriteReply(WriteStatus.REFUSED, 1, 3, "not a calibration"),
    "frame head": DisparityHead(
        frame=5,
        timestamp_us=123_456_789,
        width=640,
        height=720,
        codec=2,
        stripe_rows=16,
        stripes=45,
        calibration_hash=b"hash",
        window=DisparityWindow(128, -1.0, 12345.0),
        lens_position=200,
        filter_set=3,
        near=2,
        table_apart=350,
    ),
    "picture head": PictureHead(
        kind=PictureKind.RAW,
        encoding=PictureEncoding.PNG,
        frame=5,
        timestamp_us=123_456_789,
        width=640,
        height=360,
        channels=3,
        crop=(8, 4, 640, 360),
        step=1,
        size=70_000,
        lens_position=200,
    ),
}


@pytest.mark.parametrize("name", MEANING)
def test_a_vector_of_the_page_means_what_it_says_and_is_written_so(name: str) -> None:
    message = MEANING[name]
    assert message.pack() == VECTORS[name]
    assert type(message).unpack(VECTORS[name]) == message


def test_the_zones_of_the_page_are_read_and_written_so() -> None:
    nearest_mm = np.array([[0, 450], [65535, 1200]], np.uint16)
    zones = ZoneDistances(5, 123_456_789, nearest_mm, floor_removed=True)
    assert ZonesMessage(zones).pack() == VECTORS["zones"]
    np.testing.assert_array_equal(ZonesMessage.unpack(VECTORS["zones"]).zones.nearest_mm, nearest_mm)


def test_every_vector_of_the_page_is_tried() -> None:
    assert set(VECTORS) == {*MEANING, "zones"}


@pytest.mark.parametrize(
    ("packet", "session"),
    [
        (Packet(Channel.HELLO, VECTORS["hello"], FIRST | LAST), 0),
        (Packet(Channel.CTRL, VECTORS["ping"], FIRST | LAST, seq=7, msg=9), 0x12345678),
    ],
)
def test_the_packets_of_the_page_are_read_and_written_so(packet: Packet, session: int) -> None:
    data = encode(packet, session)
    assert f"`{data.hex()}`" in PAGE
    assert Deframer(session).feed(data) == [packet]
