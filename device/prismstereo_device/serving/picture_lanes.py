"""Pictures on their way out: preview, raw frames, reasons, confidence. Of each kind the newest waits; one goes out at a time.

A picture is compressed when its turn has come and not before, in a thread of its own, so that neither frames nor answers
wait for a megabyte of PNG.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.protocol.picture import picture_fragments
from prismstereo_device.protocol.picture_head import PictureKind
from prismstereo_device.serving.frame_lane import Part
from prismstereo_device.serving.session import Session
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import LAST, WireError

__all__ = ["PictureLanes"]

logger = logging.getLogger(__name__)

_FRAME = 0xFFFF_FFFF
_JOIN_S = 5.0


@dataclass(frozen=True, slots=True)
class _Picture:
    """A picture that waits, and the frame that it belongs to."""

    kind: PictureKind
    frame: ProducedFrame
    pixels: NDArray[np.uint8]


@dataclass(slots=True)
class _Going:
    """A picture that is compressed, or whose packets go out."""

    session: Session
    picture: _Picture
    parts: Iterator[Part] | None = None  # None: it is being compressed
    failed: bool = False
    ended: bool = False


class PictureLanes:
    """Of each kind the newest picture wins: one that waits is replaced by the next, one that has begun is finished.

    What is replaced, or cut short by the end of its session, is counted; with `lossless` what is cut is sent again. `wake` is
    called, in another thread, when a picture is compressed. One thread puts pictures in, another takes packets out.
    """

    def __init__(self, mtu: int, wake: Callable[[], None], *, lossless: bool) -> None:
        self._mtu = mtu
        self._wake = wake
        self._lossless = lossless
        self._lock = threading.Lock()
        self._waiting: dict[PictureKind, _Picture] = {}  # the one that waits longest comes first
        self._going: _Going | None = None
        self._to_compress: queue.SimpleQueue[_Going | None] = queue.SimpleQueue()
        self._compressor: threading.Thread | None = None
        self.dropped = 0

    def put(self, frame: ProducedFrame) -> None:
        """Take the pictures of the newest frame."""
        with self._lock:
            for picture in _pictures_of(frame):
                self.dropped += self._waiting.get(picture.kind) is not None
                self._waiting[picture.kind] = picture

    @property
    def idle(self) -> bool:
        """Whether nothing waits, is compressed, or is going out."""
        return not self._waiting and self._going is None

    def wants(self, session: Session, now_s: float) -> bool:
        """Whether a packet can be sent, or a picture be begun; what belongs to another session, or a dead one, is cut."""
        going = self._going
        if going is not None:
            if going.failed:
                self._going = None
                self.dropped += 1
            elif going.parts is None:
                return False
            elif going.session is session and session.alive(now_s):
                return True
            else:
                self.cut()
        return bool(self._waiting) and session.listening(now_s)

    def packet(self, session: Session) -> bytes | None:
        """Give the next packet's bytes, or None where a picture has only now been begun; only after `wants`."""
        going = self._going
        if going is None or going.parts is None:
            self._begin(session)
            return None
        flags, index, payload = next(going.parts)
        going.ended = bool(flags & LAST)
        return session.framer.encode(
            going.picture.kind.channel, payload, flags=flags, msg=going.picture.frame.index, frag=index
        )

    def written(self) -> None:
        """Note that the last packet given is out."""
        if self._going is not None and self._going.ended:
            self._going = None

    def cut(self) -> None:
        """Give up the picture that is going out: its session is over."""
        going, self._going = self._going, None
        if going is None:
            return
        with self._lock:
            if self._lossless and going.picture.kind not in self._waiting:
                self._waiting[going.picture.kind] = going.picture
            else:
                self.dropped += 1

    def close(self) -> None:
        """End the compressor's thread."""
        if self._compressor is not None:
            self._to_compress.put(None)
            self._compressor.join(_JOIN_S)

    def _begin(self, session: Session) -> None:
        with self._lock:
            picture = self._waiting.pop(next(iter(self._waiting)))
        self._going = _Going(session, picture)
        if self._compressor is None:
            self._compressor = threading.Thread(target=self._compress, name="prismstereo-pictures", daemon=True)
            self._compressor.start()
        self._to_compress.put(self._going)

    def _compress(self) -> None:
        while (going := self._to_compress.get()) is not None:
            try:
                parts = _parts(going.picture, going.session.video_mtu(self._mtu))
                going.parts = chain([next(parts)], parts)  # it is the first part that takes the time
            except WireError as error:
                logger.warning("a picture cannot be sent: %s", error)
                going.failed = True
            self._wake()


def _pictures_of(frame: ProducedFrame) -> Iterator[_Picture]:
    disparity = frame.disparity
    planes = {
        PictureKind.PREVIEW: frame.preview,
        PictureKind.REASONS: None if disparity is None else disparity.reasons,
        PictureKind.CONFIDENCE: None if disparity is None else disparity.confidence,
        PictureKind.RAW: frame.raw,
    }
    return (_Picture(kind, frame, pixels) for kind, pixels in planes.items() if pixels is not None)


def _parts(picture: _Picture, mtu: int) -> Iterator[Part]:
    return picture_fragments(
        picture.pixels,
        kind=picture.kind,
        frame=picture.frame.index & _FRAME,
        timestamp_us=picture.frame.timestamp_us,
        lens_position=picture.frame.lens_position,
        mtu=mtu,
    )
