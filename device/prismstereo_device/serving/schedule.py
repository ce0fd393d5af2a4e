"""Whose turn it is on the line: the most urgent first, and nobody for ever last."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import IntEnum

from prismstereo_device.wire import Channel

__all__ = ["TURN_OF", "Schedule", "Turn"]


class Turn(IntEnum):
    """What shares the line, the most urgent first."""

    CONTROL = 0  # hello, clock probes
    COMMAND = 1
    REPORT = 2  # health, zones
    FRAME = 3
    PICTURE = 4  # preview, raw frames, reasons, confidence
    BULK = 5


TURN_OF: Mapping[int, Turn] = {
    Channel.HELLO: Turn.CONTROL,
    Channel.CTRL: Turn.CONTROL,
    Channel.CMD: Turn.COMMAND,
    Channel.HEALTH: Turn.REPORT,
    Channel.ZONES: Turn.REPORT,
    Channel.DISP: Turn.FRAME,
    Channel.IMG: Turn.PICTURE,
    Channel.RAW: Turn.PICTURE,
    Channel.REASON: Turn.PICTURE,
    Channel.CONFIDENCE: Turn.PICTURE,
    Channel.BULK: Turn.BULK,
}
_AT_LEAST_EVERY: Mapping[Turn, int] = {Turn.BULK: 4, Turn.PICTURE: 8}  # packets, while they wait


class Schedule:
    """Chooses packet by packet: the most urgent, but every 4th packet is bulk's and every 8th a picture's while one waits."""

    def __init__(self) -> None:
        self._passed = dict.fromkeys(_AT_LEAST_EVERY, 0)  # packets of others since it began to wait, or had its turn

    def choose(self, waiting: Collection[Turn]) -> Turn | None:
        """Give the turn of the next packet among those that wait; None where nothing does."""
        if not waiting:
            return None
        due = (turn for turn, every in _AT_LEAST_EVERY.items() if turn in waiting and self._passed[turn] >= every - 1)
        chosen = next(due, None)
        if chosen is None:
            chosen = min(waiting)
        for turn in self._passed:
            self._passed[turn] = self._passed[turn] + 1 if turn in waiting and turn is not chosen else 0
        return chosen
