"""What goes wrong on a line, as a person writes it: `flips=1e-4,stall=0.2/1`, or `down:drops=1e-3` for one direction.

flips, drops, dups   share of the bytes that are changed, lost, doubled
bits                 share of the bits that are turned over
chunkdrop, garbage   share of the runs of bytes that are lost, or followed by up to 400 bytes that nobody sent
stall=D/P            for the last D seconds of every P nothing moves; the bytes wait
cut=D/P              ... the line is dead: bytes go in and do not come out
baud=D/P             ... one end has the wrong speed: every byte comes out as some other
replug=D/P           ... the host's plug is out; both directions at once
slow=N               the line carries N bytes per second
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

from prismstereo_hw.errors import UsageError

__all__ = ["FaultPlan", "Faults", "Spell"]

_DIRECTIONS = ("up", "down")


@dataclass(frozen=True, slots=True)
class Spell:
    """A fault that comes and goes: the last `duration_s` of every `period_s`, so that each one ends at a whole period."""

    duration_s: float
    period_s: float

    def __post_init__(self) -> None:
        """Refuse a spell that never ends, or never comes."""
        if not 0 < self.duration_s < self.period_s < float("inf"):
            raise ValueError("give D/P in seconds, 0 < D < P")

    def active(self, now_s: float) -> bool:
        """Whether it is on, so many seconds after the line was set up."""
        return now_s % self.period_s >= self.period_s - self.duration_s


@dataclass(frozen=True, slots=True)
class Faults:
    """What goes wrong in one direction; shares are of bytes (of bits, of runs of bytes), 0 to 1."""

    flips: float = 0.0
    bits: float = 0.0
    drops: float = 0.0
    dups: float = 0.0
    chunkdrop: float = 0.0
    garbage: float = 0.0
    stall: Spell | None = None
    cut: Spell | None = None
    baud: Spell | None = None
    replug: Spell | None = None
    slow: float | None = None  # bytes per second


_SPELLS = ("stall", "cut", "baud", "replug")
_KINDS = tuple(field.name for field in fields(Faults))


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """The faults from host to camera (`up`) and from camera to host (`down`)."""

    up: Faults = Faults()
    down: Faults = Faults()

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `kind=value,...`, each kind with `up:` or `down:` before it or meant for both. Raises UsageError."""
        plan = cls()
        for entry in filter(None, (part.strip() for part in text.split(","))):
            way, colon, rest = entry.rpartition(":")
            kind, equals, value = rest.partition("=")
            if kind not in _KINDS or not equals or (colon and (way not in _DIRECTIONS or kind == "replug")):
                raise UsageError(
                    f"fault {entry!r}: write kind=value, for one direction up:kind=value or down:kind=value (not replug); "
                    f"kinds are {', '.join(_KINDS)}"
                )
            try:
                read = {kind: _value(kind, value)}
            except ValueError as error:
                raise UsageError(f"fault {entry!r}: {error}") from None
            for direction in (way,) if colon else _DIRECTIONS:
                plan = replace(plan, **{direction: replace(getattr(plan, direction), **read)})
        return plan

    @property
    def spells(self) -> tuple[Spell, ...]:
        """The faults that come and go, of either direction, each once."""
        found = (getattr(faults, name) for faults in (self.up, self.down) for name in _SPELLS)
        return tuple(dict.fromkeys(spell for spell in found if spell is not None))


def _value(kind: str, text: str) -> float | Spell:
    """Read the value of a fault; ValueError says what it has to be."""
    if kind in _SPELLS:
        duration, _, period = text.partition("/")
        try:
            seconds = float(duration), float(period)
        except ValueError:
            raise ValueError("give D/P in seconds, e.g. 0.2/1") from None
        return Spell(*seconds)
    try:
        number = float(text)
    except ValueError:
        raise ValueError("give a number") from None
    if kind == "slow":
        if not 100 <= number <= 1e9:
            raise ValueError("give 100 to 1e9 bytes per second")
    elif not 0 <= number <= 1:
        raise ValueError("give a share from 0 to 1")
    return number
