"""Where frames come from: a session folder, matched anew, or a recording, as it was received."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.export.pairing import Paired, Pairing
from prismstereo_device.protocol import FrameAssembler, PictureAssembler, ReceivedFrame
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DataError, UsageError

if TYPE_CHECKING:
    from prismstereo.recording.stored_packet import StoredPacket
    from prismstereo_device.filters import FilterChain
    from prismstereo_device.match import Matcher

__all__ = ["FrameSource", "RecordingSource", "SessionSource"]

_NS_PER_US = 1000


class FrameSource(Protocol):
    """Frames in their order."""

    @property
    def count(self) -> int | None:
        """How many frames there are; None where only reading them all tells."""
        ...

    def frames(self, first: int = 0, end: int | None = None) -> Iterator[ExportFrame]:
        """Give frames number `first`, counted from 0, up to the one before `end`."""
        ...

    def close(self) -> None:
        """Let go of the source."""
        ...


class SessionSource:
    """A session folder whose raw frames are matched now, by the calibration in the folder unless another is given."""

    def __init__(
        self,
        folder: Path,
        calibration: Path | None = None,
        matcher: Matcher | None = None,
        filters: FilterChain | None = None,
    ) -> None:
        from prismstereo_calibration.store import read
        from prismstereo_device.pipeline import Pipeline
        from prismstereo_hw.session import Session

        self._session = Session.open(folder)
        path = calibration or self._session.calibration_path
        if path is None:
            raise UsageError(f"{folder} holds no calibration.json: give the unit's with --calibration FILE")
        self._calibration = read(path)
        if self._calibration.rig != self._session.info.rig:
            raise UsageError(
                f"{path} is a calibration of {self._calibration.rig!r}, but the session was taken with "
                f"{self._session.info.rig!r}: give one of the same rig"
            )
        self._pipeline = Pipeline(self._calibration, matcher, filters=filters)

    @property
    def count(self) -> int:
        """How many video frames there are."""
        return len(self._session.paths("video"))

    def frames(self, first: int = 0, end: int | None = None) -> Iterator[ExportFrame]:
        """Match the frames that are asked for, one at a time; stamps are of the camera's own clock."""
        geometries = Geometries(self._calibration)
        for raw in islice(self._session.frames("video"), first, end):
            pair = self._pipeline.split(raw)
            left = self._pipeline.rectifier.left_picture(pair)
            found = self._pipeline.disparity(pair)
            yield ExportFrame.of(raw.index, raw.timestamp_us * _NS_PER_US, found, left, geometries)

    def close(self) -> None:
        """Do nothing: pictures are opened one at a time."""


class RecordingSource:
    """An MCAP recording: the packets that it holds are put together as the driver does it, one session after the other.

    Frames are stamped by the wall clock: that of their session's first frame's arrival, and from there on as the camera's own
    clock goes. DataError for a file that is no recording.
    """

    def __init__(self, path: Path) -> None:
        from prismstereo.recording import Recording

        self._recording = Recording(path)
        self._held: dict[bytes, Geometries] = {}

    @property
    def count(self) -> None:
        """Only reading it all tells how many frames a recording holds."""
        return None

    def frames(self, first: int = 0, end: int | None = None) -> Iterator[ExportFrame]:
        """Give the frames that are asked for, each with its preview picture if that was recorded."""
        for (frame, left), ahead_ns in islice(self._stamped(), first, end):
            stamp_ns = frame.timestamp_us * _NS_PER_US + ahead_ns
            yield ExportFrame.of(frame.index, stamp_ns, frame.disparity, left, self._geometries(frame))

    def close(self) -> None:
        """Give the file back."""
        self._recording.close()

    def _stamped(self) -> Iterator[tuple[Paired, int]]:
        """Give frames, and by how much the wall clock was ahead of the camera's when the first of their session came."""
        from prismstereo.recording.stored_packet import StoredPacket

        joining, session = _Joining(), None
        for wall_ns, entry in self._recording.entries():
            if not isinstance(entry, StoredPacket):
                continue
            if entry.session != session:
                yield from joining.end()
                joining, session = _Joining(), entry.session
            yield from joining.feed(entry, wall_ns)
        yield from joining.end()

    def _geometries(self, frame: ReceivedFrame) -> Geometries:
        named = frame.calibration_hash
        if named not in self._held:
            from prismstereo_calibration import flash

            content = self._recording.calibration(named)
            if content is None:
                raise DataError(
                    f"frame {frame.index} was made with calibration {named.hex()}, which the recording does not hold: without "
                    "it nothing is known of depth; leave the frame out with --frames A:B"
                )
            self._held[named] = Geometries(flash.unpack(content))
        return self._held[named]


class _Joining:
    """Puts the packets of one recorded session together."""

    def __init__(self) -> None:
        self._frames = FrameAssembler()
        self._pictures = PictureAssembler()
        self._pairing = Pairing()
        self._ahead_ns: int | None = None

    def feed(self, stored: StoredPacket, wall_ns: int) -> Iterator[tuple[Paired, int]]:
        """Take a packet and give the frames that are complete with it."""
        if stored.packet.channel == Channel.DISP:
            self._take(self._frames.feed(stored.packet), wall_ns)
        elif stored.packet.channel == Channel.IMG:
            for picture in self._pictures.feed(stored.packet):
                self._pairing.picture(picture)
        for paired in self._pairing.ready():
            yield paired, self._ahead_ns or 0

    def end(self) -> Iterator[tuple[Paired, int]]:
        """Give the frames that wait; one that the recording cuts in its middle is left out, as a live one would be."""
        for paired in self._pairing.ready(late=0):
            yield paired, self._ahead_ns or 0

    def _take(self, frames: list[ReceivedFrame], wall_ns: int) -> None:
        for frame in frames:
            if self._ahead_ns is None:
                self._ahead_ns = wall_ns - frame.timestamp_us * _NS_PER_US
            self._pairing.frame(frame)
