from __future__ import annotations

import asyncio
import threading
from contextlib import suppress

import pytest

from host.counting import Counting, serve
from host.small_device import SmallDevice
from prismstereo.asyncio_camera import AsyncStereoCamera
from prismstereo.driver import StereoCamera
from prismstereo_device.link import LinkLost, PortError
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort


async def frames_of(name: str) -> list[int]:
    async with await AsyncStereoCamera.open(name, keep_all=True) as camera:
        return [frame.index async for frame in camera]


def test_frames_come_in_a_loop_that_awaits_them_and_it_ends_with_the_stream() -> None:
    with PtyPort() as link, serve(Counting(30), link, lossless=True):
        assert asyncio.run(frames_of(link.name)) == list(range(30))


def test_a_wait_that_is_given_up_loses_no_frame_and_the_loop_runs_on() -> None:
    async def hurried() -> tuple[list[int], int]:
        device, host = loopback()
        with device, serve(Counting(6, period_s=0.05), device, lossless=True):
            async with AsyncStereoCamera(StereoCamera(host, keep_all=True)) as camera:
                taken, gave_up = [], 0
                while True:
                    try:
                        async with asyncio.timeout(0.01):
                            frame = await camera.take()
                    except TimeoutError:
                        gave_up += 1
                        continue
                    if frame is None:
                        return taken, gave_up
                    taken.append(frame.index)

    taken, gave_up = asyncio.run(hurried())
    assert taken == list(range(6))
    assert gave_up >= 6


def test_commands_are_awaited_beside_each_other() -> None:
    async def asked() -> list[object]:
        device, host = loopback()
        with device, SmallDevice(device):
            async with AsyncStereoCamera(StereoCamera(host)) as camera:
                return await asyncio.gather(*(camera.do("count", number) for number in range(8)), camera.get("count"))

    assert asyncio.run(asked()) == [*range(8), None]


def test_a_camera_that_is_lost_ends_the_loop_with_its_reason() -> None:
    async def lost() -> None:
        device, host = loopback()
        source = Counting(1, then="compute")
        with serve(source, device):
            async with AsyncStereoCamera(StereoCamera(host)) as camera:
                async for _ in camera:
                    source.let_go.set()
                    device.close()

    with pytest.raises(LinkLost, match="after 1 frames"):
        asyncio.run(lost())


def test_closing_ends_a_wait_in_another_task() -> None:
    async def closed() -> object:
        device, host = loopback()
        with device, SmallDevice(device):
            camera = AsyncStereoCamera(StereoCamera(host))
            waiting = asyncio.create_task(camera.take())
            await asyncio.sleep(0.05)
            await camera.close()
            await camera.close()
            return await waiting

    before = threading.active_count()
    assert asyncio.run(closed()) is None
    assert threading.active_count() <= before


def test_opening_that_is_given_up_gives_the_port_back() -> None:
    async def given_up(name: str) -> bytes:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.001):
                await AsyncStereoCamera.open(name)
        while True:
            with suppress(PortError):  # for one program at a time, and it takes a moment to open and to close it
                async with await AsyncStereoCamera.open(name) as camera:
                    return camera.camera.identity.device_id
            await asyncio.sleep(0.05)

    with PtyPort() as link, SmallDevice(link):
        assert asyncio.run(asyncio.wait_for(given_up(link.name), 10.0)) == b"serial-1"
