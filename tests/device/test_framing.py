from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from prismstereo_device.framing import Deframer, Framer, LineStatistics, Packet, encode
from prismstereo_device.wire import FIRST, LAST, LIMITS, REPLY, RESERVED, Channel, WireError

SESSION = 0x1234_5678
U16 = st.integers(0, 0xFFFF)
FLAGS = st.sampled_from([0, FIRST, LAST, FIRST | LAST, REPLY, FIRST | LAST | REPLY])
PACKETS = st.builds(
    Packet, channel=st.integers(0, 15), payload=st.binary(max_size=300), flags=FLAGS, seq=U16, msg=U16, frag=U16
)


def numbered(count: int, size: int = 40, seed: int = 0) -> list[Packet]:
    random = np.random.default_rng(seed)
    return [Packet(Channel.DISP, random.bytes(size), FIRST, number) for number in range(count)]


def on_the_line(packets: list[Packet]) -> bytes:
    return b"".join(encode(packet, SESSION) for packet in packets)


@settings(deadline=None)
@given(PACKETS)
def test_a_packet_comes_back_field_by_field(packet: Packet) -> None:
    assert Deframer(SESSION).feed(encode(packet, SESSION)) == [packet]


def test_the_longest_packet_passes_even_where_stuffing_costs_most() -> None:
    packet = Packet(2, b"\xff" * LIMITS.payload, 0x30, 0x0101, 0x0101, 0x0101)
    data = encode(packet, SESSION)
    assert len(data) - 1 <= LIMITS.packet_encoded
    assert Deframer(SESSION).feed(data) == [packet]
    with pytest.raises(WireError, match="4097 bytes"):
        encode(Packet(2, bytes(LIMITS.payload + 1)), SESSION)


def test_a_packet_is_laid_out_as_the_wire_format_says() -> None:
    import struct

    import google_crc32c
    from cobs import cobs

    data = encode(Packet(Channel.DISP, b"payload", FIRST | LAST, seq=2, msg=3, frag=4), SESSION)
    body = cobs.decode(data[:-1])
    assert data[-1:] == b"\0"
    assert body[:-4] == struct.pack("<BHHH", 0x32, 2, 3, 4) + b"payload"
    assert struct.unpack("<I", body[-4:])[0] == google_crc32c.value(body[:-4] + struct.pack("<I", SESSION))


def test_every_flipped_bit_is_noticed() -> None:
    data = encode(Packet(3, bytes(range(60)), LAST, 77, 88, 99), SESSION)
    for bit in range((len(data) - 1) * 8):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        deframer = Deframer(SESSION)
        assert deframer.feed(bytes(damaged)) == []
        assert deframer.statistics.bad >= 1


@settings(deadline=None)
@given(st.lists(PACKETS, min_size=1, max_size=8), st.lists(st.integers(1, 60), min_size=1, max_size=200))
def test_any_chop_of_the_stream_gives_the_same_packets(packets: list[Packet], cuts: list[int]) -> None:
    deframer, stream, found = Deframer(SESSION), on_the_line(packets), []
    for size in cuts:
        found += deframer.feed(stream[:size])
        stream = stream[size:]
    found += deframer.feed(stream)
    assert found == packets
    assert deframer.statistics.good == len(packets)


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=300), st.integers(0, 10))
def test_garbage_between_packets_costs_at_most_the_packet_after_it(garbage: bytes, where: int) -> None:
    packets = numbered(12)
    stream = on_the_line(packets[:where]) + garbage + on_the_line(packets[where:])
    found = Deframer(SESSION).feed(stream)
    assert found in (packets, packets[:where] + packets[where + 1 :])


RATES = [1e-5, 1e-4, 1e-3, 1e-2]
FAULTS = ["bit", "byte", "drop", "repeat", "burst", "zero", "ones"]
BURST = 20


def damaged(stream: NDArray[np.uint8], fault: str, rate: float, random: np.random.Generator) -> bytes:
    hit = random.random(stream.size) < rate
    if fault == "burst":
        hit = np.convolve(hit, np.ones(BURST))[: stream.size] > 0
    damage = {
        "bit": lambda: np.where(hit, stream ^ (1 << random.integers(0, 8, stream.size)), stream).astype(np.uint8),
        "byte": lambda: np.where(hit, stream ^ random.integers(1, 256, stream.size), stream).astype(np.uint8),
        "drop": lambda: stream[~hit],
        "repeat": lambda: np.repeat(stream, 1 + hit),
        "burst": lambda: np.where(hit, random.integers(0, 256, stream.size), stream).astype(np.uint8),
        "zero": lambda: np.where(hit, 0, stream).astype(np.uint8),
        "ones": lambda: np.where(hit, 255, stream).astype(np.uint8),
    }
    return damage[fault]().tobytes()


def over_a_faulty_line(count: int, fault: str, rate: float, seed: int) -> tuple[int, float, int]:
    """Send `count` packets: how many came through untouched, which share should have, and how many came wrong."""
    random = np.random.default_rng(seed)
    packets = numbered(count, size=200)
    stream = np.frombuffer(on_the_line(packets), np.uint8)
    found = Deframer(SESSION).feed(damaged(stream, fault, rate, random))
    wrong = sum(packet != packets[packet.seq] for packet in found)
    length = stream.size / count + (BURST - 1 if fault == "burst" else 0)
    return len(found), (1 - rate) ** length, wrong


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_line_gives_no_wrong_packet_and_keeps_those_it_did_not_touch(fault: str, rate: float) -> None:
    found, untouched, wrong = over_a_faulty_line(1500, fault, rate, seed=5)
    assert wrong == 0
    assert abs(found / 1500 - untouched) < 0.03


@pytest.mark.soak
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("fault", FAULTS)
def test_of_fifty_thousand_packets_over_a_faulty_line_none_is_wrong(fault: str, rate: float) -> None:
    found, untouched, wrong = over_a_faulty_line(50_000, fault, rate, seed=6)
    print(f"{fault:6} at {rate:g} a byte: {found} of 50,000 packets, {untouched:.1%} untouched, {wrong} wrong")
    assert wrong == 0
    assert abs(found / 50_000 - untouched) < 0.03


@pytest.mark.soak
def test_of_two_million_random_candidates_none_passes_for_a_packet() -> None:
    random, deframer = np.random.default_rng(7), Deframer(SESSION)
    found = []
    for _ in range(200):
        noise = random.integers(0, 256, 2_560_000, dtype=np.uint8)
        found += deframer.feed(noise.tobytes())
    print(f"random bytes: {deframer.statistics.bad} candidates refused, {len(found)} taken")
    assert deframer.statistics.bad > 1_900_000
    assert found == []


def test_another_session_is_not_heard() -> None:
    deframer = Deframer(SESSION)
    assert deframer.feed(encode(Packet(2, b"old"), SESSION + 1)) == []
    assert deframer.statistics.bad == 1
    deframer.adopt(SESSION + 1)
    assert len(deframer.feed(encode(Packet(2, b"new"), SESSION + 1))) == 1


def test_only_the_hello_channel_is_heard_outside_a_session() -> None:
    hello, video = Packet(Channel.HELLO, b"hello"), Packet(Channel.DISP, b"video")
    assert Deframer().feed(encode(hello, SESSION) + encode(video, 0)) == [hello]
    assert Deframer(SESSION).feed(encode(hello, 0)) == [hello]


def test_a_packet_with_the_reserved_bit_is_dropped_and_counted() -> None:
    deframer = Deframer(SESSION)
    assert deframer.feed(encode(Packet(2, b"from the future", RESERVED), SESSION)) == []
    assert deframer.statistics == LineStatistics(0, 1, 0, 28)


def test_numbers_count_up_per_channel_and_wrap() -> None:
    framer, deframer = Framer(SESSION), Deframer(SESSION)
    data = b"".join(framer.encode(Channel.DISP, b"") for _ in range(65537)) + framer.encode(Channel.CTRL, b"")
    numbers = [packet.seq for packet in deframer.feed(data)]
    assert numbers == [*range(65536), 0, 0]


def test_100_megabytes_without_a_boundary_cost_no_memory_and_count_once() -> None:
    deframer, junk = Deframer(SESSION), b"\xaa" * 1_000_000
    deframer.feed(junk)
    tracemalloc.start()
    try:
        for _ in range(99):
            deframer.feed(junk)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 * 1024
    assert deframer.statistics == LineStatistics(0, 0, 1, 100_000_000)
    packet = Packet(2, b"after")
    assert deframer.feed(b"\0" + encode(packet, SESSION)) == [packet]


def test_an_endless_line_in_small_reads_stays_bounded_too() -> None:
    deframer = Deframer(SESSION)
    tracemalloc.start()
    try:
        for _ in range(20_000):
            deframer.feed(b"\xaa" * 50)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 64 * 1024
    assert deframer.statistics.oversize == 1


def test_100_megabytes_of_zeros_take_less_than_two_seconds() -> None:
    deframer, zeros = Deframer(SESSION), bytes(100_000_000)
    begin = time.thread_time()
    assert deframer.feed(zeros) == []
    assert time.thread_time() - begin < 2.0
    assert deframer.statistics == LineStatistics(0, 0, 0, 100_000_000)


@settings(deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=20))
def test_no_bytes_make_the_reader_fail(chunks: list[bytes]) -> None:
    deframer = Deframer(SESSION)
    assert [packet for chunk in chunks for packet in deframer.feed(chunk)] == []
    packet = Packet(1, b"still here")
    assert deframer.feed(b"\0" + encode(packet, SESSION)) == [packet]
