"""What arrives beside the disparity of a frame, kept until the frame is asked for it: preview, reasons, confidence, zones."""

from __future__ import annotations

import time
from collections import OrderedDict
from threading import Condition

from prismstereo_device.protocol import ReceivedPicture
from prismstereo_device.wire import Channel
from prismstereo_device.zones import ZoneDistances

__all__ = ["FramePictures"]

_FRAME = 0xFFFF_FFFF
_HALF_RANGE = 1 << 31

Key = tuple[int, int]  # session, frame index modulo 2^32


class FramePictures:
    """The newest `kept` of each channel, by session and frame; one thread puts them in, any thread asks.

    Each kind of picture has its channel (`PictureKind.channel`), and zones have theirs.
    """

    def __init__(self, kept: int = 8) -> None:
        self._kept = kept
        self._changed = Condition()
        self._pictures: dict[Channel, OrderedDict[Key, ReceivedPicture]] = {}
        self._zones: OrderedDict[Key, ZoneDistances] = OrderedDict()
        self._newest: dict[Channel, Key] = {}

    def put(self, session: int, picture: ReceivedPicture) -> None:
        """Keep a picture."""
        channel, key = picture.head.kind.channel, (session, picture.head.frame)
        with self._changed:
            held = self._pictures.setdefault(channel, OrderedDict())
            held[key] = picture
            while len(held) > self._kept:
                held.popitem(last=False)
            self._newest[channel] = key
            self._changed.notify_all()

    def put_zones(self, session: int, zones: ZoneDistances) -> None:
        """Keep a frame's zones."""
        key = session, zones.index & _FRAME
        with self._changed:
            self._zones[key] = zones
            while len(self._zones) > self._kept:
                self._zones.popitem(last=False)
            self._newest[Channel.ZONES] = key
            self._changed.notify_all()

    def picture(self, channel: Channel, session: int, index: int, timeout_s: float = 0.0) -> ReceivedPicture | None:
        """Wait for a frame's picture; None when the time is over, or as soon as that of a later frame has come."""
        key = session, index & _FRAME
        self._wait(channel, key, timeout_s)
        return self._pictures.get(channel, OrderedDict()).get(key)

    def zones(self, session: int, index: int, timeout_s: float = 0.0) -> ZoneDistances | None:
        """Wait for a frame's zones; None as for pictures."""
        key = session, index & _FRAME
        self._wait(Channel.ZONES, key, timeout_s)
        return self._zones.get(key)

    def _wait(self, channel: Channel, key: Key, timeout_s: float) -> None:
        until_s = time.monotonic() + timeout_s
        with self._changed:
            while not self._came(channel, key) and (left_s := until_s - time.monotonic()) > 0:
                self._changed.wait(left_s)

    def _came(self, channel: Channel, key: Key) -> bool:
        """Tell whether the wished one, or a later one, has come."""
        newest = self._newest.get(channel)
        if newest is None or newest[0] < key[0]:
            return False
        return newest[0] > key[0] or (newest[1] - key[1]) & _FRAME < _HALF_RANGE
