from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prismstereo_calibration import flash
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device import codec
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import (
    CALIBRATION,
    DisparityHead,
    FrameAck,
    FrameAssembler,
    Health,
    HealthFlag,
    Hello,
    HelloKind,
    HelloReply,
    Ping,
    Pong,
    ReadReply,
    ReadRequest,
    ReadStatus,
    ReceivedFrame,
    answer_read,
    calibration_hash,
    fragment,
    read_control,
    read_hello,
)
from prismstereo_device.protocol.fragments import Piece, cut, read_fragment
from prismstereo_device.wire import FIRST, LAST, LIMITS, Channel, WireError

U8, U16, U32 = st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF_FFFF)
U64 = st.integers(0, 2**64 - 1)
NONCE = st.integers(1, 0xFFFF_FFFF)
EIGHT = st.binary(min_size=8, max_size=8)
FLOAT = st.floats(-1e6, 1e6, width=32)

MESSAGES = {
    "Hello": st.tuples(NONCE, U8, U8, st.sampled_from([HelloKind.OFFER, HelloKind.REFUSE])).map(
        lambda fields: Hello(fields[0], min(fields[1:3]), max(fields[1:3]), fields[3])
    ),
    "HelloReply": st.builds(HelloReply, U8, NONCE, st.integers(128, 4096), EIGHT, U32, EIGHT, U32),
    "Ping": st.builds(Ping, U64),
    "Pong": st.builds(Pong, U64, U64, U64),
    "FrameAck": st.builds(FrameAck, U32, U8),
    "Health": st.builds(
        Health,
        *[U32] * 6,
        U64,
        st.none() | st.integers(-500, 1500).map(lambda tenths: tenths / 10),
        st.sampled_from([HealthFlag.NONE, HealthFlag.END_OF_STREAM, HealthFlag(3)]),
    ),
    "ReadRequest": st.builds(ReadRequest, U8, U32, U32, U32),
    "DisparityHead": st.builds(
        DisparityHead,
        frame=U32,
        timestamp_us=U64,
        width=st.integers(1, 2000),
        height=st.just(100),
        codec=U8,
        stripe_rows=st.just(16),
        stripes=st.just(7),
        calibration_hash=st.binary(min_size=4, max_size=4),
        window=st.builds(DisparityWindow, U16, FLOAT, FLOAT.map(abs)),
        lens_position=st.none() | st.integers(0, 2**31 - 1),
        filter_set=U16,
        near=U8,
        table=st.just(b""),
    ),
}


def scene(height: int = 100, width: int = 90, seed: int = 0) -> DisparityMap:
    random = np.random.default_rng(seed)
    steps = (random.integers(0, 40, (height, width)).cumsum(1) * (random.random((height, width)) < 0.9)).astype(
        np.uint16
    )
    return DisparityMap.from_fixed_point(steps, DisparityWindow(128, -1.0, 12345.0))


def packets_of(disparity: DisparityMap, frame: int = 5, mtu: int = 4096) -> list[Packet]:
    parts = fragment(disparity, frame=frame, timestamp_us=777, calibration_hash=b"12345678", mtu=mtu, lens_position=120)
    return [Packet(Channel.DISP, payload, flags, 0, frame & 0xFFFF, index) for flags, index, payload in parts]


def received(assembler: FrameAssembler, packets: list[Packet]) -> list[ReceivedFrame]:
    return [frame for packet in packets for frame in assembler.feed(packet)]


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_comes_back_and_what_a_later_version_adds_is_ignored(name: str) -> None:
    @settings(deadline=None, max_examples=60)
    @given(MESSAGES[name], st.binary(max_size=9))
    def law(message, extra: bytes) -> None:
        assert type(message).unpack(message.pack()) == message
        assert type(message).unpack(message.pack() + extra) == message

    law()


@settings(deadline=None)
@given(st.sampled_from(ReadStatus), U8, U32, st.integers(0, 1000), st.binary(max_size=50))
def test_a_part_of_an_object_comes_back(status: ReadStatus, obj: int, version: int, offset: int, data: bytes) -> None:
    reply = ReadReply(status, obj, version, offset + len(data), offset, data)
    assert ReadReply.unpack(reply.pack()) == reply


READERS: dict[str, Callable[[bytes], object]] = {
    "read_hello": read_hello,
    "read_control": read_control,
    "read_fragment": read_fragment,
    "Hello": Hello.unpack,
    "HelloReply": HelloReply.unpack,
    "Ping": Ping.unpack,
    "Pong": Pong.unpack,
    "FrameAck": FrameAck.unpack,
    "Health": Health.unpack,
    "ReadRequest": ReadRequest.unpack,
    "ReadReply": ReadReply.unpack,
    "DisparityHead": DisparityHead.unpack,
}


@pytest.mark.parametrize("name", READERS)
def test_arbitrary_bytes_raise_nothing_but_a_wire_error(name: str) -> None:
    @settings(deadline=None, max_examples=100)
    @given(st.binary(max_size=80) | st.tuples(st.sampled_from([1, 2, 3]), st.binary(max_size=60)).map(with_kind))
    def law(body: bytes) -> None:
        with contextlib.suppress(WireError):
            READERS[name](body)

    law()


def with_kind(parts: tuple[int, bytes]) -> bytes:
    return bytes([parts[0]]) + parts[1]


def test_the_bodies_are_laid_out_as_the_wire_format_says() -> None:
    assert Hello(7, 1, 2).pack() == struct.pack("<BBBI", 1, 1, 2, 7)
    reply = HelloReply(1, 7, 512, b"serial-1", 9, b"calibrat", 3)
    assert reply.pack() == struct.pack("<BBIH8sI8sI", 2, 1, 7, 512, b"serial-1", 9, b"calibrat", 3)
    assert Ping(5).pack()[1:] == struct.pack("<Q", 5)
    assert Pong(5, 6, 7).pack()[1:] == struct.pack("<QQQ", 5, 6, 7)
    assert FrameAck(8, 2).pack()[1:] == struct.pack("<IB", 8, 2)


def test_a_frame_head_is_laid_out_as_the_wire_format_says() -> None:
    head = packets_of(scene(), frame=6)[0].payload
    fields = struct.unpack("<IQHHBBBBH4s", head[:26])
    assert fields == (6, 777, 90, 100, 1, 4, 0, 16, 7, b"1234")
    assert struct.unpack("<HffiHH", head[26:]) == (128, -1.0, 12345.0, 120, 0, 0)


def test_stripes_that_fit_are_laid_out_as_the_wire_format_says() -> None:
    disparity = scene()
    stripes = codec.encode(disparity.fixed_point())
    payload = packets_of(disparity, frame=6)[1].payload
    first = struct.pack("<HH", len(stripes[0]), 0) + stripes[0]
    assert payload.startswith(struct.pack("<IH", 6, 0) + first + struct.pack("<HH", len(stripes[1]), 0))


def test_an_acknowledgement_without_room_means_the_usual_room() -> None:
    assert FrameAck.unpack(FrameAck(9, 0).pack()[:5]) == FrameAck(9, 3)


@pytest.mark.parametrize(("offered", "shared"), [((1, 1), 1), ((1, 9), 1), ((0, 1), 1), ((2, 5), None), ((0, 0), None)])
def test_the_newest_shared_version_is_taken(offered: tuple[int, int], shared: int | None) -> None:
    assert Hello(1, *offered).shared_version() == shared


def test_the_calibrations_hash_is_the_one_its_own_folder_gives() -> None:
    assert calibration_hash(b"flash") == flash.digest(b"flash")
    assert calibration_hash(b"") == bytes(8)


@pytest.mark.parametrize("mtu", [128, 240, 512, 1024, 4096])
def test_a_map_comes_back_bit_by_bit_over_any_mtu(mtu: int) -> None:
    sent = scene()
    packets = packets_of(sent, mtu=mtu)
    assert max(len(packet.payload) for packet in packets) <= mtu
    assert [packet.frag for packet in packets] == list(range(len(packets)))
    assert [bool(packet.flags & FIRST) for packet in packets].count(True) == 1
    assert [bool(packet.flags & LAST) for packet in packets].index(True) == len(packets) - 1
    (frame,) = received(FrameAssembler(), packets)
    np.testing.assert_array_equal(frame.disparity.disparity_px, sent.disparity_px)
    assert frame.disparity.window == sent.window
    assert (frame.index, frame.timestamp_us, frame.lens_position) == (5, 777, 120)
    assert (frame.calibration_hash, frame.partial, frame.missing_stripes) == (b"1234", False, 0)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.binary(max_size=700), min_size=1, max_size=12), st.integers(128, 800))
def test_stripes_of_any_length_are_cut_and_read_back(stripes: list[bytes], mtu: int) -> None:
    pieces = [piece for payload in cut(3, stripes, mtu) for piece in read_fragment(payload)]
    joined = [b"".join(piece.data for piece in pieces if piece.stripe == number) for number in range(len(stripes))]
    assert joined == stripes
    assert all(piece.frame == 3 and piece.total == len(stripes[piece.stripe]) for piece in pieces)


@pytest.mark.parametrize("mtu", [240, 1024])
def test_a_lost_packet_costs_its_stripes_and_nothing_else(mtu: int) -> None:
    sent = scene()
    packets = packets_of(sent, mtu=mtu)
    for lost in range(1, len(packets)):
        touched = {piece.stripe for piece in read_fragment(packets[lost].payload)}
        assembler = FrameAssembler()
        (frame,) = [*received(assembler, packets[:lost] + packets[lost + 1 :]), *assembler.flush()]
        assert frame.partial
        assert frame.missing_stripes == len(touched)
        missing = np.isin(np.arange(100) // 16, list(touched))
        assert np.isnan(frame.disparity.disparity_px[missing]).all()
        np.testing.assert_array_equal(frame.disparity.disparity_px[~missing], sent.disparity_px[~missing])


def test_without_its_head_a_frame_is_not_delivered_but_counted() -> None:
    assembler = FrameAssembler()
    packets = packets_of(scene())[1:]
    assert received(assembler, packets) == []
    assert assembler.statistics.stray == len(packets)


def test_a_newer_frame_ends_the_older_one_and_leaves_it_partial() -> None:
    assembler = FrameAssembler()
    assert received(assembler, packets_of(scene(), frame=0xFFFF_FFFF)[:-1]) == []
    assert assembler.newest_started == 0xFFFF_FFFF
    frames = received(assembler, packets_of(scene(), frame=0))  # the number wraps
    assert [(frame.index, frame.partial) for frame in frames] == [(0xFFFF_FFFF, True), (0, False)]
    assert assembler.newest_started == 0


def test_no_more_than_three_frames_are_open() -> None:
    assembler = FrameAssembler()
    heads = [packets_of(scene(), frame=number)[0] for number in (9, 8, 7, 6)]
    assert [frame.index for frame in received(assembler, heads)] == [9]
    assert [frame.index for frame in assembler.flush()] == [8, 7, 6]


def test_a_frame_that_is_sent_twice_is_delivered_once() -> None:
    packets = packets_of(scene())
    frames = received(FrameAssembler(), packets[:-1] + packets)
    assert [frame.partial for frame in frames] == [False]


def test_a_stripe_that_is_damaged_behind_the_check_sum_is_missing() -> None:
    packets = packets_of(scene(), mtu=512)
    broken = bytearray(packets[2].payload)
    broken[-1] ^= 1
    packets[2] = Packet(Channel.DISP, bytes(broken), packets[2].flags)
    assembler = FrameAssembler()
    (frame,) = received(assembler, packets)
    assert frame.missing_stripes == 1
    assert assembler.statistics.malformed == 1


HEAD = DisparityHead(1, 2, 90, 100, 1, 16, 7, b"hash", DisparityWindow(64))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "1 to 2048"),
        ({"width": 2049, "stripe_rows": 1, "stripes": 100}, "1 to 2048"),
        ({"height": 60000}, "1 to 2048"),
        ({"stripe_rows": 0}, "0 rows"),
        ({"width": 2048}, "32000 pixels"),
        ({"stripes": 6}, "6 stripes"),
        ({"stripes": 8}, "8 stripes"),
        ({"height": 2000, "stripe_rows": 1, "stripes": 2000}, "2000 stripes"),
        ({"window": DisparityWindow(64, float("nan"))}, "finite"),
        ({"window": DisparityWindow(64, 0.0, float("inf"))}, "finite"),
        ({"window": DisparityWindow(64, 0.0, -1.0)}, "not negative"),
    ],
)
def test_a_head_beyond_the_limits_is_refused_before_anything_is_allocated(change: dict, message: str) -> None:
    body = replace(HEAD, **change).pack()
    with pytest.raises(WireError, match=message):
        DisparityHead.unpack(body)
    assembler = FrameAssembler()
    assert assembler.feed(Packet(Channel.DISP, body, FIRST)) == []
    assert assembler.statistics.malformed == 1
    assert assembler.flush() == []


def test_a_codec_that_is_not_known_is_counted() -> None:
    assembler = FrameAssembler()
    assert assembler.feed(Packet(Channel.DISP, replace(HEAD, codec=9).pack(), FIRST)) == []
    assert assembler.statistics.malformed == 1


def test_a_table_that_is_cut_is_refused() -> None:
    with pytest.raises(WireError, match="table of 4 bytes and has 3"):
        DisparityHead.unpack(replace(HEAD, table=b"abcd").pack()[:-1])


PREFIX = st.integers(0, 8).map(lambda first: struct.pack("<IH", 1, first))
CUT_PREFIX = st.integers(0, 8).map(lambda first: struct.pack("<IH", 1, first | 0x8000))
STRIPE = st.tuples(U16 | st.integers(0, 20), U16, st.binary(max_size=20)).map(
    lambda parts: struct.pack("<HH", *parts[:2]) + parts[2]
)
HOSTILE = st.tuples(PREFIX | CUT_PREFIX, st.lists(STRIPE, max_size=3)).map(lambda parts: parts[0] + b"".join(parts[1]))


@settings(deadline=None)
@given(st.lists(st.tuples(HOSTILE | st.binary(max_size=60), st.sampled_from([0, FIRST, LAST])), max_size=30))
def test_hostile_fragments_never_break_the_assembler(bodies: list[tuple[bytes, int]]) -> None:
    assembler = FrameAssembler()
    assembler.feed(Packet(Channel.DISP, HEAD.pack(), FIRST))
    for body, flags in bodies:
        assembler.feed(Packet(Channel.DISP, body, flags))
    (frame,) = received(assembler, packets_of(scene(), frame=2))[-1:]
    assert frame.index == 2
    assert not frame.partial


def test_a_frame_that_never_ends_stops_being_read() -> None:
    assembler = FrameAssembler()
    assembler.feed(Packet(Channel.DISP, HEAD.pack(), FIRST))
    payload = struct.pack("<IHHHH", 1, 0x8000, 65535, 0, 0) + bytes(4000)
    repeats = LIMITS.message // 4000 + 10
    for _ in range(repeats):
        assembler.feed(Packet(Channel.DISP, payload, 0))
    assert assembler.statistics.malformed == 10


def test_a_piece_that_is_not_the_next_one_loses_its_stripe() -> None:
    def piece(offset: int) -> Packet:
        return Packet(Channel.DISP, struct.pack("<IHHHH", 1, 0x8002, 90, 0, offset) + bytes(30), 0)

    assembler = FrameAssembler()
    assembler.feed(Packet(Channel.DISP, HEAD.pack(), FIRST))
    for packet in (piece(0), piece(60), piece(30)):
        assembler.feed(packet)
    assert [frame.missing_stripes for frame in assembler.flush()] == [7]


def test_a_stripe_or_an_mtu_beyond_the_limits_cannot_be_sent() -> None:
    with pytest.raises(WireError, match="65536 bytes"):
        list(cut(1, [bytes(65536)], 512))
    with pytest.raises(WireError, match="MTU of 64"):
        list(cut(1, [b""], 64))


def test_an_object_is_read_in_parts() -> None:
    content = bytes(range(250)) * 4
    parts, version = b"", 0
    while len(parts) < len(content):
        reply = answer_read(ReadRequest(CALIBRATION, version, len(parts), 4096), content, 42, 240)
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


def test_a_whole_stripe_is_told_from_a_piece() -> None:
    assert Piece(1, 0, 3, 0, b"abc").whole
    assert not Piece(1, 0, 4, 0, b"abc").whole
