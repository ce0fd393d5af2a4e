"""Frames to measure on, from a session folder, picture files or a recording; with the raw frame where there is one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.export.sources import RecordingSource
from prismstereo.frames import expand
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import read
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.errors import UsageError
from prismstereo_hw.files import read_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.session import Session
from prismstereo_hw.twin import Truth

if TYPE_CHECKING:
    from prismstereo_device.filters import FilterChain
    from prismstereo_device.match import Matcher
    from prismstereo_hw.rig import RangeWish

__all__ = ["MeasuringFrame", "RecordedFrames", "TakenFrames", "open_frames"]

_NS_PER_US = 1000


@dataclass(frozen=True, slots=True, eq=False)
class MeasuringFrame:
    """A frame with its depth, the raw frame it was made of (None from a recording) and the truth, if there is any."""

    depth: ExportFrame
    raw: RawFrame | None = None
    truth: Truth | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TakenFrames:
    """Raw frames that are matched now: the pictures of a session's video, or picture files."""

    paths: tuple[Path, ...]
    pipeline: Pipeline
    session: Session | None = None

    @property
    def true(self) -> bool:
        """Whether the truth is known behind every frame."""
        return self.session is not None and self.session.info.truth

    def frames(self, first: int = 0, end: int | None = None) -> Iterator[MeasuringFrame]:
        """Match the frames that are asked for, one at a time."""
        geometries = Geometries(self.pipeline.calibration)
        for number, path in islice(enumerate(self.paths), first, end):
            index = int(path.stem) if self.session is not None else number
            raw = RawFrame(read_picture(path), index)
            pair = self.pipeline.split(raw)
            left = self.pipeline.rectifier.left_picture(pair)
            found = ExportFrame.of(
                index, raw.timestamp_us * _NS_PER_US, self.pipeline.disparity(pair), left, geometries
            )
            yield MeasuringFrame(found, raw, self.session.truth(index) if self.session and self.true else None)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """Frames of an MCAP recording, as the camera matched them."""

    path: Path
    true: bool = False

    def frames(self, first: int = 0, end: int | None = None) -> Iterator[MeasuringFrame]:
        """Read the frames that are asked for, one at a time."""
        source = RecordingSource(self.path)
        try:
            for found in source.frames(first, end):
                yield MeasuringFrame(found)
        finally:
            source.close()


def open_frames(
    source: Path,
    calibration: Path | None,
    matcher: Matcher | None = None,
    filters: FilterChain | None = None,
    wish: RangeWish | None = None,
) -> TakenFrames | RecordedFrames:
    """Open a session folder, pictures (a file, a folder, a pattern) or an MCAP recording.

    A session has its own calibration unless another is given, pictures need one, a recording brings its own. `UsageError` for
    what does not go together, `CalibrationError` for a calibration of another rig.
    """
    if source.suffix.lower() == ".mcap":
        if calibration is not None or matcher is not None or filters is not None or wish is not None:
            raise UsageError(
                f"{source} holds what the camera matched, and its calibration: leave --calibration, --range-mm and the options "
                "of matching out"
            )
        return RecordedFrames(source)
    session = Session.open(source) if (source / "session.toml").is_file() else None
    path = calibration or (session.calibration_path if session else None)
    if path is None:
        raise UsageError(f"{source} brings no calibration.json: give the unit's with --calibration FILE")
    made = read(path)
    _require_rig(session, made, path)
    pictures = tuple(session.paths("video")) if session else tuple(expand([source]))
    return TakenFrames(pictures, Pipeline(made, matcher, wish=wish, filters=filters), session)


def _require_rig(session: Session | None, made: Calibration, path: Path) -> None:
    if session is not None and session.info.rig != made.rig:
        raise CalibrationError(
            f"{path} is a calibration of {made.rig!r}, but the session was taken with {session.info.rig!r}: give the "
            "calibration of the same rig"
        )
