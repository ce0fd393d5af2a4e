"""Every small body: it comes back, grows at its end only, and no bytes break its reader."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.wire_scenes import quickest_s
from prismstereo_calibration import flash
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.codec.compact import BOUNDS
from prismstereo_device.protocol import (
    Capability,
    Command,
    CommandReply,
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
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
    ZonesMessage,
    calibration_hash,
    read_bulk_reply,
    read_bulk_request,
    read_control,
    read_hello,
)
from prismstereo_device.protocol.fragments import read_fragment
from prismstereo_device.wire import WireError
from prismstereo_device.zones import ZoneDistances

U8, U16, U32 = st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF_FFFF)
U64 = st.integers(0, 2**64 - 1)
NONCE = st.integers(1, 0xFFFF_FFFF)
EIGHT = st.binary(min_size=8, max_size=8)
FLOAT = st.floats(-1e6, 1e6, width=32)
ABILITY = st.integers(0, 255).map(Capability)
LENS = st.none() | st.integers(0, 2**31 - 1)

MESSAGES = {
    "Hello": st.tuples(NONCE, U8, U8, st.sampled_from([HelloKind.OFFER, HelloKind.REFUSE]), ABILITY).map(
        lambda fields: Hello(fields[0], min(fields[1:3]), max(fields[1:3]), *fields[3:])
    ),
    "HelloReply": st.builds(HelloReply, U8, NONCE, st.integers(128, 4096), EIGHT, U32, EIGHT, ABILITY),
    "Ping": st.builds(Ping, U64),
    "Pong": st.builds(Pong, U64, U64, U64),
    "FrameAck": st.builds(FrameAck, U32, U8, st.integers(0, 1000)),
    "Health": st.builds(
        Health,
        *[U32] * 6,
        U64,
        st.none() | st.integers(-500, 1500).map(lambda tenths: tenths / 10),
        st.sampled_from([HealthFlag.NONE, HealthFlag.END_OF_STREAM, HealthFlag(3)]),
        st.none() | st.sampled_from(BOUNDS),
        st.booleans(),
        U32,
        U32,
        st.sampled_from(["", "camera gone", "Maß verloren", "x" * 64]),
    ),
    "ReadRequest": st.builds(ReadRequest, U8, U32, U32, U32),
    "WriteBegin": st.builds(WriteBegin, U8, U32, st.binary(min_size=32, max_size=32)),
    "WriteCommit": st.builds(WriteCommit, U8, U32, st.binary(min_size=32, max_size=32)),
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
        lens_position=LENS,
        filter_set=U16,
        near=st.sampled_from(BOUNDS),
        table_apart=st.integers(0, 1024),
    ),
    "PictureHead": st.builds(
        lambda width, height, step, **rest: PictureHead(
            width=width, height=height, step=step, crop=(3, 5, width * step, height * step), **rest
        ),
        kind=st.sampled_from(PictureKind),
        encoding=st.sampled_from(PictureEncoding),
        frame=U32,
        timestamp_us=U64,
        width=st.integers(1, 2000),
        height=st.integers(1, 2000),
        channels=st.sampled_from([1, 3]),
        step=st.sampled_from([1, 4]),
        size=st.integers(1, 8 << 20),
        lens_position=LENS,
    ),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_comes_back_and_what_a_later_version_adds_is_ignored(name: str) -> None:
    @settings(deadline=None, max_examples=30)
    @given(MESSAGES[name], st.binary(max_size=9))
    def law(message, extra: bytes) -> None:
        assert type(message).unpack(message.pack()) == message
        assert type(message).unpack(message.pack() + extra) == message

    law()


READERS: dict[str, Callable[[bytes], object]] = {
    "read_hello": read_hello,
    "read_control": read_control,
    "read_fragment": read_fragment,
    "read_bulk_request": read_bulk_request,
    "read_bulk_reply": read_bulk_reply,
    "WritePart": WritePart.unpack,
    "WriteReply": WriteReply.unpack,
    "ReadReply": ReadReply.unpack,
    "Zones": ZonesMessage.unpack,
    "Command": Command.unpack,
    "CommandReply": CommandReply.unpack,
} | {name: globals()[name].unpack for name in MESSAGES}


@pytest.mark.parametrize("name", READERS)
def test_arbitrary_bytes_raise_nothing_but_a_wire_error_and_take_less_than_ten_milliseconds(name: str) -> None:
    some = st.binary(max_size=80) | st.tuples(st.integers(1, 4), st.binary(max_size=60)).map(
        lambda parts: bytes([parts[0]]) + parts[1]
    )

    def read(body: bytes) -> None:
        with contextlib.suppress(WireError):
            READERS[name](body)

    @settings(deadline=None, max_examples=40)
    @given(some)
    def law(body: bytes) -> None:
        assert quickest_s(lambda: read(body), 0.01) < 0.01

    law()


@pytest.mark.soak
@pytest.mark.parametrize("name", READERS)
def test_two_hundred_thousand_arbitrary_bodies_raise_nothing_but_a_wire_error(name: str) -> None:
    random, refused = np.random.default_rng(7), 0
    for number in range(200_000):
        body = random.bytes(int(random.integers(0, 90)))
        if number % 2 and body:
            body = bytes([number // 2 % 5]) + body[1:]
        try:
            READERS[name](body)
        except WireError:
            refused += 1
    print(f"{name}: 200,000 arbitrary bodies, {refused} refused, no other exception")
    assert refused > 0


def test_the_bodies_are_laid_out_as_the_wire_format_says() -> None:
    assert Hello(7, 1, 2, capabilities=Capability.COMPACT).pack() == struct.pack("<BBBII", 1, 1, 2, 7, 1)
    reply = HelloReply(1, 7, 512, b"serial-1", 9, b"calibrat", Capability.COMPACT | Capability.COMMANDS)
    assert reply.pack() == struct.pack("<BBIH8sI8sI", 2, 1, 7, 512, b"serial-1", 9, b"calibrat", 3)
    assert Ping(5).pack()[1:] == struct.pack("<Q", 5)
    assert Pong(5, 6, 7).pack()[1:] == struct.pack("<QQQ", 5, 6, 7)
    assert FrameAck(8, 2, 50).pack()[1:] == struct.pack("<IBH", 8, 2, 50)


@pytest.mark.parametrize(("offered", "shared"), [((1, 1), 1), ((1, 9), 1), ((0, 1), 1), ((2, 5), None), ((0, 0), None)])
def test_the_newest_shared_version_is_taken(offered: tuple[int, int], shared: int | None) -> None:
    assert Hello(1, *offered).shared_version() == shared


OLD_HELLO = struct.pack("<BBBI", 1, 1, 1, 7)
OLD_ACK = struct.pack("<BI", 3, 9)
OLD_HEALTH = struct.pack("<IIIIIIQhB", 1, 2, 3, 4, 5, 6, 7, 250, 1)


def test_an_old_host_reads_no_compact_frames_and_has_the_usual_room() -> None:
    hello = Hello.unpack(OLD_HELLO)
    assert hello.shared_version() == 1
    assert hello.capabilities is Capability.NONE
    assert FrameAck.unpack(OLD_ACK) == FrameAck(9, 3, 0)
    assert FrameAck.unpack(OLD_ACK + b"\2") == FrameAck(9, 2, 0)


def test_an_old_device_tells_its_counters_and_can_do_nothing_new() -> None:
    assert Health.unpack(OLD_HEALTH) == Health(1, 2, 3, 4, 5, 6, 7, 25.0, HealthFlag.END_OF_STREAM)
    reply = struct.pack("<BBIH8sI8sI", 2, 1, 7, 512, b"serial-1", 9, b"calibrat", 0)
    assert HelloReply.unpack(reply).capabilities is Capability.NONE


@pytest.mark.parametrize("kept", range(7, 11))
def test_a_grown_field_that_is_not_whole_is_not_there(kept: int) -> None:
    assert Hello.unpack(Hello(7, capabilities=Capability.COMPACT).pack()[:kept]).capabilities is Capability.NONE


@pytest.mark.parametrize("kept", range(35, 45))
def test_a_health_report_of_any_length_is_read_as_far_as_it_goes(kept: int) -> None:
    body = Health(1, 2, 3, 4, 5, 6, 7, 25.0, HealthFlag(1), 2, half_resolution=True, pictures_dropped=8).pack()
    health = Health.unpack(body[:kept])
    assert (health.frames_captured, health.temperature_c, health.half_resolution) == (1, 25.0, True)
    assert (health.bound, health.pictures_dropped) == (None, 0)


def test_bits_of_the_future_are_left_out() -> None:
    reply = struct.pack("<BBIH8sI8sI", 2, 1, 7, 512, b"serial-1", 9, b"calibrat", 0xFFFF_FF01)
    assert HelloReply.unpack(reply).capabilities is Capability.COMPACT
    assert Health.unpack(OLD_HEALTH[:-1] + b"\xf8").flags is HealthFlag.NONE


def test_an_error_of_any_length_is_cut_between_two_characters() -> None:
    health = Health.unpack(Health(*[0] * 7, last_error="ä" * 40 + "\ud800").pack())
    assert health.last_error == "ä" * 32
    assert len(health.pack()) == 45 + 64


def test_the_calibrations_hash_is_the_one_its_own_folder_gives() -> None:
    assert calibration_hash(b"flash") == flash.digest(b"flash")
    assert calibration_hash(b"") == bytes(8)


def grid(rows: int, columns: int) -> ZoneDistances:
    nearest_mm = np.arange(rows * columns, dtype=np.uint16).reshape(rows, columns) * 7
    return ZoneDistances(9, 777, nearest_mm, floor_removed=True)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (8, 14), (8, 255)])
def test_zones_come_back_and_have_two_bytes_each(rows: int, columns: int) -> None:
    sent = grid(rows, columns)
    body = ZonesMessage(sent).pack()
    assert len(body) == 15 + 2 * rows * columns
    read = ZonesMessage.unpack(body + b"later").zones
    assert (read.index, read.timestamp_us, read.floor_removed) == (9, 777, True)
    np.testing.assert_array_equal(read.nearest_mm, sent.nearest_mm)


@pytest.mark.parametrize(("rows", "columns"), [(0, 3), (3, 0), (256, 1), (200, 200)])
def test_an_impossible_grid_is_refused_at_both_ends(rows: int, columns: int) -> None:
    with pytest.raises(WireError, match="1 to 255"):
        ZonesMessage(grid(rows, columns)).pack()
    if max(rows, columns) < 256:
        with pytest.raises(WireError, match="1 to 255"):
            ZonesMessage.unpack(struct.pack("<IQBBB", 1, 2, rows, columns, 0) + bytes(9000))
    with pytest.raises(WireError, match="are due"):
        ZonesMessage.unpack(ZonesMessage(grid(2, 2)).pack()[:-1])
