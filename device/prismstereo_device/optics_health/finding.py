"""One thing that was looked at: its figure, its limit, and what to do where it is beyond."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "State"]

State = Literal["ok", "warn", "unknown"]


@dataclass(frozen=True, slots=True)
class Finding:
    """A figure (unit last in `name`), how far it may be from `expected`, and the mend; NaN: it could not be told."""

    name: str
    value: float
    expected: float
    limit: float
    mend: str

    @property
    def state(self) -> State:
        """`warn` beyond the limit, `unknown` where nothing can be said."""
        if math.isnan(self.value) or math.isnan(self.expected):
            return "unknown"
        return "ok" if abs(self.value - self.expected) <= self.limit else "warn"

    def as_json(self) -> dict[str, object]:
        """Give plain values; what could not be told is None, and the mend is left out of what is in order."""
        known = (None if math.isnan(number) else round(number, 4) for number in (self.value, self.expected))
        value, expected = known
        mend = self.mend if self.state == "warn" else ""
        return {
            "name": self.name,
            "state": self.state,
            "value": value,
            "expected": expected,
            "limit": self.limit,
            "mend": mend,
        }
