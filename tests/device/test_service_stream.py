from __future__ import annotations

import gc
import os
import threading
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from device.service_host import IDENTITY, Breaking, Counting, Host, Repeating, disparity, smooth
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link import Link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.protocol import Capability, DisparityHead, HealthFlag, Ping, Pong, read_control
from prismstereo_device.serving.rate_control import HALVED, RateControl, halved
from prismstereo_device.serving.service import Service
from prismstereo_device.serving.status_led import LedState
from prismstereo_device.serving.watchdog import Notifier
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import FIRST, Channel

STILL_LIFE = smooth(1, 90, 120)
FRAME = ProducedFrame(0, 0, None, STILL_LIFE, calibration_hash=b"flashed!", filter_set=0x21)


@pytest.fixture
def line() -> Iterator[tuple[Link, Link]]:
    device, host = loopback()
    with device, host:
        yield device, host


def heads(host: Host) -> list[DisparityHead]:
    return [
        DisparityHead.unpack(packet.payload)
        for packet in host.heard
        if packet.channel == Channel.DISP and packet.flags & FIRST
    ]


def steps_off(frame: DisparityMap, truth: DisparityMap) -> int:
    difference = frame.fixed_point().astype(np.int64) - truth.fixed_point()
    return int(np.abs(difference).max())


@pytest.mark.parametrize("bound", [0, 1, 2, 4])
def test_a_chosen_bound_is_kept_and_told(line: tuple[Link, Link], bound: int) -> None:
    device, host_end = line
    with Service(Repeating(FRAME, 3), device, IDENTITY, rate_control=RateControl(bound=bound), lossless=True):
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: any(report.flags for report in host.health()), acknowledge=True)
    assert [(head.codec, head.near) for head in heads(host)] == [(2, bound)] * 3
    assert (host.health()[-1].bound, host.health()[-1].half_resolution) == (bound, False)
    for frame in host.frames:
        assert steps_off(frame.disparity, STILL_LIFE) == bound
        np.testing.assert_array_equal(frame.disparity.valid, STILL_LIFE.valid)
        assert frame.calibration_hash == b"flas"


def test_a_host_that_does_not_read_codec_2_gets_codec_1(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Repeating(FRAME, 2), device, IDENTITY, rate_control=RateControl(bound=4), lossless=True):
        host = Host(host_end, capabilities=Capability.NONE)
        host.meet()
        host.hear_until(lambda: any(report.flags for report in host.health()), acknowledge=True)
    assert [head.codec for head in heads(host)] == [1, 1]
    assert [steps_off(frame.disparity, STILL_LIFE) for frame in host.frames] == [0, 0]
    assert host.health()[-1].bound is None


def test_a_slow_line_gets_half_the_resolution_and_says_so() -> None:
    device, host_end = loopback(mtu=240, bytes_per_s=11_000)
    control = RateControl(line_bytes_per_s=11_000)
    with device, host_end, Service(Repeating(FRAME, 1000, 0.04), device, IDENTITY, rate_control=control):
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: any(report.half_resolution for report in host.health()), acknowledge=True)
        host.hear_until(lambda: len(host.frames) >= 12, acknowledge=True)
    assert heads(host)[-1].filter_set == 0x21 | HALVED
    assert 5_000 < host.health()[-1].line_bytes_per_s < 12_000
    assert steps_off(host.frames[-1].disparity, halved(STILL_LIFE)) == 4
    assert host.frames[-1].disparity.window.scale_px == STILL_LIFE.window.scale_px / 2


def test_on_a_line_that_loses_packets_heads_come_twice_and_packets_get_short(line: tuple[Link, Link]) -> None:
    device, host_end = line
    with Service(Counting(60), device, IDENTITY, lossless=True):
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: len(host.frames) >= 2)
        assert max(len(packet.payload) for packet in host.heard) > 240
        told = len(host.frames)
        while len(host.frames) < told + 6:  # what was in flight when the host said so is past by then
            host.acknowledge(loss_permille=60)
            host.hear()
        host.heard.clear()
        while len(heads(host)) < 6:
            host.acknowledge(loss_permille=60)
            host.hear()
        late = [packet for packet in host.heard if packet.channel == Channel.DISP]
    assert max(len(packet.payload) for packet in late) <= 240
    numbers = [head.frame for head in heads(host)]
    whole = set(numbers) - {numbers[0], numbers[-1]}  # of the first and the last one the other head may lie outside
    assert whole
    assert all(numbers.count(number) == 2 for number in whole)
    for frame in host.frames:
        assert steps_off(frame.disparity, disparity(frame.index)) == 0


def test_the_devices_clock_stamps_what_it_says(line: tuple[Link, Link]) -> None:
    device, host_end = line
    ticks = iter(range(2**32 - 3, 2**32 + 1_000_000, 2))
    with Service(Counting(0), device, IDENTITY, clock_us=lambda: next(ticks)):
        host = Host(host_end)
        host.meet()
        pong = read_control(host.ask(Channel.CTRL, Ping(5).pack(), 1))
    assert isinstance(pong, Pong)
    assert 2**32 - 3 < pong.t_rx_us < pong.t_tx_us < 2**32 + 1000


def streamed_across_the_wraps(frames: int, period_us: int) -> None:
    """A host that takes frames whose numbers, and requests whose numbers, pass their largest on the way."""
    device, host_end = loopback()
    first = 2**32 - min(frames // 2, 40_000)
    small = ProducedFrame(0, 0, None, disparity(1, 8, 16))
    clock = [2**32 - 1_000_000]

    class Ticking(Repeating):
        def read(self) -> ProducedFrame | None:
            clock[0] += period_us + period_us * 30 // 1_000_000  # 30 ppm fast
            return super().read()

    with (
        device,
        host_end,
        Service(
            Ticking(small, frames, first=first), device, IDENTITY, lossless=True, clock_us=lambda: clock[0]
        ) as service,
    ):
        host = Host(host_end)
        host.meet()
        asked, taken, last = 65_500, 0, first - 1
        while not (service.ended and taken == frames):
            host.hear()
            host.acknowledge()
            for frame in host.frames:
                assert (frame.index - last) % 2**32 == 1
                assert not frame.partial
                last = frame.index
            taken += len(host.frames)
            host.frames.clear()
            asked = (asked + 1) & 0xFFFF
            if asked % 8 == 0:
                pong = read_control(host.ask(Channel.CTRL, Ping(asked).pack(), asked))
                assert isinstance(pong, Pong)
                assert abs(pong.t_rx_us - clock[0]) < 10_000_000
            host.heard.clear()
        assert service.statistics.dropped == 0
    assert taken == frames


def test_no_frame_is_lost_where_numbers_wrap() -> None:
    streamed_across_the_wraps(200, 40_000)


@pytest.mark.soak
def test_no_frame_of_a_simulated_hour_is_lost_where_numbers_wrap() -> None:
    begin = time.monotonic()
    streamed_across_the_wraps(90_000, 40_000)
    print(f"\nan hour at 25 frames/s across every wrap: 0 of 90000 frames lost, {time.monotonic() - begin:.0f} s")


class Manager(Notifier):
    """Keeps what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.kicks = 0

    def kick(self) -> None:
        self.kicks += 1

    def _send(self, line: str) -> None:
        self.lines.append(line)


class Lamp:
    def __init__(self) -> None:
        self.shown: list[LedState] = []

    def show(self, state: LedState) -> None:
        if self.shown[-1:] != [state]:
            self.shown.append(state)


def test_manager_and_lamp_are_told_what_goes_on(line: tuple[Link, Link]) -> None:
    device, host_end = line
    manager, lamp = Manager(), Lamp()
    with Service(Counting(5), device, IDENTITY, lossless=True, notifier=manager, led=lamp) as service:
        host = Host(host_end)
        host.hear_until(lambda: LedState.WAITING in lamp.shown)
        host.meet()
        host.hear_until(lambda: service.ended and LedState.STREAMING in lamp.shown, acknowledge=True)
        kicks = manager.kicks
        host.hear_until(lambda: manager.kicks > kicks)  # nothing is left to do, and all is well
    assert lamp.shown == [LedState.STARTING, LedState.WAITING, LedState.STREAMING, LedState.OFF]
    assert manager.lines.count("READY=1") == manager.lines.count("STOPPING=1") == 1
    assert "STATUS=waiting for a host on loopback" in manager.lines
    assert "STATUS=a host is served" in manager.lines
    assert manager.kicks >= 5


def test_the_watchdog_is_fed_while_a_lossless_source_waits_for_a_host(line: tuple[Link, Link]) -> None:
    manager = Manager()
    with Service(Counting(50), line[0], IDENTITY, lossless=True, notifier=manager):
        host = Host(line[1])
        host.hear_until(lambda: manager.kicks > 5)


def test_a_source_that_hangs_or_broke_feeds_no_watchdog(line: tuple[Link, Link]) -> None:
    device, host_end = line
    manager, lamp = Manager(), Lamp()
    with Service(Breaking(2), device, IDENTITY, notifier=manager, led=lamp) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: LedState.FAULT in lamp.shown)
        kicks = manager.kicks
        host.hear_until(lambda: any(HealthFlag.SOURCE_FAILED in each.flags for each in host.health()), acknowledge=True)
        assert host.health()[-1].last_error == "the sensor was pulled out"
        host.ask(Channel.CTRL, Ping(1).pack(), 1)
    assert manager.kicks == kicks == 2
    assert "STATUS=failed: the sensor was pulled out" in manager.lines
    assert service.failure is not None


def stream_a_frame() -> None:
    device, host_end = loopback()
    frame = replace(FRAME, preview=np.zeros((4, 4), np.uint8))
    with device, host_end, Service(Repeating(frame, 1000, 0.001), device, IDENTITY):
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: bool(host.frames and host.pictures), acknowledge=True)


def test_a_service_that_stops_leaves_no_thread_and_no_descriptor() -> None:
    threads = threading.active_count()
    descriptors = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else 0
    for _ in range(5):
        stream_a_frame()
    assert threading.active_count() == threads
    if descriptors:
        assert len(os.listdir("/proc/self/fd")) == descriptors


def grown_bytes(frames: int, every_s: float, period_s: float = 0.0) -> tuple[int, int]:
    """Bytes by which the device grows while a host takes a frame only now and then, and how many frames it took."""
    device, host_end = loopback()
    frame = ProducedFrame(0, 0, None, smooth(1, 180, 160), preview=np.zeros((180, 160), np.uint8))
    with device, host_end, Service(Repeating(frame, 1_000_000, period_s), device, IDENTITY) as service:
        host = Host(host_end)
        host.meet()
        host.hear_until(lambda: len(host.frames) >= 3, acknowledge=True)
        gc.collect()
        tracemalloc.start()
        try:
            began = service.statistics.captured
            while service.statistics.captured < began + frames:
                time.sleep(every_s)
                host.acknowledge()
                host.hear()
                host.heard.clear()
                host.frames.clear()
                host.pictures.clear()
            gc.collect()
            grown = tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()
        return grown, service.statistics.sent


def test_a_host_that_takes_a_frame_now_and_then_leaves_the_devices_memory_flat() -> None:
    grown, _ = grown_bytes(1000, every_s=0.05)
    assert grown < 1 << 20


@pytest.mark.soak
def test_a_host_that_takes_a_frame_in_five_seconds_leaves_the_devices_memory_flat_for_minutes() -> None:
    grown, sent = grown_bytes(100_000, every_s=5.0, period_s=0.0005)
    print(f"\na host that reads once in 5 s: 100000 frames made, {sent} sent, {grown / 1024:.0f} KiB grown")
    assert grown < 1 << 20
