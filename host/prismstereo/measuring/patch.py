"""A rectangle of pixels to measure in."""

from __future__ import annotations

from dataclasses import dataclass

from prismstereo_hw.errors import UsageError

__all__ = ["Patch"]


@dataclass(frozen=True, slots=True)
class Patch:
    """A rectangle of the rectified left picture in whole pixels, its right and bottom ends not included."""

    x: int
    y: int
    width: int
    height: int

    def __post_init__(self) -> None:
        """Refuse a rectangle without a pixel."""
        if self.width < 1 or self.height < 1:
            raise UsageError(f"{self} holds no pixel: give a width and a height of 1 or more")

    def __str__(self) -> str:
        return f"patch {self.x},{self.y},{self.width},{self.height}"

    @property
    def right(self) -> int:
        """The first column that is not in it."""
        return self.x + self.width

    @property
    def bottom(self) -> int:
        """The first row that is not in it."""
        return self.y + self.height

    @property
    def pixels(self) -> int:
        """How many pixels it has."""
        return self.width * self.height

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of its middle."""
        return self.x + (self.width - 1) / 2, self.y + (self.height - 1) / 2

    @classmethod
    def centred(cls, width: int, height: int, share: float) -> Patch:
        """Return the middle of a picture, `share` of it each way, one pixel at least."""
        w, h = max(round(share * width), 1), max(round(share * height), 1)
        return cls((width - w) // 2, (height - h) // 2, w, h)
