"""The line to one sensor and the session on it: kept alive, called when it is silent, opened anew when it is gone.

Replug, reboot and a dead line end the same way: a hello. In a silence the *same* nonce is offered again: a device that is still
there answers and forgets nothing, a device that has started anew answers with another boot id, and gets a new session. Until
that answer no request goes out, for a device that forgot what it ran would run it a second time.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from prismstereo.events import CameraEvent, CameraState, EventKind
from prismstereo.listener import Listener
from prismstereo.meeting import CameraIdentity, Meeting, answer_to, meet, offer
from prismstereo_device.framing import Deframer, Framer, LineStatistics
from prismstereo_device.link import Link, LinkLost, PortError
from prismstereo_device.wire import FIRST, LAST, Channel
from prismstereo_hw.errors import DeviceError

__all__ = ["Connection", "ConnectionCounts"]

logger = logging.getLogger(__name__)

_POLL_S = 0.05
_BEAT_S = 0.1
_WRITE_S = 0.5
_SILENT_S = 0.5
_CALL_EVERY_S = 0.25
_MEET_S = 2.0
_FIRST_WAIT_S = 0.1
_LONGEST_WAIT_S = 1.0


@dataclass(frozen=True, slots=True)
class ConnectionCounts:
    """How many sessions there were, how often the device started anew, how often the port was opened again."""

    sessions: int = 1
    reboots: int = 0
    replugs: int = 0


class Connection:
    """A session with one sensor; owns its link, and opens it anew with `reopen` where that is given.

    Without `reopen` a lost link, a silence of `silence_s` or a device that starts anew is the end. Raises LinkLost when
    nothing answers at the beginning, DeviceError when the versions do not meet.
    """

    def __init__(self, link: Link, timeout_s: float, *, silence_s: float, reopen: Callable[[], Link] | None) -> None:
        self._link = link
        self._silence_s = silence_s
        self._reopen = reopen
        self._deframer = Deframer()
        meeting = meet(link, self._deframer, timeout_s)
        self._identity = meeting.identity
        self._nonce = meeting.nonce
        self._early = meeting.early
        self._framer: Framer | None = meeting.framer  # None: nothing may be sent now
        self._sending = threading.Lock()
        self._torn = False
        self._counts = ConnectionCounts()
        self._state = CameraState.CONNECTED
        self._heard_at_s = time.monotonic()
        self._doubted = False  # whether the device still knows this session
        self._call_at_s = 0.0
        self._stopping = threading.Event()
        self._beat_now = threading.Event()
        self._threads: list[threading.Thread] = []

    @property
    def name(self) -> str:
        """What a user calls the link: a path, or tcp:host:port."""
        return self._link.name

    @property
    def identity(self) -> CameraIdentity:
        """Who answered last."""
        return self._identity

    @property
    def state(self) -> CameraState:
        """How things stand."""
        return self._state

    @property
    def counts(self) -> ConnectionCounts:
        """The counters so far."""
        return self._counts

    @property
    def line(self) -> LineStatistics:
        """What came in over all sessions."""
        return self._deframer.statistics

    def start(self, listener: Listener) -> None:
        """Begin to read and to beat, in the background."""
        self._threads = [
            threading.Thread(target=work, args=(listener,), name=f"prismstereo-{work.__name__.strip('_')}", daemon=True)
            for work in (self._listen, self._beat)
        ]
        for thread in self._threads:
            thread.start()

    def wake(self) -> None:
        """Let the beat come now."""
        self._beat_now.set()

    def close(self) -> None:
        """End the session and give the port back; closing twice does no harm."""
        self._stopping.set()
        self._beat_now.set()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()
        self._state = CameraState.ENDED
        with self._sending:
            self._framer = None
            self._link.close()

    def send(self, channel: Channel, body: Callable[[], bytes], flags: int = 0, msg: int = 0) -> None:
        """Write one packet, its body made at the last moment; what there is no room for is said again later, or never."""
        with self._sending:
            self._write(channel, body(), flags, msg)

    def request(self, channel: Channel, payload: bytes, *, msg: int, session: int) -> bool:
        """Write a request if `session` is under way and certain; False: nothing of it was written."""
        with self._sending:
            if session != self._counts.sessions or self._doubted:
                return False
            return self._write(channel, payload, 0, msg)

    def _write(self, channel: Channel, payload: bytes, flags: int, msg: int) -> bool:
        """Write a packet; whether any of it may have arrived."""
        if self._framer is None:
            return False
        return self._put(self._framer.encode(channel, payload, flags=flags | FIRST | LAST, msg=msg))

    def _put(self, data: bytes) -> bool:
        if self._torn:
            data = b"\0" + data
        try:
            taken = self._link.write(data, _WRITE_S)
        except LinkLost:
            return True  # the reading side finds the same, after what is still there to read
        self._torn = 0 < taken < len(data) or (self._torn and taken == 0)
        return taken > 0

    def _beat(self, listener: Listener) -> None:
        """Keep the session on a clock of its own, so that it outlives any slow reader."""
        while not self._stopping.is_set():
            self._beat_now.clear()
            self._call_in_silence(listener)
            due_s = listener.beat(time.monotonic())
            self._beat_now.wait(min(_BEAT_S, max(0.001, due_s - time.monotonic())))

    def _call_in_silence(self, listener: Listener) -> None:
        now_s = time.monotonic()
        silent = False
        with self._sending:
            if self._framer is None or (now_s - self._heard_at_s <= _SILENT_S and not self._doubted):
                return
            if not self._doubted:
                self._doubted = silent = True
                self._state = CameraState.SILENT
            if now_s >= self._call_at_s:
                self._call_at_s = now_s + _CALL_EVERY_S
                self._put(offer(self._framer, self._nonce))
        if silent:
            self._tell(listener, EventKind.SILENT, f"nothing was heard from {self.name} for {_SILENT_S:g} s")

    def _listen(self, listener: Listener) -> None:
        try:
            early, self._early = self._early, ()
            for packet in early:
                listener.hear(packet, _clock_us())
            while not self._stopping.is_set():
                try:
                    self._read(listener)
                except LinkLost as error:
                    if self._stopping.is_set():
                        return
                    if self._reopen is None:
                        raise
                    self._search(listener, self._reopen, error)
        except DeviceError as error:
            self._state = CameraState.ENDED
            self._stopping.set()
            self._beat_now.set()
            listener.lose(error)
            self._tell(listener, EventKind.ENDED, str(error))

    def _read(self, listener: Listener) -> None:
        packets = self._deframer.feed(self._link.read(_POLL_S))
        heard_us, now_s = _clock_us(), time.monotonic()
        for packet in packets:
            if packet.channel == Channel.HELLO:
                identity = answer_to(packet, self._nonce, self.name)
                if identity is None:
                    continue
                if identity.boot_id != self._identity.boot_id:
                    self._renew(listener)  # what follows in `packets` is of a session that is over
                    return
                self._confirm(listener, identity)
            else:
                listener.hear(packet, heard_us)
            self._heard_at_s = now_s
        if not packets and now_s - self._heard_at_s > self._silence_s:
            raise LinkLost(f"nothing was heard for {self._silence_s:g} s")

    def _confirm(self, listener: Listener, identity: CameraIdentity) -> None:
        """Go on in the session that the device still knows."""
        self._identity = identity
        with self._sending:
            doubted, self._doubted = self._doubted, False
        if doubted:
            self._state = CameraState.CONNECTED
            self._tell(listener, EventKind.HEARD, f"the sensor on {self.name} is there, in the same session")
            self._beat_now.set()

    def _renew(self, listener: Listener) -> None:
        """Meet a device anew that has forgotten the session; raises LinkLost where that does not succeed."""
        if self._reopen is None:
            raise LinkLost("it has started anew, and its session is gone")
        self._mute(listener, f"the sensor on {self.name} has started anew")
        self._adopt(listener, meet(self._link, self._deframer, _MEET_S, self._stopping), replugged=False)

    def _search(self, listener: Listener, reopen: Callable[[], Link], why: LinkLost) -> None:
        """Open the port again and meet whoever is there, until that succeeds or the camera is closed."""
        self._mute(listener, f"the sensor on {self.name} is gone, and searched for: {why}")
        wait_s = _FIRST_WAIT_S / 2
        while not self._stopping.wait(wait_s):
            wait_s = min(max(2 * wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S)
            with self._sending:
                self._link.close()
            try:
                link = reopen()
            except PortError:
                continue
            with self._sending:
                self._link, self._torn = link, False
            self._deframer.feed(b"\0")  # what the old line left half said
            try:
                meeting = meet(link, self._deframer, _MEET_S, self._stopping)
            except LinkLost:
                continue
            self._adopt(listener, meeting, replugged=True)
            return

    def _mute(self, listener: Listener, text: str) -> None:
        with self._sending:
            if self._framer is None:
                return  # searched for already
            self._framer = None
        self._state = CameraState.SEARCHING
        self._tell(listener, EventKind.LOST, text)

    def _adopt(self, listener: Listener, meeting: Meeting, *, replugged: bool) -> None:
        """Go on in a new session."""
        old, new = self._identity, meeting.identity
        if new.device_id != old.device_id:
            raise DeviceError(
                f"{self.name} now has the sensor {new.device_id.hex()}, it was {old.device_id.hex()}: "
                "open it anew, for it has another calibration and another clock"
            )
        same_boot = new.boot_id == old.boot_id
        counts = self._counts
        self._identity, self._nonce = new, meeting.nonce
        with self._sending:
            self._counts = ConnectionCounts(
                counts.sessions + 1, counts.reboots + (not same_boot), counts.replugs + replugged
            )
            self._doubted = False
        listener.begin_session(self._counts.sessions, same_boot=same_boot)
        self._heard_at_s = time.monotonic()
        self._state = CameraState.CONNECTED
        with self._sending:
            self._framer = meeting.framer
        kind = (
            EventKind.REPLUGGED if same_boot and replugged else EventKind.RENEWED if same_boot else EventKind.REBOOTED
        )
        self._tell(listener, kind, f"session {self._counts.sessions} with the sensor on {self.name}")
        for packet in meeting.early:
            listener.hear(packet, _clock_us())
        self._beat_now.set()

    def _tell(self, listener: Listener, kind: EventKind, text: str) -> None:
        logger.info("%s", text)
        listener.tell(CameraEvent(kind, self._counts.sessions, _clock_us(), text))


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
