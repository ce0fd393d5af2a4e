"""Pictures: every kind comes back whole or not at all, and what unfolds to more than it says is refused before it does."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from device.wire_scenes import quickest_s
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import (
    PictureAssembler,
    PictureEncoding,
    PictureHead,
    PictureKind,
    PictureStatistics,
    ReceivedPicture,
    picture_fragments,
)
from prismstereo_device.wire import FIRST, LAST, LIMITS, WireError

Pixels = NDArray[np.uint8]


def picture(channels: int = 3, height: int = 37, width: int = 53) -> Pixels:
    rows, columns = np.mgrid[:height, :width]
    grey = (rows * 3 + columns * 2) % 256
    stack = np.stack([(grey + 40 * number) % 256 for number in range(channels)], -1).astype(np.uint8)
    return stack[:, :, 0] if channels == 1 else stack


def packets_of(pixels: Pixels, kind: PictureKind, frame: int = 7, mtu: int = 240, **options) -> list[Packet]:
    parts = picture_fragments(pixels, kind=kind, frame=frame, timestamp_us=777, mtu=mtu, **options)
    return [Packet(kind.channel, payload, flags, 0, frame & 0xFFFF, index) for flags, index, payload in parts]


def received(assembler: PictureAssembler, packets: list[Packet]) -> list[ReceivedPicture]:
    return [done for packet in packets for done in assembler.feed(packet)]


@pytest.mark.parametrize("mtu", [128, 4096])
@pytest.mark.parametrize("encoding", [PictureEncoding.PNG, PictureEncoding.ZSTD])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_raw_frame_comes_back_exactly(channels: int, encoding: PictureEncoding, mtu: int) -> None:
    sent = picture(channels)
    packets = packets_of(sent, PictureKind.RAW, mtu=mtu, encoding=encoding, crop=(5, 6, 53, 37), lens_position=120)
    assert max(len(packet.payload) for packet in packets) <= mtu
    assert [packet.frag for packet in packets] == list(range(len(packets)))
    assert [packet.flags for packet in packets] == [FIRST, *[0] * (len(packets) - 2), LAST]
    (got,) = received(PictureAssembler(), packets)
    np.testing.assert_array_equal(got.pixels(), sent)
    assert (got.head.frame, got.head.timestamp_us, got.head.crop, got.head.lens_position) == (
        7,
        777,
        (5, 6, 53, 37),
        120,
    )


@pytest.mark.parametrize("channels", [1, 3])
def test_a_preview_is_a_jpeg_close_to_the_picture(channels: int) -> None:
    sent = cv2.GaussianBlur(picture(channels), None, 5)
    (got,) = received(PictureAssembler(), packets_of(sent, PictureKind.PREVIEW))
    assert got.data[:3] == b"\xff\xd8\xff"
    assert np.abs(got.pixels().astype(int) - sent).mean() < 4


@pytest.mark.parametrize("kind", [PictureKind.REASONS, PictureKind.CONFIDENCE])
@pytest.mark.parametrize(("height", "width"), [(36, 52), (37, 53), (1, 1), (4, 5)])
def test_planes_hold_every_fourth_pixel_both_ways(kind: PictureKind, height: int, width: int) -> None:
    sent = picture(1, height, width)
    (got,) = received(PictureAssembler(), packets_of(sent, kind))
    np.testing.assert_array_equal(got.pixels(), sent[::4, ::4])
    assert (got.head.step, got.head.crop) == (4, (0, 0, width, height))


def test_each_kind_has_its_channel_and_does_not_disturb_the_others() -> None:
    assembler = PictureAssembler()
    streams = [packets_of(picture(1), kind, frame=kind) for kind in PictureKind]
    mixed = [stream[at] for at in range(max(map(len, streams))) for stream in streams if at < len(stream)]
    assert sorted(got.head.kind for got in received(assembler, mixed)) == list(PictureKind)


def test_a_lost_packet_costs_the_picture_and_is_counted() -> None:
    packets = packets_of(picture(), PictureKind.RAW, mtu=128)
    assert len(packets) >= 3
    for lost in range(len(packets)):
        assembler = PictureAssembler()
        assert received(assembler, packets[:lost] + packets[lost + 1 :]) == []
        (got,) = received(assembler, packets_of(picture(), PictureKind.RAW, frame=8))
        assert got.head.frame == 8
        assert assembler.statistics.lost + assembler.statistics.stray >= 1


def test_a_newer_picture_wins_and_a_repeated_packet_does_no_harm() -> None:
    assembler = PictureAssembler()
    old, new = (packets_of(picture(), PictureKind.RAW, frame, mtu=128) for frame in (7, 8))
    doubled = [packet for packet in new for _ in range(2)]
    got = received(assembler, old[:2] + doubled)
    assert [each.head.frame for each in got] == [8]
    assert assembler.statistics == PictureStatistics(whole=1, lost=1, malformed=0, stray=1)


HEAD = PictureHead(PictureKind.RAW, PictureEncoding.PNG, 1, 2, 53, 37, 3, (0, 0, 53, 37), 1, 100)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0, "crop": (0, 0, 0, 37)}, "1 to 8192"),
        ({"width": 8193, "crop": (0, 0, 8193, 37)}, "1 to 8192"),
        ({"width": 65535, "height": 65535}, "1 to 8192"),
        ({"kind": PictureKind.PREVIEW, "width": 2049}, "1 to 2048"),
        ({"channels": 2}, "1 or 3 channels"),
        ({"width": 8192, "height": 8192, "crop": (0, 0, 8192, 8192)}, "201326592 bytes"),
        ({"size": 0}, "0 bytes"),
        ({"size": LIMITS.picture + 1}, "8388609 bytes"),
        ({"size": 0xFFFF_FFFF}, "4294967295 bytes"),  # 4 GB
        ({"step": 0}, "number 0"),
        ({"step": 2}, "these are 27 x 19"),
    ],
)
def test_a_head_beyond_the_limits_opens_nothing(change: dict, message: str) -> None:
    body = replace(HEAD, **change).pack()
    with pytest.raises(WireError, match=message):
        PictureHead.unpack(body)
    assembler = PictureAssembler()
    assert assembler.feed(Packet(PictureKind.RAW.channel, body, FIRST)) == []
    assert assembler.statistics == PictureStatistics(malformed=1)


@pytest.mark.parametrize("kind", [b"\0\1", b"\5\1", b"\1\0", b"\1\4"])
def test_a_kind_or_encoding_of_the_future_is_counted(kind: bytes) -> None:
    assembler = PictureAssembler()
    assembler.feed(Packet(PictureKind.RAW.channel, kind + HEAD.pack()[2:], FIRST))
    assert assembler.statistics.malformed == 1


def test_a_picture_on_another_channel_is_refused() -> None:
    assembler = PictureAssembler()
    assembler.feed(Packet(PictureKind.PREVIEW.channel, HEAD.pack(), FIRST))
    assert assembler.statistics == PictureStatistics(malformed=1)


def png_bomb(width: int, height: int) -> bytes:
    """A PNG of zeros, honest about its size."""
    rows = zlib.compressobj(9)
    line, pieces = bytes(1 + width), []
    for _ in range(height):
        pieces.append(rows.compress(line))
    pieces.append(rows.flush())
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"".join(pieces)) + chunk(b"IEND", b"")


def jpeg(pixels: Pixels, *options: int) -> bytes:
    return cv2.imencode(".jpg", pixels, list(options))[1].tobytes()


def jpeg_of_claimed_size(width: int, height: int) -> bytes:
    data = bytearray(jpeg(picture(1)))
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def many_scans(count: int) -> bytes:
    data = jpeg(picture(1))
    scan = data[data.index(b"\xff\xda") : -2]
    return data[:-2] + scan * count + b"\xff\xd9"


BOMBS: dict[str, tuple[PictureEncoding, Callable[[], bytes]]] = {
    "a PNG of 64 million pixels": (PictureEncoding.PNG, lambda: png_bomb(8000, 8000)),
    "a PNG that claims 4 GB": (
        PictureEncoding.PNG,
        lambda: b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">IIBBBBB", 65535, 65535, 8, 0, 0, 0, 0) + bytes(60),
    ),
    "a JPEG that claims 4 GB": (PictureEncoding.JPEG, lambda: jpeg_of_claimed_size(65500, 65500)),
    "a JPEG of ten thousand scans": (PictureEncoding.JPEG, lambda: many_scans(10_000)),
    "a progressive JPEG": (PictureEncoding.JPEG, lambda: jpeg(picture(1), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
    "a hundred megabytes of zstd": (
        PictureEncoding.ZSTD,
        lambda: zstandard.ZstdCompressor(write_checksum=True).compress(bytes(100_000_000)),
    ),
    "zstd that claims 4 GB": (
        PictureEncoding.ZSTD,
        lambda: b"\x28\xb5\x2f\xfd\xa4" + struct.pack("<I", 0xFFFF_FFFF) + bytes(40),
    ),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_at_once_and_before_it_unfolds(name: str) -> None:
    encoding, make = BOMBS[name]
    data = make()
    head = replace(HEAD, encoding=encoding, channels=1, size=len(data))
    body = head.pack()
    offsets = range(0, len(data), 4000)
    parts = [Packet(head.kind.channel, struct.pack("<II", 1, at) + data[at : at + 4000], 0) for at in offsets]

    def refuse() -> None:
        assembler = PictureAssembler()
        assert received(assembler, [Packet(head.kind.channel, body, FIRST), *parts]) == []
        assert assembler.statistics == PictureStatistics(malformed=1)
        with pytest.raises(WireError):
            ReceivedPicture(head, data).pixels()

    assert quickest_s(refuse, 0.05) < 0.05
    tracemalloc.start()
    try:
        refuse()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 16 << 20


def chunked(data: bytes, name: bytes) -> bytes:
    """The PNG with one chunk more before its pixels."""
    at = data.index(b"IDAT") - 4
    return data[:at] + struct.pack(">I", 3) + name + b"abc" + struct.pack(">I", zlib.crc32(name + b"abc")) + data[at:]


@pytest.mark.parametrize(
    ("encoding", "spoil"),
    [
        (PictureEncoding.PNG, lambda data: chunked(data, b"zTXt")),
        (PictureEncoding.PNG, lambda data: chunked(data, b"iCCP")),
        (PictureEncoding.PNG, lambda data: data + b"more"),
        (PictureEncoding.PNG, lambda data: data[:-12]),
        (PictureEncoding.PNG, lambda data: data[:-30]),
        (PictureEncoding.JPEG, lambda data: data + b"more"),
        (PictureEncoding.JPEG, lambda data: data[:-2]),
        (PictureEncoding.JPEG, lambda data: data[:300]),
        (PictureEncoding.JPEG, lambda data: data[: data.index(b"\xff\xc0")] + data[data.index(b"\xff\xda") :]),
        (PictureEncoding.ZSTD, lambda data: data + b"more"),
        (PictureEncoding.ZSTD, lambda data: data[:-4] + bytes(4)),
    ],
)
def test_a_file_of_another_form_is_refused(encoding: PictureEncoding, spoil: Callable[[bytes], bytes]) -> None:
    (got,) = received(PictureAssembler(), packets_of(picture(1), PictureKind.RAW, encoding=encoding))
    bad = spoil(got.data)
    with pytest.raises(WireError):
        ReceivedPicture(replace(got.head, size=len(bad)), bad).pixels()


@settings(deadline=None, max_examples=80)
@given(st.sampled_from(PictureEncoding), st.integers(0, 10_000), st.integers(0, 255), st.booleans())
def test_damaged_files_raise_nothing_but_a_wire_error_or_have_the_announced_size(
    encoding: PictureEncoding, place: int, byte: int, cut: bool
) -> None:
    (got,) = received(PictureAssembler(), packets_of(picture(1), PictureKind.RAW, encoding=encoding))
    data = bytearray(got.data)
    data[place % len(data)] = byte
    bad = bytes(data[: place % len(data)] if cut else data)
    try:
        assert ReceivedPicture(got.head, bad).pixels().shape == (37, 53)
    except WireError:
        return


@settings(deadline=None, max_examples=40)
@given(
    st.lists(
        st.tuples(st.binary(max_size=60), st.sampled_from([0, FIRST, LAST]), st.sampled_from(PictureKind)), max_size=20
    )
)
def test_hostile_packets_never_break_the_assembler(bodies: list[tuple[bytes, int, PictureKind]]) -> None:
    assembler = PictureAssembler()
    assembler.feed(Packet(PictureKind.RAW.channel, HEAD.pack(), FIRST))
    for body, flags, kind in bodies:
        assembler.feed(Packet(kind.channel, struct.pack("<I", 1) + body if len(body) % 2 else body, flags))
    (got,) = received(assembler, packets_of(picture(), PictureKind.RAW, frame=2))
    np.testing.assert_array_equal(got.pixels(), picture())


def test_a_picture_that_cannot_be_compressed_is_an_error_of_ours() -> None:
    with pytest.raises(WireError, match="1 or 3 channels"):
        packets_of(np.zeros((4, 4, 2), np.uint8), PictureKind.RAW, encoding=PictureEncoding.ZSTD)
    with pytest.raises(WireError, match="1 to 2048"):
        packets_of(np.zeros((2, 2049), np.uint8), PictureKind.PREVIEW)
