from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from device.service_host import IDENTITY, Counting, Host, Repeating, disparity, smooth
from prismstereo_device.link import Link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.protocol import (
    HealthFlag,
    PictureKind,
    Ping,
    ReadRequest,
    ReceivedPicture,
    ZonesMessage,
)
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import Service
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import Channel
from prismstereo_device.zones import ZoneDistances


def pixels(seed: int, height: int = 64, width: int = 80) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)


ZONES = ZoneDistances(3, 4000, np.arange(12, dtype=np.uint16).reshape(3, 4))


class Everything(Counting):
    """Frames with all that can be asked for."""

    def frame(self, number: int) -> ProducedFrame:
        planes = replace(disparity(number), reasons=pixels(10), confidence=pixels(20))
        plain = replace(super().frame(number), preview=pixels(30), raw=pixels(number, 70, 90), lens_position=5)
        return replace(plain, disparity=planes, zones=replace(ZONES, index=number))


def by_kind(pictures: list[ReceivedPicture]) -> dict[PictureKind, list[ReceivedPicture]]:
    return {kind: [picture for picture in pictures if picture.head.kind is kind] for kind in PictureKind}


@pytest.fixture
def line() -> Iterator[tuple[Link, Link]]:
    device, host = loopback()
    with device, host:
        yield device, host


def test_what_a_frame_carries_arrives_with_it_and_a_lossless_service_loses_none_of_it(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Everything(4), device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: any(HealthFlag.END_OF_STREAM in each.flags for each in host.health()), acknowledge=True)
        assert (service.statistics.pictures_dropped, service.statistics.dropped) == (0, 0)
    found = by_kind(host.pictures)
    for pictures in found.values():
        assert [picture.head.frame for picture in pictures] == [0, 1, 2, 3]
    for number in range(4):
        np.testing.assert_array_equal(found[PictureKind.RAW][number].pixels(), pixels(number, 70, 90))
        np.testing.assert_array_equal(found[PictureKind.REASONS][number].pixels(), pixels(10)[::4, ::4])
        np.testing.assert_array_equal(found[PictureKind.CONFIDENCE][number].pixels(), pixels(20)[::4, ::4])
        assert found[PictureKind.RAW][number].head.timestamp_us == 1000 * (number + 1)
        assert found[PictureKind.RAW][number].head.lens_position == 5
    assert found[PictureKind.PREVIEW][0].pixels().shape == (64, 80)
    np.testing.assert_array_equal(ZonesMessage.unpack(host.on(Channel.ZONES)[-1]).zones.nearest_mm, ZONES.nearest_mm)


def test_with_the_stream_off_raw_frames_come_and_no_disparity(line: tuple[Link, Link]) -> None:
    device, host_end = line
    frame = ProducedFrame(0, 0, None, None, raw=pixels(1))
    with Service(Repeating(frame, 5), device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: len(host.pictures) == 5)
        assert (service.statistics.captured, service.statistics.sent, service.statistics.dropped) == (5, 0, 0)
    assert not host.on(Channel.DISP)
    assert [picture.head.frame for picture in host.pictures] == [0, 1, 2, 3, 4]


def test_the_newest_picture_wins_and_one_that_has_begun_is_finished() -> None:
    device, host_end = loopback(mtu=512, bytes_per_s=100_000)
    frame = ProducedFrame(0, 0, None, None, raw=pixels(1, 100, 120), preview=pixels(2, 40, 40))
    with device, host_end, Service(Repeating(frame, 50, period_s=0.01), device, IDENTITY) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: service.ended)
        statistics = service.statistics
    found = by_kind(host.pictures)
    assert 2 <= len(found[PictureKind.RAW]) <= 25
    assert len(found[PictureKind.PREVIEW]) >= 2
    assert host.picture_assembler.statistics.lost == 0
    assert statistics.pictures_dropped + len(host.pictures) == 100
    for pictures in found.values():
        numbers = [picture.head.frame for picture in pictures]
        assert numbers == sorted(numbers)
    np.testing.assert_array_equal(found[PictureKind.RAW][-1].pixels(), frame.raw)


def test_nothing_starves_on_a_line_that_frames_fill() -> None:
    device, host_end = loopback(mtu=512, bytes_per_s=90_000)
    frame = ProducedFrame(0, 0, None, smooth(1, 180, 160), preview=pixels(1), zones=ZONES)
    objects = FixedObjects({2: bytes(100_000)})
    with device, host_end, Service(Repeating(frame, 100_000, 0.02), device, IDENTITY, objects=objects):
        host = Host(host_end)
        host.meet()
        ends, latest, asked = time.monotonic() + 0.7, 0.0, 0
        while time.monotonic() < ends:
            asked += 1
            host.say(Channel.BULK, ReadRequest(2, 0, 0, 480).pack(), asked)
            begin = time.monotonic()
            host.say(Channel.CTRL, Ping(asked).pack(), asked)
            host.hear_answer(Channel.CTRL, asked)
            latest = max(latest, time.monotonic() - begin)
            host.hear_answer(Channel.BULK, asked)
            host.acknowledge()
    packets = Counter(packet.channel for packet in host.heard)
    assert latest < 0.3  # three packets are 17 ms; the rest is a busy machine
    assert packets[Channel.BULK] >= 10
    assert packets[Channel.IMG] >= 5
    assert packets[Channel.ZONES] >= 5
    assert packets[Channel.DISP] >= 10


def test_a_picture_that_no_packet_can_hold_is_dropped_and_the_stream_goes_on(line: tuple[Link, Link]) -> None:
    device, host_end = line
    frame = ProducedFrame(0, 0, None, disparity(1), preview=np.zeros((1, 3000), np.uint8))
    with Service(Repeating(frame, 3), device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: service.ended, acknowledge=True)
        assert service.statistics.pictures_dropped == 3
        assert service.failure is None
    assert [each.index for each in host.frames] == [0, 1, 2]


def test_a_new_host_gets_no_half_picture_of_the_one_before() -> None:
    device, host_end = loopback(mtu=256, bytes_per_s=100_000)
    frame = ProducedFrame(0, 0, None, None, raw=pixels(1, 200, 200))
    with device, host_end, Service(Repeating(frame, 100_000, 0.01), device, IDENTITY):
        first = Host(host_end, nonce=5)
        first.meet()
        first.hear_until(lambda: len(first.on(Channel.RAW)) > 20)
        second = Host(host_end, nonce=6)
        second.meet()
        second.hear_until(lambda: len(second.pictures) == 1)
        assert second.picture_assembler.statistics.stray == 0
