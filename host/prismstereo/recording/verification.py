"""Is a recording still what was recorded, and does it replay bit by bit? Every packet, every frame, and the file as a whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from prismstereo.driver import CameraStatistics
from prismstereo.recording.chunk import Damage
from prismstereo.recording.notes import EventNote
from prismstereo.recording.recording import Recording
from prismstereo.recording.replaying import replay
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_device.protocol import FrameAssembler, ReceivedFrame
from prismstereo_device.wire import FIRST, Channel

__all__ = ["Verification", "verify"]


@dataclass(frozen=True, slots=True)
class Verification:
    """What a replay of the whole recording gave.

    `identical` of its `frames` have the disparity, bit by bit, that their packets give without a line between; `partial` lack
    stripes, `lost` never arrived. `dropped` packets the disk was too slow for. `pictures` are raw frames, `sum_is_right` is the
    file's own check sum (None: it was cut). `whole` says that nothing of all this is wrong.
    """

    frames: int
    identical: int
    partial: int
    lost: int
    pictures: int
    packets: int
    dropped: int
    sessions: int
    events: tuple[EventNote, ...]
    damage: Damage
    sum_is_right: bool | None
    seconds: float
    finished: bool
    why_cut: str

    @property
    def whole(self) -> bool:
        """Whether what is there is undamaged and replays as it was; a file that was only cut is."""
        return not self.damage.any and self.sum_is_right is not False and self.identical == self.frames


class _Direct:
    """The frames of a recording with no line between, and what else is counted on the way."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.damage = Damage(notes=recording.damaged_texts + recording.outline.damaged)
        self.packets = self.pictures = 0
        self.sessions: set[int] = set()
        self.events: list[EventNote] = []

    def __iter__(self) -> Iterator[ReceivedFrame]:
        assembler, session = FrameAssembler(), 0
        for _, entry in self._recording.entries(self.damage):
            if isinstance(entry, EventNote):
                self.events.append(entry)
            if not isinstance(entry, StoredPacket):
                continue
            self.packets += 1
            self.pictures += entry.packet.channel == Channel.RAW and bool(entry.packet.flags & FIRST)
            if entry.session != session:
                yield from assembler.flush()
                assembler, session = FrameAssembler(), entry.session
                self.sessions.add(session)
            if entry.packet.channel == Channel.DISP:
                yield from assembler.feed(entry.packet)
        yield from assembler.flush()


def verify(path: str | Path) -> Verification:
    """Read and replay a whole recording; `RecordingError` where it is none."""
    with Recording(path) as recording:
        direct = _Direct(recording)
        identical, statistics = _replayed(path, iter(direct))
        return Verification(
            frames=statistics.frames,
            identical=identical,
            partial=statistics.partial,
            lost=statistics.lost,
            pictures=direct.pictures,
            packets=direct.packets,
            dropped=sum(event.count for event in direct.events),
            sessions=len(direct.sessions),
            events=tuple(direct.events),
            damage=direct.damage,
            sum_is_right=recording.sum_is_right(),
            seconds=recording.length_s,
            finished=recording.finished,
            why_cut=recording.why_cut,
        )


def _replayed(path: str | Path, due: Iterator[ReceivedFrame]) -> tuple[int, CameraStatistics]:
    identical = 0
    with replay(path, pace=None, keep_all=True) as camera:
        for frame in camera:
            expected = next(due, None)
            identical += expected is not None and _same(frame, expected)
        identical -= sum(1 for _ in due)  # frames that the replay did not show
        return identical, camera.statistics


def _same(one: ReceivedFrame, other: ReceivedFrame) -> bool:
    if (one.index, one.timestamp_us) != (other.index, other.timestamp_us):
        return False
    return one.disparity.disparity_px.tobytes() == other.disparity.disparity_px.tobytes()
