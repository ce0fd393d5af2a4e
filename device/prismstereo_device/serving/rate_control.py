"""How fine the next frame may be, so that the line carries as many frames a second as there are.

Newest frame wins comes first: nothing ever queues. What does not fit is then coded within a bound of 1, 2, then 4 sixteenths
of a pixel, and at last at half the resolution. Steps towards coarser come at once, steps back when there is room to spare for a
while, and after one that turned out too bold the while is doubled.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import fmean, median

import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.codec import compact
from prismstereo_device.codec.compact import BOUNDS
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.decimate import Decimate
from prismstereo_device.filters.sheet import Sheet
from prismstereo_hw.errors import UsageError

__all__ = ["EXACT", "HALVED", "LADDER", "Mode", "RateControl", "halved", "warm_up"]

HALVED = 0x8000  # this bit of a frame's filter set: rate control halved its width and height

_BITS_PER_PIXEL = 1.5  # of an exact map, until one was measured
_SHARES = (1.0, 0.55, 0.40, 0.28, 0.07)  # bytes of each mode beside the exact one, until they were measured
_SHARE_OFF = 2.0  # by more than this a share does not differ from the known one: the scene has changed
_TARGET_HZ = 10.0  # until the source's own rate is known
_SMOOTHING = 0.3
_WINDOW = 8  # frames whose mean counts
_ENOUGH = 3  # frames that tell something
_HICCUP = 1.5  # a frame that takes longer than so many of its neighbours counts as long as these: it was something else
_HOPELESS = 2.0  # a load that not even one frame more is needed for
# Shares of the line's time, by level. Halving costs three pixels of four: better to lose a fifth of the frames.
_TOO_FULL = (1.05, 1.05, 1.05, 1.25, math.inf)  # above it a coarser level is due
_FITS = (0.95, 0.95, 0.95, 1.15, math.inf)  # what a coarser level may be predicted to take
_ROOM = (0.80, 0.80, 0.80, 1.00, math.inf)  # what a finer level may be predicted to take: there has to be room to spare
_HOLD_S = 2.0
_LONGEST_HOLD_S = 64.0


@dataclass(frozen=True, slots=True)
class Mode:
    """How a frame is coded: no pixel off by more than `bound` sixteenths, and perhaps at half the width and height."""

    bound: int
    halved: bool = False


EXACT = Mode(0)
LADDER = (EXACT, Mode(1), Mode(2), Mode(4), Mode(4, halved=True))


class RateControl:
    """Chooses a `Mode` for each frame from what it is told of the frames before. Times are seconds of one monotonic clock.

    `target_hz` is the wished frame rate; None, or a source that is slower, makes the source's own rate the wish. `bound`
    pins the mode as `choose` does. `line_bytes_per_s` is the line's speed where it is known beforehand: without it the first
    frame goes out exact, however long that takes.
    """

    def __init__(
        self, target_hz: float | None = None, *, bound: int | None = None, line_bytes_per_s: float | None = None
    ) -> None:
        if target_hz is not None and not 0 < target_hz <= 1000:
            raise UsageError(f"a target of {target_hz:g} frames a second: give more than 0 and at most 1000")
        self.target_hz = target_hz
        self._line_bytes_per_s = line_bytes_per_s
        self._pinned: Mode | None = None
        self._level = 0
        self._shares = list(_SHARES)
        self._sizes: deque[int] = deque(maxlen=_WINDOW)  # of the last frames, all of one mode
        self._line_s: deque[float] = deque(maxlen=_WINDOW)
        self._told: int | None = None  # the level of these frames
        self._exact_bytes: float | None = None  # what the scene would take at level 0, by the frames before these
        self._source_s: float | None = None
        self._coding_s: float | None = None
        self._changed_s = -math.inf
        self._refined = False  # the last change was towards finer
        self._hold_s = _HOLD_S
        self.choose(bound)

    def choose(self, bound: int | None) -> None:
        """Pin the bound in sixteenths of a pixel, at full resolution; None lets the line decide. Raises UsageError."""
        if bound is not None and bound not in BOUNDS:
            raise UsageError(f"a bound of {bound} sixteenths: it is one of {BOUNDS}, or automatic")
        self._pinned = None if bound is None else Mode(bound)

    @property
    def mode(self) -> Mode:
        """The mode in force."""
        return self._pinned or LADDER[self._level]

    def mode_for(self, pixels: int) -> Mode:
        """Give the mode of the next frame, which has so many pixels before any halving."""
        if self._told is None and self._line_bytes_per_s is not None:
            exact_s = pixels * _BITS_PER_PIXEL / 8 / self._line_bytes_per_s
            self._level = self._finest(exact_s * self._wished_hz(), 0, _FITS)
        return self.mode

    def sent(
        self,
        mode: Mode,
        size: int,
        line_s: float,
        now_s: float,
        *,
        source_s: float | None = None,
        coding_s: float = 0.0,
    ) -> None:
        """Take in that a frame of `size` bytes went out, and that the line was busy with it for `line_s` seconds.

        `source_s` is how far apart the source's frames have been lately, in seconds, those that were dropped included;
        `coding_s` is how long the line waited while the frame was coded, which is the same for every bound.
        """
        if source_s:
            self._source_s = _smoothed(self._source_s, source_s)
        level = LADDER.index(mode)
        if level != self._told:
            self._begin(level)
        self._sizes.append(max(size, 1))
        self._line_s.append(line_s)
        self._coding_s = _smoothed(self._coding_s, coding_s)
        if len(self._sizes) == _ENOUGH:
            self._learn_share(level)
        if self._pinned is None and level == self._level:
            self._decide(now_s)

    def _begin(self, level: int) -> None:
        """Forget the frames of another mode, but for how large the scene makes them."""
        if self._told is not None:
            self._exact_bytes = fmean(self._sizes) / self._shares[self._told]
        self._told = level
        self._sizes.clear()
        self._line_s.clear()
        self._coding_s = None

    def _learn_share(self, level: int) -> None:
        if self._exact_bytes is not None:
            known, found = _SHARES[level], fmean(self._sizes) / self._exact_bytes
            self._shares[level] = min(max(found, known / _SHARE_OFF), known * _SHARE_OFF)

    def _decide(self, now_s: float) -> None:
        since_s = now_s - self._changed_s
        if self._refined and since_s > 2 * self._hold_s:
            self._refined, self._hold_s = False, _HOLD_S  # the finer mode has held
        level, load, frames = self._level, self._load(), len(self._line_s)
        if (load > _HOPELESS and frames == 1) or (load > _TOO_FULL[level] and frames >= _ENOUGH):
            level = max(self._finest(self._sending(), level, _FITS), min(level + 1, len(LADDER) - 1))
            if level != self._level and self._refined:
                self._hold_s = min(2 * self._hold_s, _LONGEST_HOLD_S)
        elif since_s >= self._hold_s and frames >= _ENOUGH:
            finest = self._finest(self._sending(), level, _ROOM)
            # Frames of half the size vanish in buffers and tell little of the line: from there it goes step by step.
            level = min(max(finest, level - 1) if LADDER[level].halved else finest, level)
        if level != self._level:
            self._refined = level < self._level
            self._level, self._changed_s = level, now_s

    def _load(self) -> float:
        """Give the share of the line's time that frames of now take; above 1 they do not all get through."""
        return self._sending() + self._coding()

    def _sending(self) -> float:
        most_s = _HICCUP * median(self._line_s)
        return fmean(min(each_s, most_s) for each_s in self._line_s) * self._wished_hz()

    def _coding(self) -> float:
        return (self._coding_s or 0.0) * self._wished_hz()

    def _finest(self, sending: float, level: int, most: tuple[float, ...]) -> int:
        """Give the finest level that is predicted to take no more than `most` of it, where `level` takes `sending` to send."""
        exact, coding = sending / self._shares[level], self._coding()
        return next(each for each, share in enumerate(self._shares) if exact * share + coding <= most[each])

    def _wished_hz(self) -> float:
        source_hz = None if self._source_s is None else 1.0 / self._source_s
        if self.target_hz is None:
            return _TARGET_HZ if source_hz is None else source_hz
        return self.target_hz if source_hz is None else min(self.target_hz, source_hz)


def _smoothed(before: float | None, now: float) -> float:
    return now if before is None else before + _SMOOTHING * (now - before)


def halved(disparity: DisparityMap) -> DisparityMap:
    """Make the map of half the width and height: the closest pixel of each 2 x 2, its window making the same depths."""
    small = Decimate(factor=2).apply(Sheet.of(disparity))
    return DisparityMap(small.disparity_px, small.window)


def warm_up() -> None:
    """Compile what coding and halving need, or read it from the cache, before the first frame waits for it."""
    compact.warm_up()
    halved(DisparityMap(np.ones((8, 8), np.float32), DisparityWindow(16)))
