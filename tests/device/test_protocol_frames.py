"""A frame over the wire: exact or within its bound, over any MTU; what is lost is missing, and never wrong."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.wire_scenes import matched, packets_of, received, scene
from prismstereo_device import codec
from prismstereo_device.codec.compact import BOUNDS, Tables, decode_stripe, encode_stripes
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import DisparityHead, FrameAssembler, fragment
from prismstereo_device.protocol.fragments import TABLES, Piece, cut, read_fragment
from prismstereo_device.wire import FIRST, LAST, Channel, WireError
from prismstereo_hw.errors import UsageError

CODINGS = [None, *BOUNDS]


def test_a_frame_head_is_laid_out_as_the_wire_format_says() -> None:
    head = packets_of(scene(), frame=6)[0].payload
    fields = struct.unpack("<IQHHBBBBH4s", head[:26])
    assert fields == (6, 777, 90, 100, 1, 4, 0, 16, 7, b"1234")
    assert struct.unpack("<HffiHH", head[26:]) == (128, -1.0, 12345.0, 120, 3, 0)


def test_the_head_of_a_compact_frame_names_codec_bound_and_tables() -> None:
    sent = scene()
    own = encode_stripes(sent.fixed_point(), 2).tables
    head = packets_of(sent, bound=2)[0].payload
    assert struct.unpack("<BBB", head[16:19]) == (2, 4, 2)
    assert struct.unpack("<H", head[42:44]) == (len(own),)
    assert head[44:] == own


def test_stripes_that_fit_are_laid_out_as_the_wire_format_says() -> None:
    disparity = scene()
    stripes = codec.encode(disparity.fixed_point())
    payload = packets_of(disparity, frame=6)[1].payload
    first = struct.pack("<HH", len(stripes[0]), 0) + stripes[0]
    assert payload.startswith(struct.pack("<IH", 6, 0) + first + struct.pack("<HH", len(stripes[1]), 0))


@pytest.mark.parametrize("bound", CODINGS)
@pytest.mark.parametrize("mtu", [128, 240, 512, 1024, 4096])
def test_a_map_comes_back_over_any_mtu_exact_or_within_its_bound(mtu: int, bound: int | None) -> None:
    sent = scene()
    packets = packets_of(sent, mtu=mtu, bound=bound)
    assert max(len(packet.payload) for packet in packets) <= mtu
    assert [packet.frag for packet in packets] == list(range(len(packets)))
    assert [bool(packet.flags & FIRST) for packet in packets].count(True) == 1
    assert [bool(packet.flags & LAST) for packet in packets].index(True) == len(packets) - 1
    (frame,) = received(FrameAssembler(), packets)
    np.testing.assert_array_equal(frame.disparity.valid, sent.valid)
    off = np.nanmax(np.abs(frame.disparity.disparity_px - sent.disparity_px))
    assert off * 16 <= (bound or 0)
    assert frame.disparity.window == sent.window
    assert (frame.index, frame.timestamp_us, frame.lens_position, frame.filter_set) == (5, 777, 120, 3)
    assert (frame.calibration_hash, frame.partial, frame.missing_stripes) == (b"1234", False, 0)
    assert frame.bound == (bound or 0)
    assert not frame.lost_rows.any()


def test_another_bound_is_not_sent() -> None:
    with pytest.raises(UsageError, match="a bound of 3"):
        packets_of(scene(), bound=3)


def test_tables_that_do_not_fit_beside_the_head_go_in_pieces_before_the_first_stripe() -> None:
    sent = scene()
    own = encode_stripes(sent.fixed_point(), 0).tables
    packets = packets_of(sent, mtu=128, bound=0)
    head = DisparityHead.unpack(packets[0].payload)
    assert (head.table, head.table_apart) == (b"", len(own))
    assert head.table_apart > 84
    pieces = [piece for packet in packets[1:] for piece in read_fragment(packet.payload)]
    numbers = [piece.stripe for piece in pieces]
    count = numbers.count(TABLES)
    assert numbers[:count] == [TABLES] * count
    assert b"".join(piece.data for piece in pieces[:count]) == own
    (frame,) = received(FrameAssembler(), packets)
    np.testing.assert_array_equal(frame.disparity.disparity_px, sent.disparity_px)


def test_tables_that_would_save_little_are_left_out_where_they_need_packets_of_their_own() -> None:
    sent = matched()
    beside, apart = (DisparityHead.unpack(packets_of(sent, mtu=mtu, bound=0)[0].payload) for mtu in (4096, 128))
    assert len(beside.table) > 84
    assert (apart.table, apart.table_apart) == (b"", 0)


@pytest.mark.parametrize(("mtu", "own"), [(128, False), (4096, True)])
def test_on_a_lossy_line_all_that_the_stripes_need_is_in_the_head(mtu: int, own: bool) -> None:
    parts = fragment(scene(), frame=1, timestamp_us=2, calibration_hash=b"1234", mtu=mtu, bound=0, lossy=True)
    head = DisparityHead.unpack(next(parts)[2])
    assert (bool(head.table), head.table_apart) == (own, 0)


def test_a_frame_that_lost_its_tables_is_all_unmatched_and_counted() -> None:
    sent = scene()
    packets = packets_of(sent, mtu=128, bound=0)
    assembler = FrameAssembler()
    (frame,) = received(assembler, packets[:1] + packets[2:])
    assert frame.partial
    assert frame.missing_stripes == 7
    assert np.isnan(frame.disparity.disparity_px).all()
    assert frame.lost_rows.all()
    assert assembler.statistics.without_tables + assembler.statistics.stray > 0


@pytest.mark.parametrize("bound", CODINGS)
def test_a_head_that_is_sent_twice_counts_once_wherever_the_second_one_comes(bound: int | None) -> None:
    sent = scene(60, 90)
    packets = packets_of(sent, mtu=128, bound=bound)
    for place in range(1, len(packets) + 1):
        assembler = FrameAssembler()
        (frame,) = received(assembler, [*packets[:place], packets[0], *packets[place:]])
        assert not frame.partial
        assert assembler.flush() == []


def test_tables_that_are_sent_twice_are_read_once() -> None:
    sent = scene()
    packets = packets_of(sent, mtu=128, bound=0)
    count = sum(piece.stripe == TABLES for packet in packets[1:] for piece in read_fragment(packet.payload))
    for again in (packets[: 1 + count], packets[1 : 1 + count]):
        assembler = FrameAssembler()
        (frame,) = received(assembler, packets[: 1 + count] + again + packets[1 + count :])
        assert not frame.partial
        assert assembler.statistics.malformed == 0


def test_tables_of_another_length_than_announced_or_of_nonsense_are_refused() -> None:
    sent = scene()
    packets = packets_of(sent, mtu=128, bound=0)
    for nonsense in (b"\xff" * 20, b"\xff" * DisparityHead.unpack(packets[0].payload).table_apart):
        assembler = FrameAssembler()
        tables = [Packet(Channel.DISP, payload, 0) for payload in cut(5, [nonsense], 128, first=TABLES)]
        received(assembler, packets[:1] + tables)
        assert assembler.statistics.malformed == 1
        assert [frame.missing_stripes for frame in assembler.flush()] == [7]


@settings(deadline=None, max_examples=30)
@given(st.lists(st.binary(max_size=700), min_size=1, max_size=12), st.integers(128, 800))
def test_stripes_of_any_length_are_cut_and_read_back(stripes: list[bytes], mtu: int) -> None:
    pieces = [piece for payload in cut(3, stripes, mtu) for piece in read_fragment(payload)]
    joined = [b"".join(piece.data for piece in pieces if piece.stripe == number) for number in range(len(stripes))]
    assert joined == stripes
    assert all(piece.frame == 3 and piece.total == len(stripes[piece.stripe]) for piece in pieces)


@pytest.mark.parametrize("bound", [None, 0, 4])
@pytest.mark.parametrize("mtu", [240, 1024])
def test_a_lost_packet_costs_its_stripes_and_nothing_else(mtu: int, bound: int | None) -> None:
    packets = packets_of(scene(), mtu=mtu, bound=bound)
    (whole,) = received(FrameAssembler(), packets)
    for lost in range(1, len(packets)):
        touched = {piece.stripe for piece in read_fragment(packets[lost].payload)}
        touched = set(range(7)) if TABLES in touched else touched
        assembler = FrameAssembler()
        (frame,) = [*received(assembler, packets[:lost] + packets[lost + 1 :]), *assembler.flush()]
        assert frame.partial
        assert frame.missing_stripes == len(touched)
        missing = np.isin(np.arange(100) // 16, list(touched))
        np.testing.assert_array_equal(frame.lost_rows, missing)
        assert np.isnan(frame.disparity.disparity_px[missing]).all()
        np.testing.assert_array_equal(frame.disparity.disparity_px[~missing], whole.disparity.disparity_px[~missing])


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
    assembler = FrameAssembler()
    assert [frame.partial for frame in received(assembler, packets[:-1] + packets + packets)] == [False]
    assert assembler.flush() == []


@pytest.mark.parametrize("bound", [None, 2])
def test_a_stripe_that_is_damaged_behind_the_check_sum_is_missing(bound: int | None) -> None:
    packets = packets_of(scene(), mtu=512, bound=bound)
    broken = bytearray(packets[2].payload)
    broken[-1] ^= 1
    packets[2] = Packet(Channel.DISP, bytes(broken), packets[2].flags)
    assembler = FrameAssembler()
    (frame,) = received(assembler, packets)
    assert frame.missing_stripes == 1
    assert assembler.statistics.malformed == 1


def test_a_stripe_or_an_mtu_beyond_the_limits_cannot_be_sent() -> None:
    with pytest.raises(WireError, match="65536 bytes"):
        list(cut(1, [bytes(65536)], 512))
    with pytest.raises(WireError, match="MTU of 64"):
        list(cut(1, [b""], 64))


def test_a_whole_stripe_is_told_from_a_piece() -> None:
    assert Piece(1, 0, 3, 0, b"abc").whole
    assert not Piece(1, 0, 4, 0, b"abc").whole


@pytest.mark.parametrize("bound", BOUNDS)
def test_the_roughest_map_of_any_size_can_be_sent_with_tables_within_the_limits(bound: int) -> None:
    random = np.random.default_rng(8)
    steps = (
        (900 + random.normal(0, 40, (300, 2048)) * np.repeat([1, 9, 0.1], 100)[:, None]).clip(0, 4000).astype(np.uint16)
    )
    sent = DisparityMap.from_fixed_point(steps, scene().window)
    head, *rest = (
        payload
        for _, _, payload in fragment(sent, frame=1, timestamp_us=2, calibration_hash=b"1234", mtu=4096, bound=bound)
    )
    table = DisparityHead.unpack(head).table
    assert len(table) <= 1024
    (first, *_) = read_fragment(rest[0])
    if first.whole:
        assert decode_stripe(first.data, 15, 2048, bound, Tables.read(table, bound)).shape == (15, 2048)
