"""What all browsers see together: one camera or one recording, and the state of things once a second."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from prismstereo.driver import StereoCamera
from prismstereo.events import CameraEvent, EventKind
from prismstereo.viewer.desk import Desk
from prismstereo.viewer.mailbox import Mailbox
from prismstereo.viewer.message import Kind, LazyMessage
from prismstereo.viewer.playback import Playback
from prismstereo.viewer.records import Records
from prismstereo.viewer.watch import Watch
from prismstereo_hw.errors import PrismStereoError, UsageError
from prismstereo_hw.rig import Rig

__all__ = ["Hub"]

logger = logging.getLogger(__name__)

_STATUS_S = 1.0
_MOST_CLIENTS = 16
_NEW_SESSIONS = (EventKind.REBOOTED, EventKind.REPLUGGED, EventKind.RENEWED)


class Hub:
    """Watches what `open_live` opens, or a recording, for up to 16 browsers; owns the camera, and closes it.

    `target` is what people call the live camera. With `playback` it begins with a recording and there is no live camera.
    """

    def __init__(
        self,
        open_live: Callable[[], StereoCamera],
        target: str,
        records: Records,
        *,
        playback: Playback | None = None,
        rig: Rig | None = None,
    ) -> None:
        self._open_live, self.target, self.records, self._rig = open_live, target, records, rig
        self._only_recording = self._replaying = playback is not None
        self._clients: tuple[Mailbox, ...] = ()
        self._joining = threading.Lock()
        self._swapping = threading.Lock()
        self._latest: dict[Kind, LazyMessage] = {}
        self._geometry = _word("geometry", None)
        self._closing = threading.Event()
        self._chores = ThreadPoolExecutor(1, "prismstereo-chores")
        self.desk = self._begin(playback)
        self._ticker = threading.Thread(target=self._tick, name="prismstereo-status", daemon=True)
        self._ticker.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop a recording in good order, and let go of the camera."""
        self._closing.set()
        self._ticker.join()
        self._chores.shutdown(cancel_futures=True)
        with self._swapping:
            self.desk.close()

    # ---- browsers

    def join(self, wake: Callable[[], None]) -> Mailbox | None:
        """Let a browser watch from now on; None where there are too many already."""
        mailbox = Mailbox(wake)
        with self._joining:
            if len(self._clients) >= _MOST_CLIENTS:
                return None
            self._clients = (*self._clients, mailbox)
            mailbox.tell(self._geometry)
            latest = dict(self._latest)
        for kind, message in latest.items():
            mailbox.put(kind, message)
        return mailbox

    def leave(self, mailbox: Mailbox) -> None:
        """Hear that a browser is gone."""
        with self._joining:
            self._clients = tuple(one for one in self._clients if one is not mailbox)
        self.look()

    def look(self) -> None:
        """See what pages show, and let the camera send that; in the background."""
        shown = frozenset().union(*(client.shown for client in self._clients))
        if not self._closing.is_set():
            self._chores.submit(lambda: self.desk.switches.show(shown))

    def post(self, kind: Kind, message: LazyMessage) -> None:
        """Take the newest message of a kind, for every browser."""
        self._latest[kind] = message
        for client in self._clients:
            client.put(kind, message)

    def tell(self, kind: str, what: object) -> None:
        """Take a word, for every browser."""
        word = _word(kind, what)
        with self._joining:
            if kind == "geometry":
                self._geometry = word
            clients = self._clients
        for client in clients:
            client.tell(word)

    # ---- what is watched

    def play(self, name: str, position_s: float = 0.0) -> None:
        """Show a recording of the folder, or another moment of the one that is shown; `UsageError` for a name not there."""
        current = self.desk.playback
        if current is not None and name == current.name:
            current.move(position_s)
            return
        self._swap(lambda: _opened(self.records.recording(name), position_s))

    def pause(self, *, on: bool) -> None:
        """Let the recording that is shown stand still, or go on; `UsageError` where there is none."""
        if self.desk.playback is None:
            raise UsageError("this is the camera itself: only a recording can be paused")
        self.desk.playback.pause(on=on)

    def go_live(self) -> None:
        """Show the camera again."""
        if self._only_recording:
            raise UsageError("this viewer was opened on a recording: there is no camera to go back to")
        if self.desk.playback is not None:
            self._swap(lambda: None)

    def _swap(self, make: Callable[[], Playback | None]) -> None:
        """Watch something else; what cannot be opened leaves everything as it was."""
        with self._swapping:
            if self.desk.tape is not None:
                raise UsageError("a recording is being made: stop it first")
            playback, before = make(), self.desk.playback
            self.desk.close()
            self._latest.clear()
            try:
                self.desk = self._begin(playback)
            except PrismStereoError:
                self.desk = self._begin(None if before is None else before.again())
                raise
        self.look()

    def _begin(self, playback: Playback | None) -> Desk:
        camera = self._open_live() if playback is None else playback.open()
        self._replaying = playback is not None
        self.tell("geometry", None)
        desk = Desk(camera, Watch(camera, self), self.records, playback=playback, rig=self._rig)
        camera.on_event.append(self._hear)
        return desk

    def _hear(self, event: CameraEvent) -> None:
        """Pass on what happened to the connection; called by the reading thread, so nothing is asked here.

        A silence shows in the state of things; a recording that is moved seems to start anew, and nobody has to hear of it.
        """
        if event.kind not in (EventKind.SILENT, EventKind.HEARD) and not self._replaying:
            self.tell("note", event.text)
        if event.kind in _NEW_SESSIONS and not self._closing.is_set():
            self._chores.submit(self._renew)

    def _renew(self) -> None:
        self.desk.switches.renew()

    def _tick(self) -> None:
        while not self._closing.wait(_STATUS_S):
            desk, clients = self.desk, self._clients
            if not clients:
                continue
            desk.look_now_and_then(self._chores)
            told = desk.status() | {
                "target": self.target,
                "clients": len(clients),
                "can_go_live": not self._only_recording,
            }
            for client in clients:
                own = {"delay_ms": client.delay_ms, "sent": client.sent, "skipped": client.skipped}
                client.tell_status(_word("status", told | {"page": own}))


def _opened(path: Path, position_s: float) -> Playback:
    playback = Playback(path)
    if position_s:
        playback.move(position_s)
    return playback


def _word(kind: str, what: object) -> str:
    return msgspec.json.encode({"type": kind, "what": what}).decode()
