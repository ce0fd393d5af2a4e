"""The shelf: every object that a host may read or write, and what keeps each of them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from threading import Lock
from typing import Protocol

from prismstereo_device.objects import Held, ObjectNumber, Progress, WriteStatus
from prismstereo_device.state.calibration_slots import CalibrationSlots
from prismstereo_device.state.disk import StorageError
from prismstereo_device.state.staging import Staging
from prismstereo_device.wire import LIMITS

__all__ = ["Shelf", "UpdateTaker"]

_LIMITS = {ObjectNumber.CALIBRATION: LIMITS.calibration, ObjectNumber.UPDATE: LIMITS.object}
_SNAPSHOT_S = 30.0  # a log is read in parts: they have to belong together
_SNAPSHOT_IDLE_S = 1.0


class UpdateTaker(Protocol):
    """What looks at an uploaded update."""

    def take(self, name: str) -> str | None:
        """Check a staged file and move it away; give why not where it is refused. `OSError` when the disk fails."""
        ...


class Shelf:
    """Objects by number, for several threads at once. Reading never waits for a write that is under way.

    `accepts` gives None for flash bytes that may become the calibration, else why not; `changed` is told of every new active
    calibration. `made` are objects that are made when they are asked for. Without `updates` this camera takes none; nor does
    one whose disk does not persist.
    """

    def __init__(
        self,
        slots: CalibrationSlots,
        staging: Staging,
        *,
        accepts: Callable[[bytes], str | None],
        changed: Callable[[bytes], None] | None = None,
        made: Mapping[ObjectNumber, Callable[[], bytes]] | None = None,
        updates: UpdateTaker | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._slots, self._staging = slots, staging
        self._accepts, self._changed = accepts, changed
        self._made = dict(made or {})
        self._updates = updates
        self._clock_s = clock_s
        self._writing = Lock()
        self._showing = Lock()
        self._held: dict[int, Held] = {}
        self._log: tuple[float, float, Held] | None = None  # made at, last read at
        self._show_calibrations()

    @property
    def persistent(self) -> bool:
        """Whether what is written outlives this process."""
        return self._slots.persistent

    @property
    def calibration(self) -> bytes | None:
        """The active calibration's flash bytes; None while none was ever written."""
        held = self.read(ObjectNumber.CALIBRATION)
        return None if held is None else held.content

    def read(self, obj: int) -> Held | None:
        """Give an object; None where it is not there or may not be read."""
        if obj == ObjectNumber.LOG and ObjectNumber.LOG in self._made:
            return self._log_snapshot()
        for number, make in self._made.items():
            if obj == number:
                return _held(make())
        with self._showing:
            return self._held.get(obj)

    def put(self, obj: int, held: Held) -> None:
        """Show an object that this program makes, such as a still; what was there before is gone."""
        with self._showing:
            self._held[obj] = held

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Begin to write an object, or go on with what was begun; `Objects` says what comes back, here and below."""
        limit = _LIMITS.get(ObjectNumber(obj)) if obj in _LIMITS else None
        if limit is None or len(sha256) != hashlib.sha256().digest_size:
            return Progress(WriteStatus.NO_SUCH_OBJECT, why=f"object {obj} cannot be written")
        if obj == ObjectNumber.UPDATE and (self._updates is None or not self.persistent):
            lacking = "no update key is configured" if self._updates is None else "it has no state folder"
            return Progress(WriteStatus.NO_SUCH_OBJECT, why=f"this camera takes no updates: {lacking}")
        if not 0 < size <= limit:
            return Progress(WriteStatus.TOO_LARGE, why=f"{size} bytes: this object has 1 to {limit}")
        with self._writing:
            return self._staging.begin(obj, size, sha256)

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        """Take bytes of the write that is under way."""
        if obj not in _LIMITS:
            return Progress(WriteStatus.NO_SUCH_OBJECT, why=f"object {obj} cannot be written")
        with self._writing:
            return self._staging.write(obj, offset, data)

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Verify the whole and make it the object, or leave everything as it was."""
        takers = {ObjectNumber.CALIBRATION: self._take_calibration}
        if self._updates is not None:
            takers[ObjectNumber.UPDATE] = self._updates.take
        if obj not in takers:
            return Progress(WriteStatus.NO_SUCH_OBJECT, why=f"object {obj} cannot be written")
        with self._writing:
            return self._staging.commit(obj, size, sha256, takers[ObjectNumber(obj)])

    def restore_factory(self) -> Progress:
        """Make the factory calibration active again."""
        with self._writing:
            content = self._slots.factory
            if content is None:
                why = "there is no factory calibration: none was ever written to this camera"
                return Progress(WriteStatus.REFUSED, why=why)
            why_not = self._accepts(content)
            if why_not is not None:
                return Progress(WriteStatus.REFUSED, why=why_not)
            try:
                self._activate(content)
            except StorageError as error:
                return Progress(WriteStatus.NO_ROOM, why=str(error))
        return Progress(WriteStatus.OK, len(content))

    def _take_calibration(self, name: str) -> str | None:
        content = self._staging.content(name)
        why_not = self._accepts(content)
        if why_not is None:
            self._activate(content)
        return why_not

    def _activate(self, content: bytes) -> None:
        self._slots.write(content)
        self._show_calibrations()
        if self._changed is not None:
            self._changed(content)

    def _show_calibrations(self) -> None:
        contents = {
            ObjectNumber.CALIBRATION: self._slots.active,
            ObjectNumber.FACTORY_CALIBRATION: self._slots.factory,
        }
        with self._showing:
            for number, content in contents.items():
                if content is not None:
                    self._held[number] = _held(content)

    def _log_snapshot(self) -> Held:
        """Give the log as it was when reading began: it grows, and parts of two states make no log."""
        now_s = self._clock_s()
        with self._showing:
            if self._log is not None:
                made_s, read_s, held = self._log
                if now_s - made_s < _SNAPSHOT_S and now_s - read_s < _SNAPSHOT_IDLE_S:
                    self._log = (made_s, now_s, held)
                    return held
        held = _held(self._made[ObjectNumber.LOG]())
        with self._showing:
            self._log = (now_s, now_s, held)
        return held


def _held(content: bytes) -> Held:
    """Give a content its version: the start of its sha256, but never 0, which means *any version* on the wire."""
    return Held(int.from_bytes(hashlib.sha256(content).digest()[:4], "little") or 1, content)
