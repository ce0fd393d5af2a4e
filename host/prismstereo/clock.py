"""The device's clock as seen from the desk: a line through the quickest probes, and how far it can be off.

A probe says: at the middle of its round trip the two clocks differed by `offset`, give or take half the round trip. Probes
that waited in a queue say little, so only the quickest quarter of the last minute is used. Stamps are never rewritten:
what is recorded is the device's time and this mapping beside it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ClockFit", "ClockMapping", "Probe"]

Array = NDArray[np.float64]
_KEPT_US = 60_000_000
_QUICKEST = 4  # one in so many is used
_LEAST_USED = 4
_MOST_SKEW = 200e-6  # two quartz clocks at their worst
_LIKELY_SKEW = 20e-6  # and as they mostly are
_LIKELY_SHARE = 0.2  # by so much the share changes from fit to fit
_OUTLIERS = 5  # so many one after the other, and the clock was set


@dataclass(frozen=True, slots=True)
class Probe:
    """Four stamps in microseconds: sent and heard by the host's clock, received and answered by the device's."""

    sent_us: int
    received_us: int
    answered_us: int
    heard_us: int

    @property
    def round_trip_us(self) -> int:
        """Time on the line, both ways."""
        return (self.heard_us - self.sent_us) - (self.answered_us - self.received_us)


@dataclass(frozen=True, slots=True)
class ClockMapping:
    """host = device + offset_us + skew_ppm / 1e6 * (device - at_device_us), off by at most `bound_us`.

    The host's clock is `time.monotonic`, both count microseconds. The bound holds from the oldest probe used until a few
    seconds after `at_device_us`, which is when the newest probe was answered.
    """

    offset_us: float
    skew_ppm: float
    bound_us: float
    at_device_us: int

    def host_time_us(self, device_us: int) -> int:
        """Take a device stamp to the host's clock."""
        return device_us + round(self.offset_us + self.skew_ppm * 1e-6 * (device_us - self.at_device_us))


@dataclass(frozen=True, slots=True)
class _Habits:
    """What two crystals and a line keep doing: how much faster one runs, and on which way probes wait (1: to the host)."""

    skew: float = 0.0
    share: float = 0.0


class ClockFit:
    """Takes probes, gives the mapping; for one thread at a time."""

    def __init__(self) -> None:
        self._probes: deque[Probe] = deque()
        self._outliers: list[Probe] = []
        self._newest_us = -1
        self._mapping: ClockMapping | None = None
        self._habits = _Habits()  # kept, whatever the clocks are set to
        self._resets = 0

    @property
    def mapping(self) -> ClockMapping | None:
        """What the probes so far say; None before the first."""
        return self._mapping

    @property
    def resets(self) -> int:
        """How often one of the clocks turned out to have been set."""
        return self._resets

    def reset(self) -> None:
        """Forget everything: the device has started anew."""
        self._probes.clear()
        self._outliers.clear()
        self._newest_us = -1
        self._mapping = None

    def add(self, probe: Probe) -> None:
        """Take a probe; one that contradicts the others is kept apart, five of them in a row replace the others."""
        if probe.round_trip_us < 0 or probe.answered_us < probe.received_us:
            return  # stamps that cannot be
        if probe.answered_us < self._newest_us:
            self._start_with([])
        elif self._contradicts(probe):
            self._outliers.append(probe)
            if len(self._outliers) < _OUTLIERS:
                return
            self._start_with(self._outliers[:-1])
        else:
            self._outliers.clear()
        self._probes.append(probe)
        self._newest_us = probe.answered_us
        while self._probes[0].heard_us < probe.heard_us - _KEPT_US:
            self._probes.popleft()
        self._mapping, self._habits = _fit(list(self._probes), self._habits)

    def _start_with(self, probes: list[Probe]) -> None:
        self._resets += 1
        self._probes = deque(probes)
        self._outliers = []
        self._mapping = None

    def _contradicts(self, probe: Probe) -> bool:
        if self._mapping is None:
            return False
        expected_us = self._mapping.host_time_us(probe.received_us)
        seen_us = (probe.sent_us + probe.heard_us) / 2
        slack_us = self._mapping.bound_us + probe.round_trip_us / 2
        drifted_us = _MOST_SKEW * abs(probe.received_us - self._mapping.at_device_us)
        return abs(seen_us - expected_us) > slack_us + drifted_us + 1.0


def _fit(probes: list[Probe], before: _Habits) -> tuple[ClockMapping, _Habits]:
    count = max(_LEAST_USED, math.ceil(len(probes) / _QUICKEST))
    used = sorted(probes, key=lambda probe: probe.round_trip_us)[:count]
    at_us = probes[-1].answered_us
    # Differences of whole numbers first: a clock of many days does not fit a float with microseconds to spare.
    time_us = np.array([(probe.received_us + probe.answered_us) // 2 - at_us for probe in used], float)
    offset_us = np.array([_twice_offset(probe) - _twice_offset(used[0]) for probe in used], float) / 2
    half_us = np.array([probe.round_trip_us for probe in used], float) / 2
    level_us, habits = _line(time_us, offset_us, half_us, before)
    bound_us = _bound(time_us, half_us + np.abs(level_us + habits.skew * time_us - offset_us))
    return ClockMapping(_twice_offset(used[0]) / 2 + level_us, habits.skew * 1e6, bound_us, at_us), habits


def _twice_offset(probe: Probe) -> int:
    return probe.sent_us + probe.heard_us - probe.received_us - probe.answered_us


def _line(time_us: Array, offset_us: Array, half_us: Array, before: _Habits) -> tuple[float, _Habits]:
    """Fit slope and level (at time 0); quick and recent probes weigh more.

    What a probe waited, it mostly waited on the same way, behind video: its offset is then off by what its half round trip is
    longer, times a share of -1 to 1. That and the skew hardly change, so they are drawn towards what they were.
    """
    waited_us, time_s = half_us - half_us.min(), time_us * 1e-6
    unsure_us = 0.3 * waited_us + 0.1 * half_us.min() + 1e6 * _LIKELY_SKEW / 2 * np.abs(time_s) + 1.0
    terms = np.stack([np.ones_like(time_s), time_s, waited_us]) / unsure_us
    drawn = np.diag([0.0, (1e6 * _LIKELY_SKEW) ** -2, _LIKELY_SHARE**-2])
    apart_us = offset_us - before.skew * time_us - before.share * waited_us
    level_us, slope_us_s, share = np.linalg.solve(terms @ terms.T + drawn, terms @ (apart_us / unsure_us))
    skew = min(_MOST_SKEW, max(-_MOST_SKEW, before.skew + float(slope_us_s) * 1e-6))
    return float(level_us), _Habits(skew, min(1.0, max(-1.0, before.share + float(share))))


def _bound(time_us: Array, most_us: Array) -> float:
    """How far the line can be off at time 0, where at each `time_us` it is off by at most `most_us`.

    The true skew is steady, so what the line is off by is a line as well: any two probes bound it, and so does any one
    with the largest skew that quartz has.
    """
    alone = most_us + 2 * _MOST_SKEW * np.abs(time_us)
    span = time_us[None, :] - time_us[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(span != 0, -time_us[:, None] / span, np.nan)
    pairs = np.abs(1 - share) * most_us[:, None] + np.abs(share) * most_us[None, :]
    return float(np.nanmin([alone.min(), np.nanmin(pairs)] if np.isfinite(pairs).any() else [alone.min()]))
