"""One host's session as the camera keeps it: how to encode for it, whether it is still there, what it has room for."""

from __future__ import annotations

from collections import deque
from threading import Lock

from prismstereo_device.framing import Framer
from prismstereo_device.protocol.answered import AnsweredRequests
from prismstereo_device.protocol.control import FrameAck
from prismstereo_device.wire import LIMITS

__all__ = ["Session"]

_ALIVE_S = 3.0
_FORGIVE_S = 0.3  # after so long with no answer to the last frame, it counts as lost and not as waiting
_LOSSY_PERMILLE = 1  # above it, what a whole frame hangs on is sent twice
_BAD_PERMILLE = 50  # above it, short packets carry more than long ones
_SHORT_MTU = 240


class Session:
    """The session with this nonce; 0 is *nobody yet*, never alive. Times are seconds of one monotonic clock.

    `compact` says that the host reads codec 2. `commands` and `bulk` remember the requests of this session alone.
    """

    def __init__(self, nonce: int, now_s: float, *, compact: bool = True) -> None:
        self.nonce = nonce
        self.compact = compact
        self.framer = Framer(nonce)
        self.commands = AnsweredRequests()
        self.bulk = AnsweredRequests()
        self._heard_at_s = now_s
        self._written_at_s = now_s
        self._in_flight: deque[int] = deque()
        self._room = LIMITS.frames_unacknowledged
        self._loss_permille = 0
        self._lock = Lock()

    def hear(self, now_s: float) -> None:
        """Note that a valid packet of this session came in."""
        self._heard_at_s = now_s

    def alive(self, now_s: float) -> bool:
        """Whether the host was heard in the last 3 s."""
        return self.nonce != 0 and now_s - self._heard_at_s < _ALIVE_S

    def listening(self, now_s: float) -> bool:
        """Whether the host is there and has not asked to wait."""
        return self.alive(now_s) and self._room > 0

    @property
    def lossy(self) -> bool:
        """Whether so many packets are lost that the head of a frame should be sent twice."""
        return self._loss_permille > _LOSSY_PERMILLE

    def video_mtu(self, mtu: int) -> int:
        """Give the payload of video packets in bytes: the link's, or a short one on a line that damages many packets."""
        return min(mtu, _SHORT_MTU) if self._loss_permille > _BAD_PERMILLE else mtu

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
            self._loss_permille = ack.loss_permille
            if ack.newest_frame in self._in_flight:
                while self._in_flight.popleft() != ack.newest_frame:
                    pass

    def may_stream(self, now_s: float) -> bool:
        """Whether another frame may go out: the host is there, has room, and does not lag by more than 3 frames."""
        with self._lock:
            if not self.listening(now_s):
                return False
            if len(self._in_flight) < min(self._room, LIMITS.frames_unacknowledged):
                return True
            heard_since_s = self._heard_at_s - self._written_at_s
            if now_s - self._written_at_s < _FORGIVE_S or heard_since_s < _FORGIVE_S / 2:
                return False
            self._in_flight.clear()  # the host is there and has not seen them: they were lost on the line
            return True
