"""A Video4Linux camera without hardware: what the kernel would write into a caller's bytes, and a stream behind a shutter.

The bytes are written at the offsets of linux/videodev2.h, by number, so that a wrong layout on our side shows.
"""

from __future__ import annotations

import ctypes
import errno
import os
import struct
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import cv2
from cv2.typing import MatLike

AUTO_EXPOSURE, EXPOSURE, PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
GAIN, AUTO_GAIN, FOCUS, AUTO_FOCUS = 0x00980913, 0x00980912, 0x009A090A, 0x009A090C


@dataclass
class KernelControl:
    """A control as a driver keeps it; `keeps` is what it makes of a value."""

    least: int
    most: int
    value: int
    flags: int = 0
    keeps: Callable[[int], int] = lambda value: value


@dataclass
class KernelCamera:
    """Answers `ioctl` for one camera: format -> size -> (numerator, denominator) of the times between frames."""

    modes: dict[str, dict[tuple[int, int], list[tuple[int, int]]]]
    controls: dict[int, KernelControl] = field(default_factory=dict)
    stepwise: dict[str, tuple[int, ...]] = field(default_factory=dict)  # format -> least, most, step, of both
    capabilities: int = 0x84200001
    device_caps: int = 0x04200001
    buffer_type: int = 1
    gone: bool = False

    def ioctl(self, descriptor: int, request: int, asked: ctypes.Structure) -> int:
        """Do as the kernel does: fill in the caller's bytes, or fail with its error number."""
        os.fstat(descriptor)  # it must be open
        if self.gone:
            raise OSError(errno.ENODEV, "No such device")
        answers = {
            0x80685600: self._capability,
            0xC0405602: self._format,
            0xC02C564A: self._size,
            0xC034564B: self._interval,
            0xC0445624: self._query,
            0xC008561B: self._get,
            0xC008561C: self._set,
        }
        there = memoryview(asked).cast("B")
        assert len(there) == request >> 16 & 0x3FFF  # the kernel copies as many bytes as the request's number says
        answers[request](there)
        return 0

    def _capability(self, there: memoryview) -> None:
        struct.pack_into(
            "16s32s32sIII", there, 0, b"uvcvideo", b"Test Camera", b"usb", 1, self.capabilities, self.device_caps
        )

    def _format(self, there: memoryview) -> None:
        index, buffer_type = struct.unpack_from("II", there, 0)
        names = [*self.modes, *self.stepwise]
        if buffer_type != self.buffer_type or index >= len(names):
            raise OSError(errno.EINVAL, "Invalid argument")
        struct.pack_into("32s4s", there, 12, b"a format", names[index].encode().ljust(4))

    def _size(self, there: memoryview) -> None:
        index, name = struct.unpack_from("I4s", there, 0)
        key = name.decode().rstrip()
        if key in self.stepwise and index == 0:
            struct.pack_into("I6I", there, 8, 3, *self.stepwise[key])
            return
        sizes = list(self.modes.get(key, {}))
        if index >= len(sizes):
            raise OSError(errno.EINVAL, "Invalid argument")
        struct.pack_into("III", there, 8, 1, *sizes[index])

    def _interval(self, there: memoryview) -> None:
        index, name, width, height = struct.unpack_from("I4sII", there, 0)
        times = self.modes.get(name.decode().rstrip(), {}).get((width, height), [])
        if index >= len(times):
            raise OSError(errno.EINVAL, "Invalid argument")
        struct.pack_into("III", there, 16, 1, *times[index])

    def _control(self, there: memoryview) -> KernelControl:
        (key,) = struct.unpack_from("I", there, 0)
        if key not in self.controls:
            raise OSError(errno.EINVAL, "Invalid argument")
        return self.controls[key]

    def _query(self, there: memoryview) -> None:
        found = self._control(there)
        struct.pack_into("iiiiI", there, 40, found.least, found.most, 1, found.value, found.flags)

    def _get(self, there: memoryview) -> None:
        struct.pack_into("i", there, 4, self._control(there).value)

    def _set(self, there: memoryview) -> None:
        found, (value,) = self._control(there), struct.unpack_from("i", there, 4)
        if not found.least <= value <= found.most:
            raise OSError(errno.ERANGE, "Numerical result out of range")
        found.value = found.keeps(value)


class Shutter:
    """A stream that gives a frame each time it is released, of buffers as they are or of a real capture; then it ends.

    `stamp_ms` tells the driver's stamp of the n-th frame. What is set is kept, as far as `keeps` allows.
    """

    def __init__(
        self,
        frames: Iterable[MatLike] | cv2.VideoCapture,
        *,
        stamp_ms: Callable[[int], float] = lambda n: 40.0 * n,
        fixed: dict[int, float] | None = None,
    ) -> None:
        self._frames = frames if isinstance(frames, cv2.VideoCapture) else iter(list(frames))
        self._permits, self._stamp_ms = threading.Semaphore(0), stamp_ms
        self._properties: dict[int, float] = {}
        self._fixed = fixed or {}
        self._current: MatLike | None = None
        self.count, self._asked, self.released, self._ended = 0, 0, False, False

    def let_through(self, frames: int = 1) -> None:
        """Expose so many more frames, and wait until the reader has them and asks for the one after."""
        until = self.count + frames + 1
        self._permits.release(frames)
        deadline_s = time.monotonic() + 5
        while self._asked < until and not self.released and time.monotonic() < deadline_s:
            time.sleep(0.001)

    def end(self) -> None:
        """Let the waiting reader run into the end: the cable is pulled."""
        self._ended = True
        self._permits.release(1)

    def grab(self) -> bool:
        self._asked = self.count + 1
        if not self._permits.acquire(timeout=10) or self._ended:  # a real one waits as long for a silent camera
            return False
        if isinstance(self._frames, cv2.VideoCapture):
            if not self._frames.grab():
                return False
            self._current = self._frames.retrieve()[1]
        else:
            self._current = next(self._frames, None)
            if self._current is None:
                return False
        self.count += 1
        return True

    def retrieve(self) -> tuple[bool, MatLike]:
        assert self._current is not None
        return True, self._current

    def get(self, propId: int, /) -> float:
        if propId == cv2.CAP_PROP_POS_MSEC:
            return self._stamp_ms(self.count - 1)
        return self._fixed.get(propId, self._properties.get(propId, 0.0))

    def set(self, propId: int, value: float, /) -> bool:
        self._properties[propId] = value
        return True

    def release(self) -> None:
        self.released = True
        if isinstance(self._frames, cv2.VideoCapture):
            self._frames.release()
