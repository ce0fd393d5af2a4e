"""Versions of the firmware: whole numbers with dots between, compared number by number."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import total_ordering
from typing import Self

from prismstereo_hw.errors import DataError

__all__ = ["Version"]

_FORM = re.compile(r"(?:0|[1-9][0-9]{0,8})(?:\.(?:0|[1-9][0-9]{0,8})){0,3}", re.ASCII)


@total_ordering
@dataclass(frozen=True, slots=True)
class Version:
    """One to four numbers; zeros at the end do not count, so 1.2 and 1.2.0 are the same.

    >>> Version.parse("1.9") < Version.parse("1.10")
    True
    """

    numbers: tuple[int, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a version; `DataError` for any other form."""
        if _FORM.fullmatch(text) is None:
            raise DataError(f"version {text[:40]!r}: it is one to four whole numbers with dots between, such as 1.4.2")
        numbers = [int(part) for part in text.split(".")]
        while numbers and numbers[-1] == 0:
            numbers.pop()
        return cls(tuple(numbers))

    def __lt__(self, other: Version) -> bool:
        return self.numbers < other.numbers
