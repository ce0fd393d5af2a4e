"""Frames from a sender that means harm: refused before anything is allocated, counted, and forgotten."""

from __future__ import annotations

import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.wire_scenes import packets_of, received, scene
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import DisparityHead, FrameAssembler
from prismstereo_device.protocol.fragments import TABLES
from prismstereo_device.wire import FIRST, LAST, LIMITS, Channel, WireError

HEAD = DisparityHead(1, 2, 90, 100, 1, 16, 7, b"hash", DisparityWindow(64))
COMPACT = replace(HEAD, codec=2, near=1, table_apart=30)
U16 = st.integers(0, 0xFFFF)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "1 to 2048"),
        ({"width": 2049, "stripe_rows": 1, "stripes": 100}, "1 to 2048"),
        ({"height": 60000}, "1 to 2048"),
        ({"width": 65535, "height": 65535, "stripes": 4096}, "1 to 2048"),  # 8 GB of pixels
        ({"stripe_rows": 0}, "0 rows"),
        ({"width": 2048}, "32000 pixels"),
        ({"stripes": 6}, "6 stripes"),
        ({"stripes": 8}, "8 stripes"),
        ({"height": 2000, "stripe_rows": 1, "stripes": 2000}, "2000 stripes"),
        ({"window": DisparityWindow(64, float("nan"))}, "finite"),
        ({"window": DisparityWindow(64, 0.0, float("inf"))}, "finite"),
        ({"window": DisparityWindow(64, 0.0, -1.0)}, "not negative"),
        ({"codec": 2, "near": 3}, "a bound of 3"),
        ({"codec": 2, "near": 255}, "a bound of 255"),
        ({"codec": 2, "table": bytes(1025)}, "1025 bytes: at most 1024"),
        ({"codec": 2, "table_apart": 1025}, "1025 bytes: at most 1024"),
        ({"codec": 2, "table_apart": 0x7FFF}, "32767 bytes: at most 1024"),
    ],
)
def test_a_head_beyond_the_limits_is_refused_before_anything_is_allocated(change: dict, message: str) -> None:
    body = replace(HEAD, **change).pack()
    with pytest.raises(WireError, match=message):
        DisparityHead.unpack(body)
    assembler = FrameAssembler()
    tracemalloc.start()
    try:
        assert assembler.feed(Packet(Channel.DISP, body, FIRST)) == []
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 * 1024
    assert assembler.statistics.malformed == 1
    assert assembler.flush() == []


@pytest.mark.parametrize(
    "head",
    [
        replace(HEAD, codec=9),
        replace(HEAD, near=1),
        replace(HEAD, table=b"abcd"),
        replace(HEAD, table_apart=9),
        replace(HEAD, codec=2, table=b"\xff" * 100),
    ],
    ids=["unknown codec", "codec 1 with a bound", "with a table", "with one that follows", "codec 2 with nonsense"],
)
def test_a_head_that_makes_no_sense_is_counted_and_opens_nothing(head: DisparityHead) -> None:
    assembler = FrameAssembler()
    assert assembler.feed(Packet(Channel.DISP, head.pack(), FIRST)) == []
    assert assembler.statistics.malformed == 1
    assert assembler.flush() == []


def test_a_table_that_is_cut_is_refused() -> None:
    with pytest.raises(WireError, match="table of 4 bytes and has 3"):
        DisparityHead.unpack(replace(HEAD, table=b"abcd").pack()[:-1])


PREFIX = st.sampled_from([*range(9), TABLES]).map(lambda first: struct.pack("<IH", 1, first))
CUT_PREFIX = st.sampled_from([*range(9), TABLES]).map(lambda first: struct.pack("<IH", 1, first | 0x8000))
STRIPE = st.tuples(U16 | st.integers(0, 30), U16, st.binary(max_size=30)).map(
    lambda parts: struct.pack("<HH", *parts[:2]) + parts[2]
)
HOSTILE = st.tuples(PREFIX | CUT_PREFIX, st.lists(STRIPE, max_size=3)).map(lambda parts: parts[0] + b"".join(parts[1]))


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from([HEAD, COMPACT, replace(COMPACT, table_apart=0)]),
    st.lists(st.tuples(HOSTILE | st.binary(max_size=60), st.sampled_from([0, FIRST, LAST])), max_size=30),
)
def test_hostile_fragments_never_break_the_assembler(head: DisparityHead, bodies: list[tuple[bytes, int]]) -> None:
    assembler = FrameAssembler()
    assembler.feed(Packet(Channel.DISP, head.pack(), FIRST))
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


def test_heads_of_the_largest_frames_open_three_of_them_at_most() -> None:
    largest = replace(HEAD, width=2000, height=2048, stripes=128, codec=2)
    packets = [Packet(Channel.DISP, replace(largest, frame=1000 - number).pack(), FIRST) for number in range(5)]
    assembler = FrameAssembler()
    assert [frame.missing_stripes for frame in received(assembler, packets)] == [128] * 2
    assert len(assembler.flush()) == 3


def damage(packets: list[Packet], random: np.random.Generator) -> list[Packet]:
    """Lose, repeat, swap and rewrite packets of a frame, as no line does: the check sums are past already."""
    out = []
    for packet in packets:
        body, luck = bytearray(packet.payload), random.integers(12)
        if luck == 0:
            continue
        if luck <= 2:
            body[random.integers(len(body))] ^= 1 << random.integers(8)
        if luck == 3:
            body = body[: random.integers(len(body))]
        out += [replace(packet, payload=bytes(body))] * (2 if luck == 4 else 1)
        if luck == 5 and len(out) > 1:
            out[-1], out[-2] = out[-2], out[-1]
    return out


def campaign(rounds: int, seed: int) -> tuple[int, int]:
    """Damage frames behind their check sums; return how many stripes were delivered, and how many of them wrong."""
    random, delivered, wrong = np.random.default_rng(seed), 0, 0
    sent = scene()
    for number in range(rounds):
        bound = (None, 0, 1, 2, 4)[number % 5]
        packets = packets_of(sent, mtu=(128, 240, 1024)[number % 3], bound=bound)
        (whole,) = received(FrameAssembler(), packets)
        assembler = FrameAssembler()
        head, *rest = packets
        for frame in [*received(assembler, [head, *damage(rest, random)]), *assembler.flush()]:
            for top in range(0, 100, 16):
                rows = slice(top, top + 16)
                if frame.index == 5 and not frame.lost_rows[rows].any():
                    delivered += 1
                    same = np.array_equal(
                        frame.disparity.disparity_px[rows], whole.disparity.disparity_px[rows], equal_nan=True
                    )
                    wrong += not same
    return delivered, wrong


def test_of_stripes_damaged_behind_their_check_sums_none_is_delivered_wrong() -> None:
    delivered, wrong = campaign(60, seed=3)
    assert delivered > 60
    assert wrong == 0


@pytest.mark.soak
def test_of_the_stripes_of_ten_thousand_damaged_frames_none_is_delivered_wrong() -> None:
    delivered, wrong = campaign(10_000, seed=4)
    print(f"10,000 frames damaged behind their check sums: {delivered} stripes delivered, {wrong} of them wrong")
    assert wrong == 0
