"""The sensor for programs that run on asyncio: the same camera, every wait an `await`.

    async with await prismstereo.AsyncStereoCamera.open() as camera:
        async for frame in camera:
            ...

Waiting is done in threads, so that a slow line never holds up the event loop. What is computed of a frame (`depth_mm`,
`points`) takes its milliseconds where it is asked for: `await asyncio.to_thread(lambda: frame.depth_mm)` spares the loop.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Self

from prismstereo.camera_frame import CameraFrame
from prismstereo.discovery import PortInfo
from prismstereo.driver import StereoCamera
from prismstereo.opening import open_camera
from prismstereo.still import StillPicture
from prismstereo_device.protocol.command import Value
from prismstereo_hw.errors import DeviceError

__all__ = ["AsyncStereoCamera"]


class AsyncStereoCamera:
    """A `StereoCamera`, which it owns, behind coroutines; its own `camera` has all that needs no waiting.

    One task at a time iterates. A wait that is cancelled loses no frame: the next one gets it.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._taker = ThreadPoolExecutor(1, "prismstereo-take")
        self._taking: asyncio.Future[CameraFrame | None] | None = None

    @classmethod
    async def open(
        cls,
        target: str | os.PathLike[str] | None = None,
        *,
        timeout_s: float = 5.0,
        baud: int | None = None,
        silence_s: float = 3.0,
        queue_frames: int = 8,
        keep_all: bool = False,
        reconnect: bool = True,
        listing: Callable[[], Iterable[PortInfo]] | None = None,
    ) -> Self:
        """Open a sensor, with the options and errors of `prismstereo.open`."""

        def opened() -> StereoCamera:
            return open_camera(
                target,
                timeout_s=timeout_s,
                baud=baud,
                silence_s=silence_s,
                queue_frames=queue_frames,
                keep_all=keep_all,
                reconnect=reconnect,
                listing=listing,
            )

        opening = asyncio.ensure_future(asyncio.to_thread(opened))
        try:
            return cls(await asyncio.shield(opening))
        except asyncio.CancelledError:
            opening.add_done_callback(_close_unwanted)
            raise

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> CameraFrame:
        frame = await self.take()
        if frame is None:
            raise StopAsyncIteration
        return frame

    async def take(self) -> CameraFrame | None:
        """Wait for the next frame; None where the stream has ended. Raises LinkLost as an iteration does."""
        if self._taking is None:
            self._taking = asyncio.get_running_loop().run_in_executor(self._taker, self.camera.take)
        try:
            frame = await asyncio.shield(self._taking)
        except DeviceError:  # a wait that is cancelled is kept: whoever asks next gets what comes of it
            self._taking = None
            raise
        self._taking = None
        return frame

    async def get(self, name: str) -> Value:
        """Ask for a setting."""
        return await asyncio.to_thread(self.camera.get, name)

    async def set(self, name: str, value: Value) -> Value:
        """Set a setting, checked beforehand, and return what is in force now."""
        return await asyncio.to_thread(lambda: self.camera.settings.change(name, value))

    async def do(self, name: str, value: Value = None) -> Value:
        """Let the camera do something."""
        return await asyncio.to_thread(self.camera.do, name, value)

    async def still(self, crop: tuple[int, int, int, int] | None = None, *, timeout_s: float = 30.0) -> StillPicture:
        """Take a full-sensor picture and fetch it."""
        return await asyncio.to_thread(lambda: self.camera.still(crop, timeout_s=timeout_s))

    async def close(self) -> None:
        """End the session and give the port back; closing twice does no harm."""
        await asyncio.to_thread(self.camera.close)
        self._taker.shutdown(wait=False)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


def _close_unwanted(opening: asyncio.Future[StereoCamera]) -> None:
    """Close what was opened for a task that no longer waits."""
    if not opening.cancelled() and opening.exception() is None:
        asyncio.get_running_loop().run_in_executor(None, opening.result().close)
