"""Recording a camera: every packet as it came, made safe every second, ended in good order whatever happens.

Three threads have a part in it. The one that reads the line only puts packets into a bounded queue; one writes; one fetches a
calibration that has changed meanwhile. A disk that cannot keep up costs packets, which are counted, and never the stream.
"""

from __future__ import annotations

import logging
import platform
import threading
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from prismstereo import __version__
from prismstereo.events import CameraEvent, EventKind
from prismstereo.recording.errors import RecordingError
from prismstereo.recording.journal import Journal
from prismstereo.recording.notes import EventNote, SessionNote
from prismstereo.recording.origin import objects_of, readable, rig_of, session_note
from prismstereo.recording.output import Output
from prismstereo.recording.place import RecordingFolder
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo.recording.waiting import Waiting
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import DisparityHead, calibration_hash
from prismstereo_device.wire import FIRST, Channel, WireError
from prismstereo_hw.errors import DataError, DeviceError, UsageError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera

__all__ = ["Recorder", "RecorderStatistics"]

logger = logging.getLogger(__name__)

SYNC_EVERY_S = 0.8  # with what the writing takes, a power cut so costs a second at most
_LEAST_FREE = 500_000_000  # what a large disk needs to go on ...
_LEAST_FREE_SHARE = 0.05  # ... and a small one
_QUEUE_BYTES = 64 << 20
_POLL_S = 0.1
_JOIN_S = 30.0
_LABEL = 200
_PER_PACKET = 100  # bytes of memory beside the payload
_NEW_SESSION = (EventKind.REPLUGGED, EventKind.REBOOTED, EventKind.RENEWED)
Thing = StoredPacket | EventNote | SessionNote | bytes


@dataclass(frozen=True, slots=True)
class RecorderStatistics:
    """What was written so far: `packets` of `sessions` in `seconds`; `dropped` ones found no room; `bytes` is the file."""

    packets: int
    dropped: int
    sessions: int
    bytes: int
    seconds: float


class Recorder:
    """Records a camera from now on into a new file in `folder`, until it is stopped; a context manager.

    Files have names of our own, see `path`; `label` is what a person wants to say, and stands inside. `views_hz` pictures a
    second are written for other tools, 0: none. It ends by itself, and says why in `reason`, when less than `least_free_bytes`
    are left (None: 5 % of the disk or 500 MB, whichever is less: the camera's own system has to go on), or when the disk
    fails. `output` is where to write instead of a file. Raises LinkLost, RecordingError or UsageError when it cannot begin.
    """

    def __init__(
        self,
        camera: StereoCamera,
        folder: str | Path,
        *,
        label: str = "",
        views_hz: float = 2.0,
        least_free_bytes: int | None = None,
        queue_bytes: int = _QUEUE_BYTES,
        output: Output | None = None,
    ) -> None:
        if not 0 <= views_hz <= 100 or len(label) > _LABEL or not label.isprintable():
            raise UsageError(
                f"views at {views_hz:g} Hz, a label of {len(label)} characters: 0 to 100, {_LABEL} printable"
            )
        self._camera = camera
        self._least_free_bytes = least_free_bytes
        self._waiting: Waiting[Thing] = Waiting(queue_bytes)
        calibration, details = objects_of(camera)
        self.path = Path(folder)
        if output is None:
            self.path, output = RecordingFolder(folder).create(camera.identity.device_id)
        self._known_hash = self._asked_hash = calibration_hash(calibration)[:4]
        self._packets = self._sessions = self._told_dropped = 0
        self._began_s = self._ended_s = time.monotonic()
        self._reason = ""
        self._ended = threading.Event()
        self._output = output
        camera.on_packet.append(self._hear)
        camera.on_event.append(self._tell)
        try:
            self._require_space()
            self._journal = Journal(output, views_hz)
            self._begin(calibration, details, label)
        except OSError as error:
            self._let_go()
            output.close()
            raise RecordingError(
                f"cannot write {self.path}: {error.strerror}: make room, or give another folder"
            ) from error
        except RecordingError:
            self._let_go()
            output.close()
            raise
        self._writer = threading.Thread(target=self._run, name="prismstereo-recorder", daemon=True)
        self._writer.start()

    @property
    def reason(self) -> str:
        """Why it ended by itself; empty while it runs, and where it was asked to end."""
        return self._reason

    @property
    def ended(self) -> bool:
        """Whether the file is closed."""
        return self._ended.is_set()

    @property
    def statistics(self) -> RecorderStatistics:
        """The counters so far."""
        until_s = self._ended_s if self.ended else time.monotonic()
        dropped, seconds = self._waiting.dropped, until_s - self._began_s
        return RecorderStatistics(self._packets, dropped, self._sessions, self._journal.size, seconds)

    def wait(self, timeout_s: float) -> bool:
        """Wait until it has ended by itself, or the time is over; whether it has ended."""
        return self._ended.wait(timeout_s)

    def stop(self) -> None:
        """Write what waits, end the file in good order and let the camera be; stopping twice does no harm."""
        self._let_go()
        self._waiting.close()
        self._writer.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _let_go(self) -> None:
        if self._hear in self._camera.on_packet:
            self._camera.on_packet.remove(self._hear)
        if self._tell in self._camera.on_event:
            self._camera.on_event.remove(self._tell)

    def _begin(self, calibration: bytes, details: dict[str, object], label: str) -> None:
        identity = self._camera.identity
        self._journal.describe(
            {
                "software": f"prismstereo {__version__}, Python {platform.python_version()}",
                "device_id": identity.device_id.hex(),
                "firmware": str(details.get("version", "")),
                "rig": rig_of(calibration),
                "label": label,
                "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
            }
        )
        if details:
            self._journal.identify(details)
        if calibration:
            self._journal.calibrate(calibration, readable(calibration))
        session = self._camera.statistics.sessions
        self._write(session_note(identity, session, _clock_us()))
        self._write(EventNote("recording", session, _clock_us(), "the recording begins"))
        self._journal.sync(self._camera.clock)

    def _hear(self, packet: Packet, heard_us: int, session: int) -> None:
        """Take a packet from the reading thread. Parts of objects are left out: objects are kept whole."""
        if packet.channel != Channel.BULK:
            self._waiting.put(StoredPacket(packet, heard_us, session), len(packet.payload) + _PER_PACKET)

    def _tell(self, event: CameraEvent) -> None:
        if event.kind in _NEW_SESSION:
            self._waiting.put(session_note(self._camera.identity, event.session, event.host_us), 0)
        self._waiting.put(EventNote(event.kind.value, event.session, event.host_us, event.text), 0)

    def _run(self) -> None:
        try:
            self._write_all()
            self._note_dropped()
        except OSError as error:
            self._reason = f"the disk of {self.path} failed: {error.strerror or error}"
        self._waiting.close()
        try:
            self._journal.finish()
        except OSError as error:
            self._journal.leave()
            why = f"the index of {self.path} could not be written ({error.strerror or error}): `prismstereo recover` makes one"
            self._reason = f"{self._reason}; {why}" if self._reason else why
        if self._reason:
            logger.warning("the recording has ended: %s", self._reason)
        self._ended_s = time.monotonic()
        self._ended.set()

    def _write_all(self) -> None:
        sync_s = time.monotonic() + SYNC_EVERY_S
        while True:
            things = self._waiting.take(max(0.0, min(_POLL_S, sync_s - time.monotonic())))
            for thing in things:
                self._write(thing)
                if time.monotonic() >= sync_s:
                    self._sync()
                    sync_s = time.monotonic() + SYNC_EVERY_S
            if self._reason or (not things and self._waiting.closed):
                return
            if time.monotonic() >= sync_s:
                self._sync()
                sync_s = time.monotonic() + SYNC_EVERY_S

    def _write(self, thing: Thing) -> None:
        match thing:
            case bytes():
                self._known_hash = calibration_hash(thing)[:4]
                self._journal.calibrate(thing, readable(thing))
                return
            case StoredPacket():
                self._packets += 1
                self._look_at(thing.packet)
            case SessionNote():
                self._sessions += 1
        self._journal.write(thing)

    def _sync(self) -> None:
        self._note_dropped()
        self._journal.sync(self._camera.clock)
        free, all_of_it = self._output.space()
        if free < self._least_free(all_of_it):
            self._reason = _too_little(self.path, free, self._least_free(all_of_it))

    def _note_dropped(self) -> None:
        dropped = self._waiting.dropped
        if dropped != self._told_dropped:
            count, self._told_dropped = dropped - self._told_dropped, dropped
            text = f"the disk was too slow for {count} packets"
            self._journal.write(EventNote("dropped", self._sessions, _clock_us(), text, count))

    def _least_free(self, all_of_it: int) -> float:
        if self._least_free_bytes is not None:
            return self._least_free_bytes
        return min(_LEAST_FREE, _LEAST_FREE_SHARE * all_of_it)

    def _require_space(self) -> None:
        free, all_of_it = self._output.space()
        if free < self._least_free(all_of_it):
            raise RecordingError(_too_little(self.path, free, self._least_free(all_of_it)))

    def _look_at(self, packet: Packet) -> None:
        """Fetch the calibration that a frame names, where it is another than so far, in a thread that may wait for it."""
        if packet.channel != Channel.DISP or not packet.flags & FIRST:
            return
        try:
            named = DisparityHead.unpack(packet.payload).calibration_hash
        except WireError:
            return
        if any(named) and named not in (self._known_hash, self._asked_hash):
            self._asked_hash = named
            threading.Thread(target=self._fetch, name="prismstereo-fetch", daemon=True).start()

    def _fetch(self) -> None:
        try:
            self._waiting.put(self._camera.calibration_bytes, 0)
        except (DataError, DeviceError) as error:
            self._asked_hash = self._known_hash  # the next frame asks again
            logger.warning("the calibration in use is not in the recording: %s", error)


def _too_little(path: Path, free: int, least: float) -> str:
    return (
        f"{free / 1e6:.0f} MB are left on the disk of {path}, and the last {least / 1e6:.0f} MB are not for recordings: "
        "make room, or record elsewhere"
    )


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
