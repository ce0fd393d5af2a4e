"""Sizes of paper and plates."""

from __future__ import annotations

import re
from dataclasses import dataclass

from prismstereo_hw.errors import UsageError

__all__ = ["PAGES", "Page"]

PAGES: dict[str, tuple[float, float]] = {  # name -> short and long side in mm
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
_SMALLEST_MM, _LARGEST_MM = 20.0, 5000.0
_SIZE = re.compile(r"(?P<width>\d{1,4}(\.\d{1,3})?)x(?P<height>\d{1,4}(\.\d{1,3})?)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Page:
    """A sheet of a width and a height; one that is known by name may lie or stand."""

    width_mm: float
    height_mm: float
    name: str = ""

    @classmethod
    def parse(cls, text: str) -> Page:
        """Read a name such as `a4`, or WIDTHxHEIGHT in mm; `UsageError` lists the names there are.

        >>> Page.parse("300x200").width_mm
        300.0
        """
        wish = text.strip().lower()
        if wish in PAGES:
            return cls(*PAGES[wish], wish)
        size = _SIZE.fullmatch(wish)
        if size is None:
            raise UsageError(f"page {text!r} is not known: give one of {', '.join(PAGES)}, or WIDTHxHEIGHT in mm")
        width, height = float(size["width"]), float(size["height"])
        if not (min(width, height) >= _SMALLEST_MM and max(width, height) <= _LARGEST_MM):
            raise UsageError(
                f"page {text!r}: give sides of {_SMALLEST_MM:g} to {_LARGEST_MM:g} mm, width x height, in millimetres"
            )
        return cls(width, height)

    @property
    def turns(self) -> tuple[Page, ...]:
        """The ways in which the sheet may lie: paper both ways, a plate as it was ordered."""
        return (self, Page(self.height_mm, self.width_mm, self.name)) if self.name else (self,)

    def __str__(self) -> str:
        """Write the page as it is asked for."""
        return self.name or f"{self.width_mm:g}x{self.height_mm:g}"
