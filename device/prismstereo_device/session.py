"""One host's session as the camera keeps it: how to encode for it, whether it is still there, what it has room for."""

from __future__ import annotations

from collections import deque
from threading import Lock

from prismstereo_device.framing import Framer
from prismstereo_device.protocol import FrameAck
from prismstereo_device.wire import LIMITS

__all__ = ["Session"]

_ALIVE_S = 3.0
_FORGIVE_S = 1.0  # after so long with no answer to the last frame, it counts as lost and not as waiting


class Session:
    """The session with this nonce; 0 is *nobody yet*, never alive. Times are seconds of one monotonic clock."""

    def __init__(self, nonce: int, now_s: float) -> None:
        self.nonce = nonce
        self.framer = Framer(nonce)
        self._heard_at_s = now_s
        self._written_at_s = now_s
        self._in_flight: deque[int] = deque()
        self._room = LIMITS.frames_unacknowledged
        self._lock = Lock()

    def hear(self, now_s: float) -> None:
        """Note that a valid packet of this session came in."""
        self._heard_at_s = now_s

    def alive(self, now_s: float) -> bool:
        """Whether the host was heard in the last 3 s."""
        return self.nonce != 0 and now_s - self._heard_at_s < _ALIVE_S

    def begin_frame(self, frame: int) -> None:
        """Note that this frame goes out now."""
        with self._lock:
            self._in_flight.append(frame)

    def end_frame(self, now_s: float) -> None:
        """Note that the frame's last byte was handed over."""
        self._written_at_s = now_s

    def acknowledge(self, ack: FrameAck) -> None:
        """Take the host's word: every frame up to the newest started one is off the line."""
        with self._lock:
            self._room = ack.room
            if ack.newest_frame in self._in_flight:
                while self._in_flight.popleft() != ack.newest_frame:
                    pass

    def may_stream(self, now_s: float) -> bool:
        """Whether another frame may go out: the host is there, has room, and does not lag by more than 3 frames."""
        with self._lock:
            if not self.alive(now_s) or self._room == 0:
                return False
            if len(self._in_flight) < min(self._room, LIMITS.frames_unacknowledged):
                return True
            heard_since_s = self._heard_at_s - self._written_at_s
            if now_s - self._written_at_s < _FORGIVE_S or heard_since_s < _FORGIVE_S / 2:
                return False
            self._in_flight.clear()  # the host is there and has not seen them: they were lost on the line
            return True
