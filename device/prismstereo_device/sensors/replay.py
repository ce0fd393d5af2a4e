"""Recorded frames behind the same interface as a camera."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

from prismstereo_device.sensors.base import Limit, Pace, Sensor, SensorLimits, SensorMode, Still
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.replayed_stills import ReplayedStills
from prismstereo_device.sensors.video_file import VIDEO_SUFFIXES, VideoFile
from prismstereo_device.sensors.wishes import require_within
from prismstereo_hw.errors import ImageError, SessionError, UsageError
from prismstereo_hw.files import read_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.session import Session

__all__ = ["ReplaySensor"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff", ".bmp"}
_ASSUMED_RATE_HZ = 30.0
_OPTIONS = ("loop", "pace", "rate", "rig")


class ReplaySensor(Sensor):
    """Gives the frames of a session folder, of a video, of a folder of pictures in order of their names, or one picture.

    With `loop` it begins again after the last, indexes and stamps going on. It runs as fast as it is read, or at
    `rate_hz`, or, with `recorded_pace`, as the stamps say.
    """

    limits = SensorLimits(rate_hz=Limit(0.01, 1000.0))

    def __init__(
        self,
        path: str | Path,
        *,
        frames: int | None = None,
        rate_hz: float | None = None,
        loop: bool = False,
        recorded_pace: bool = False,
    ) -> None:
        path = Path(path)
        self._pace, self._loop, self._recorded_pace = Pace(rate_hz), loop, recorded_pace
        self._stills: ReplayedStills | None = None
        self._begin_s: float | None = None
        self._newest: RawFrame | None = None
        self._shift_us = 0
        self._open = self._recording(path)
        self._source = self._turns()
        self._read = islice(self._source, frames)

    @classmethod
    def parse(cls, argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> ReplaySensor:
        """Open `PATH[?loop=1&pace=recorded&rate=10&rig=oak-1]`; a path that holds a question mark itself is found as it is."""
        path, _, text = (argument, "", "") if os.path.exists(argument) else argument.partition("?")
        options = Options(text, _OPTIONS)
        recorded = options.choice("pace", ("free", "recorded"), "free") == "recorded"
        slowest_hz = min((rate for rate in (rate_hz, options.number("rate")) if rate), default=None)
        loop = options.flag("loop", default=False)
        sensor = cls(path, frames=frames, rate_hz=slowest_hz, loop=loop, recorded_pace=recorded)
        sensor.rig = options.rig() or sensor.rig
        return sensor

    def read(self) -> RawFrame | None:
        """Read the next frame; None after the last."""
        self._pace.wait()
        frame = next(self._read, None)
        if frame is not None:
            self._newest = frame
            if self._recorded_pace:
                self._wait_for(frame.timestamp_us)
        return frame

    def set_rate(self, rate_hz: float) -> None:
        """Give so many frames a second, however they were recorded."""
        require_within("rate_hz", rate_hz, self.limits.rate_hz)
        self._recorded_pace = False
        self._pace.set_rate(rate_hz)

    def still(self) -> Still:
        """Return the recorded still that is nearest in time to the newest frame."""
        if self._stills is None:
            raise UsageError("this recording holds no stills: replay a session that has some")
        if self._newest is None:
            raise UsageError("a still belongs to a video frame: read one first")
        found = self._stills.nearest(self._newest.timestamp_us - self._shift_us)
        frame = replace(found, index=self._newest.index, timestamp_us=found.timestamp_us + self._shift_us)
        return Still(frame, (0, 0, frame.width, frame.height))

    def close(self) -> None:
        """Close the recording."""
        self._source.close()

    def _recording(self, path: Path) -> Callable[[], Iterator[RawFrame]]:
        """Say how the recording is read from its front, once it is clear that it can be."""
        if path.suffix.lower() == ".mcap":
            raise UsageError(
                f"{path} is an MCAP recording: those are not replayed as a sensor, give a session or a video"
            )
        if os.path.isfile(path / "session.toml"):
            return self._session(path)
        if path.suffix.lower() in VIDEO_SUFFIXES and os.path.isfile(path):
            video = VideoFile(path)
            self.modes = (video.mode,)
            return video.frames
        files = _pictures(path)
        return lambda: (
            RawFrame(read_picture(file), index, round(index * 1e6 / _ASSUMED_RATE_HZ))
            for index, file in enumerate(files)
        )

    def _session(self, path: Path) -> Callable[[], Iterator[RawFrame]]:
        session = Session.open(path)
        if not session.paths("video"):
            raise SessionError(f"{path} holds no video frames: there is nothing to replay")
        self.rig = Rig.read(path / "rig.toml") if (path / "rig.toml").is_file() else None
        info = session.info
        self.modes = (SensorMode(info.video_width, info.video_height, "PNG", info.video_rate_hz),)
        if session.paths("stills"):
            self._stills = ReplayedStills(session)
        return lambda: session.frames("video")

    def _turns(self) -> Generator[RawFrame, None, None]:
        """Give the recording's frames, turn after turn with `loop`."""
        shift, next_index = 0, 0
        while True:
            first: RawFrame | None = None
            last: RawFrame | None = None
            count = 0
            for frame in self._open():
                if first is None:
                    first, shift = frame, next_index - frame.index if next_index else 0
                last, count = frame, count + 1
                yield replace(frame, index=frame.index + shift, timestamp_us=frame.timestamp_us + self._shift_us)
            if not self._loop or first is None or last is None:
                return
            length_us = last.timestamp_us - first.timestamp_us
            period_us = length_us / (count - 1) if length_us > 0 else 1e6 / _ASSUMED_RATE_HZ
            self._shift_us += length_us + round(period_us)
            next_index = last.index + shift + 1

    def _wait_for(self, timestamp_us: int) -> None:
        """Sleep until a stamp's time has come; a reader who is late is not hurried to catch up."""
        now_s, stamp_s = time.monotonic(), timestamp_us / 1e6
        if self._begin_s is None or now_s > self._begin_s + stamp_s:
            self._begin_s = now_s - stamp_s
        time.sleep(max(0.0, self._begin_s + stamp_s - now_s))


def _pictures(path: Path) -> list[Path]:
    if os.path.isdir(path):
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in _SUFFIXES)
    else:
        files = [path] if os.path.isfile(path) else []
    if not files:
        raise ImageError(
            f"there is nothing to replay at {path}: give a session folder, a folder of pictures, a picture or a video"
        )
    return files
