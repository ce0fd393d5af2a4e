"""Objects in parts: read from any offset, begun, sent and committed; every answer fits the smallest packet."""

from __future__ import annotations

import hashlib
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prismstereo_device.objects import ObjectNumber, WriteStatus
from prismstereo_device.protocol import (
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
from prismstereo_device.wire import LIMITS, WireError

U8, U32 = st.integers(0, 0xFF), st.integers(0, 0xFFFF_FFFF)
SHA256 = hashlib.sha256(b"content").digest()


@settings(deadline=None, max_examples=50)
@given(st.sampled_from(ReadStatus), U8, U32, st.integers(0, 1000), st.binary(max_size=50))
def test_a_part_of_an_object_comes_back(status: ReadStatus, obj: int, version: int, offset: int, data: bytes) -> None:
    reply = ReadReply(status, obj, version, offset + len(data), offset, data)
    assert read_bulk_reply(reply.pack()) == reply


@settings(deadline=None, max_examples=50)
@given(U8, st.binary(min_size=4, max_size=4), st.integers(0, 1 << 20), st.binary(min_size=1, max_size=50))
def test_a_part_to_write_comes_back(obj: int, name: bytes, offset: int, data: bytes) -> None:
    part = WritePart(obj, name, offset, data)
    assert read_bulk_request(part.pack()) == part


@settings(deadline=None, max_examples=50)
@given(st.sampled_from(WriteStatus), U8, U32, st.text(max_size=25), st.binary(max_size=9))
def test_an_answer_to_a_write_comes_back(status: WriteStatus, obj: int, held: int, why: str, later: bytes) -> None:
    reply = WriteReply(status, obj, held, why)
    assert read_bulk_reply(reply.pack() + later) == reply


@pytest.mark.parametrize(
    "request_",
    [ReadRequest(1, 2, 3, 4), WriteBegin(1, 20, SHA256), WritePart(1, b"abcd", 2, b"x"), WriteCommit(1, 20, SHA256)],
)
def test_a_request_is_told_by_its_kind(request_) -> None:
    assert read_bulk_request(request_.pack()) == request_
    assert type(read_bulk_request(request_.pack())) is type(request_)


def test_the_bodies_are_laid_out_as_the_wire_format_says() -> None:
    assert ReadRequest(1, 2, 3, 4).pack() == struct.pack("<BBIII", 1, 1, 2, 3, 4)
    assert WriteBegin(4, 70_000, SHA256).pack() == struct.pack("<BBI", 2, 4, 70_000) + SHA256
    assert WritePart(4, SHA256[:4], 9, b"data").pack() == b"\3\4" + SHA256[:4] + struct.pack("<I", 9) + b"data"
    assert WriteCommit(4, 70_000, SHA256).pack() == struct.pack("<BBI", 4, 4, 70_000) + SHA256
    assert WriteReply(WriteStatus.GAP, 4, 9, "why").pack() == struct.pack("<BBBIB", 2, 3, 4, 9, 3) + b"why"


@pytest.mark.parametrize("body", [b"", b"\0" * 40, b"\5" * 40, b"\xff" * 40])
def test_a_kind_that_is_not_known_is_refused_by_name(body: bytes) -> None:
    with pytest.raises(WireError, match="a bulk request of kind"):
        read_bulk_request(body)


@pytest.mark.parametrize("part", [WritePart(1, b"abcd", 2, b""), WritePart(1, b"abcd", LIMITS.object, b"x")])
def test_a_part_of_nothing_or_beyond_the_largest_object_is_refused(part: WritePart) -> None:
    with pytest.raises(WireError, match="a part has some, and lies within"):
        read_bulk_request(part.pack())


def test_an_answer_of_the_future_or_a_cut_one_is_refused() -> None:
    with pytest.raises(WireError, match="status 8"):
        read_bulk_reply(struct.pack("<BBBIB", 2, 8, 4, 9, 0))
    with pytest.raises(WireError, match="of which 2 are there"):
        read_bulk_reply(WriteReply(WriteStatus.GAP, 4, 9, "why").pack()[:-1])


def test_a_long_reason_is_cut_to_what_the_smallest_packet_holds() -> None:
    body = WriteReply(WriteStatus.REFUSED, 4, 9, "ß" * 200).pack()
    assert len(body) <= LIMITS.payload_min
    assert WriteReply.unpack(body).why == "ß" * 50


def test_the_room_of_a_part_fills_its_packet() -> None:
    assert len(WritePart(1, b"abcd", 2, bytes(WritePart.room(240))).pack()) == 240


def test_an_object_is_read_in_parts() -> None:
    content = bytes(range(250)) * 4
    parts, version = b"", 0
    while len(parts) < len(content):
        reply = answer_read(ReadRequest(ObjectNumber.CALIBRATION, version, len(parts), 4096), content, 42, 240)
        assert reply.status is ReadStatus.OK
        assert len(reply.pack()) <= 240
        parts, version = parts + reply.data, reply.version
    assert parts == content
    assert version == 42


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (ReadRequest(1, 41, 0, 10), ReadStatus.CHANGED),
        (ReadRequest(1, 42, 11, 10), ReadStatus.BEYOND_END),
        (ReadRequest(1, 42, 10, 10), ReadStatus.OK),
    ],
)
def test_a_read_that_cannot_be_answered_says_why(request_: ReadRequest, status: ReadStatus) -> None:
    reply = answer_read(request_, b"0123456789", 42, 240)
    assert (reply.status, reply.data, reply.total) == (status, b"", 10)


def test_an_object_that_is_not_there_says_so() -> None:
    assert answer_read(ReadRequest(77, 0, 0, 10), None, 0, 240).status is ReadStatus.NO_SUCH_OBJECT


def test_a_part_beyond_its_object_is_refused() -> None:
    with pytest.raises(WireError, match="lies within its object"):
        ReadReply.unpack(ReadReply(ReadStatus.OK, 1, 0, 3, 2, b"ab").pack())
