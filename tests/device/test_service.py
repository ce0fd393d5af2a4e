from __future__ import annotations

import threading
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from device.service_host import IDENTITY, Blocking, Breaking, Counting, Host, disparity
from prismstereo_device.framing import Framer
from prismstereo_device.link import Link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.protocol import (
    Capability,
    FrameAck,
    HealthFlag,
    Hello,
    HelloKind,
    HelloReply,
    Ping,
    Pong,
    calibration_hash,
    read_control,
    read_hello,
)
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_device.wire import Channel, WireError
from prismstereo_hw.errors import DeviceError

CALIBRATION = bytes(range(256)) * 40
OBJECTS = FixedObjects({ObjectNumber.CALIBRATION: CALIBRATION})


@pytest.fixture
def line() -> Iterator[tuple[Link, Link]]:
    device, host = loopback()
    with device, host:
        yield device, host


def test_hello_is_answered_with_who_the_camera_is(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY, objects=OBJECTS):
        reply = Host(host_end).meet()
    assert reply == HelloReply(1, 5, 4096, b"serial-1", 77, calibration_hash(CALIBRATION), Capability.COMPACT)


def test_nothing_is_sent_before_a_hello(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(5), device, IDENTITY) as service:
        assert host_end.read(0.3) == b""
        assert service.statistics.sent == 0


def test_every_frame_of_a_lossless_service_arrives_bit_by_bit(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(40), device, IDENTITY, lossless=True) as service:
        time.sleep(0.1)  # nobody is there yet: the source waits
        host = Host(host_end)
        host.meet()
        host.hear_until(
            lambda: any(HealthFlag.END_OF_STREAM in report.flags for report in host.health()), acknowledge=True
        )
        assert service.ended
        statistics = service.statistics
    assert [frame.index for frame in host.frames] == list(range(40))
    assert [frame.timestamp_us for frame in host.frames] == [1000 * number for number in range(1, 41)]
    for frame in host.frames:
        np.testing.assert_array_equal(frame.disparity.disparity_px, disparity(frame.index).disparity_px)
    assert (statistics.captured, statistics.sent, statistics.dropped) == (40, 40, 0)


def test_a_lossless_service_makes_its_source_wait_for_a_host_that_does_not_acknowledge(line: tuple[Link, Link]) -> None:
    device, host_end = line
    source = Counting(100)
    with Service(source, device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: len(host.frames) == 3)
        for _ in range(20):
            host.hear()
        assert len(host.frames) == 3
        assert source.made <= 3 + 2 + 2  # on the line, waiting, in hand
        assert service.statistics.dropped == 0


def test_no_room_means_that_nothing_is_sent(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(100), device, IDENTITY, lossless=True):
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: len(host.frames) == 3)
        host.say(Channel.CTRL, FrameAck(2, room=0).pack())
        for _ in range(10):
            host.hear()
        assert len(host.frames) == 3
        host.say(Channel.CTRL, FrameAck(2, room=1).pack())
        host.hear_until(lambda: len(host.frames) == 4)


def test_the_newest_frame_wins_where_the_line_is_slower_than_the_source(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(60, period_s=0.005), device, IDENTITY) as service:
        host = Host(host_end)
        host.meet()
        while not service.ended:
            host.hear()
            time.sleep(0.05)
            if host.assembler.newest_started is not None:
                host.say(Channel.CTRL, FrameAck(host.assembler.newest_started).pack())
        host.hear_until(lambda: bool(host.frames) and host.frames[-1].index == 59)
        statistics = service.statistics
    assert statistics.dropped > 10
    assert statistics.sent + statistics.dropped == statistics.captured == 60
    numbers = [frame.index for frame in host.frames]
    assert numbers == sorted(numbers)
    assert len(numbers) == statistics.sent


def test_answers_come_at_once_while_the_source_computes_for_seconds(line: tuple[Link, Link]) -> None:
    device, host_end = line
    source = Blocking()
    with Service(source, device, IDENTITY):
        host = Host(host_end)
        host.meet()
        begin = time.monotonic()
        host.say(Channel.CTRL, Ping(123).pack(), msg=9)
        host.hear_until(lambda: bool(host.on(Channel.CTRL)))
        assert time.monotonic() - begin < 0.5
        pong = read_control(host.on(Channel.CTRL)[0])
        assert isinstance(pong, Pong)
        assert pong.t_host_us == 123
        assert pong.t_rx_us <= pong.t_tx_us
        host.hear_until(lambda: len(host.health()) >= 2, timeout_s=3.0)
        source.go.set()


def test_health_tells_the_counters(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(3), device, IDENTITY, lossless=True, temperature_c=lambda: 41.26):
        host = Host(host_end)
        host.link.write(b"line noise\0")
        host.meet()
        host.hear_until(lambda: any(report.flags for report in host.health()))
        report = host.health()[-1]
    assert (report.frames_captured, report.frames_sent, report.frames_dropped) == (3, 3, 0)
    assert (report.packets_good, report.packets_bad, report.packets_oversize) == (1, 1, 0)
    assert report.temperature_c == 41.3
    assert report.flags is HealthFlag.END_OF_STREAM
    assert report.uptime_us > 0


def test_a_source_that_breaks_is_told_and_the_service_lives_on(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Breaking(2), device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: any(report.flags for report in host.health()))
        assert host.health()[-1].flags == HealthFlag.END_OF_STREAM | HealthFlag.SOURCE_FAILED
        assert len(host.frames) == 2
        host.say(Channel.CTRL, Ping(1).pack())
        host.hear_until(lambda: bool(host.on(Channel.CTRL)))
        assert str(service.failure) == "the sensor was pulled out"


def test_versions_that_do_not_meet_are_refused_with_the_cameras_own(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(3), device, IDENTITY) as service:
        host = Host(host_end)
        host.say(Channel.HELLO, Hello(5, 2, 7).pack())
        host.hear_until(lambda: bool(host.on(Channel.HELLO)))
        assert service.statistics.sessions == 0
    assert read_hello(host.on(Channel.HELLO)[0]) == Hello(5, 1, 1, HelloKind.REFUSE)


def test_a_host_that_restarts_gets_a_new_session_and_the_old_one_is_deaf(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(10_000, period_s=0.002), device, IDENTITY) as service:
        first = Host(host_end, nonce=5)
        first.meet()
        first.hear_until(lambda: len(first.frames) >= 2, acknowledge=True)
        second = Host(host_end, nonce=6)
        second.meet()
        second.hear_until(lambda: len(second.frames) >= 2, acknowledge=True)
        bad = service.statistics.line.bad
        first.say(Channel.CTRL, Ping(1).pack())
        second.hear_until(lambda: service.statistics.line.bad == bad + 1, acknowledge=True)
        assert service.statistics.sessions == 2
    assert not any(frame.partial for frame in second.frames)


def test_a_hello_that_is_repeated_changes_nothing(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(3), device, IDENTITY, lossless=True) as service:
        host = Host(host_end)
        host.meet()
        host.say(Channel.HELLO, Hello(host.nonce).pack())
        host.hear_until(lambda: len(host.on(Channel.HELLO)) == 2 and len(host.frames) == 3)
        assert service.statistics.sessions == 1


def test_what_is_not_understood_is_counted_and_harmless(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(0), device, IDENTITY) as service:
        host = Host(host_end)
        host.meet()
        host.say(Channel.IMG, b"?")
        host.say(Channel.CTRL, b"")
        host.say(Channel.CTRL, b"\xee")
        host.say(Channel.CTRL, Pong(1, 2, 3).pack())
        host.say(Channel.BULK, b"\x09" * 20)
        host.say(Channel.HELLO, b"\x01")
        host.say(Channel.HELLO, b"\x02" * 40)
        host.hear_until(lambda: service.statistics.ignored == 7)
        host.say(Channel.CTRL, Ping(1).pack())
        host.hear_until(lambda: bool(host.on(Channel.CTRL)))


def test_a_host_that_never_reads_costs_no_memory(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(100_000), device, IDENTITY) as service:
        host = Host(host_end)
        host.say(Channel.HELLO, Hello(5).pack())
        deadline = time.monotonic() + 10
        while service.statistics.captured < 50:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        tracemalloc.start()
        try:
            captured = service.statistics.captured
            while service.statistics.captured < captured + 300:
                assert time.monotonic() < deadline
                host.say(Channel.CTRL, Ping(1).pack())
                time.sleep(0.01)
            grown, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        statistics = service.statistics
    assert grown < 1 << 20
    assert statistics.dropped >= statistics.captured - 12


def test_a_service_stops_while_its_line_is_full_and_its_source_waits() -> None:
    device, host_end = loopback(capacity=2000)
    with device, host_end:
        service = Service(Counting(1000), device, IDENTITY, lossless=True)
        service.start()
        host_end.write(Framer(5).encode(Channel.HELLO, Hello(5).pack()))
        time.sleep(0.2)
        begin = time.monotonic()
        service.stop()
        assert time.monotonic() - begin < 2.0
        assert service.failure is None


def test_a_service_ends_when_its_link_does() -> None:
    device, host_end = loopback()
    service = Service(Counting(1000, period_s=0.01), device, IDENTITY)
    runner_raised: list[BaseException] = []

    def run() -> None:
        try:
            service.run()
        except DeviceError as error:
            runner_raised.append(error)

    runner = threading.Thread(target=run)
    runner.start()
    host_end.close()
    runner.join(5)
    assert not runner.is_alive()
    assert [str(error) for error in runner_raised] == ["the line loopback is closed"]


def test_an_identity_that_the_wire_cannot_carry_is_refused() -> None:
    with pytest.raises(WireError, match="8 bytes"):
        DeviceIdentity(b"short", 1)
    with pytest.raises(WireError, match="32 bits"):
        replace(IDENTITY, boot_id=-1)
