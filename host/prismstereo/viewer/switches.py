"""The camera's optional streams, on as long as somebody looks at them, and then as they were before."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator, Set
from contextlib import contextmanager

from prismstereo.driver import StereoCamera
from prismstereo_hw.errors import PrismStereoError

__all__ = ["SHOWN", "Switches"]

logger = logging.getLogger(__name__)

SHOWN = {
    "left": "preview",
    "raw": "raw",
    "pair": "raw",
    "why": "reasons",
}  # what a page shows, and the setting it needs


class Switches:
    """Turns streams of one camera on and off, if it is `able` to; its calls wait for the camera, one at a time."""

    def __init__(self, camera: StereoCamera, *, able: bool) -> None:
        self._camera, self._able = camera, able
        self._lock = threading.RLock()
        self._ours: set[str] = set()  # what was off before we came
        self._shown: frozenset[str] = frozenset()
        self._held: list[str] = []

    def show(self, shown: Set[str]) -> None:
        """Let the camera send what pages show, and nothing that was off before and that no page shows any more."""
        with self._lock:
            self._shown = frozenset(SHOWN[name] for name in shown if name in SHOWN)
            self._turn()

    def renew(self) -> None:
        """Turn on again what is shown: the camera has started anew and knows nothing of it."""
        with self._lock:
            self._ours.clear()
            self._turn()

    @contextmanager
    def during(self, name: str) -> Iterator[None]:
        """Keep a stream on meanwhile."""
        with self._lock:
            self._held.append(name)
            self._turn()
        try:
            yield
        finally:
            with self._lock:
                self._held.remove(name)
                self._turn()

    def _turn(self) -> None:
        if not self._able:
            return
        wished = self._shown | set(self._held)
        try:
            for name in sorted(wished - self._ours):
                if self._camera.get(name) is False:
                    self._camera.set(name, value=True)
                    self._ours.add(name)
            for name in sorted(self._ours - wished):
                self._ours.discard(name)
                self._camera.set(name, value=False)
        except PrismStereoError as error:
            logger.warning("a stream could not be switched: %s", error)
