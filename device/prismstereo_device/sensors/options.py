"""What stands behind the name of a sensor: `?key=value&key=value`, checked by name and by kind of value."""

from __future__ import annotations

import math
from collections.abc import Iterable
from urllib.parse import parse_qsl

from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

__all__ = ["Options"]

_YES_OR_NO = {"1": True, "yes": True, "0": False, "no": False}
_MOST_CHARACTERS = 4096


class Options:
    """Named values of one sensor; `UsageError` for a name it does not know, one given twice, and a value of another kind.

    >>> Options("width=1280&loop=1", ("width", "loop")).whole("width")
    1280
    """

    def __init__(self, text: str, known: Iterable[str]) -> None:
        self._known = tuple(known)
        if len(text) > _MOST_CHARACTERS:
            raise UsageError(f"{len(text)} characters of sensor options: give at most {_MOST_CHARACTERS}")
        try:
            pairs = parse_qsl(text, keep_blank_values=True, strict_parsing=True) if text else []
        except ValueError as error:
            raise UsageError(f"the sensor options are not KEY=VALUE&KEY=VALUE: give {self._choice()}") from error
        self._values = dict(pairs)
        if len(self._values) < len(pairs):
            raise UsageError("a sensor option is given twice: give each of them once")
        for key in self._values:
            if key not in self._known:
                raise UsageError(f"there is no option {key!r} of this sensor: give {self._choice()}")

    @classmethod
    def behind(cls, argument: str, known: Iterable[str]) -> tuple[str, Options]:
        """Part `NAME?key=value` into the name and the options; a name alone has none."""
        name, _, text = argument.partition("?")
        return name, cls(text, known)

    def text(self, key: str) -> str | None:
        """Return a value as it stands; None where it was not given."""
        return self._values.get(key)

    def whole(self, key: str, least: int = 1, most: int = 1 << 31) -> int | None:
        """Return a whole number; None where it was not given."""
        text = self._values.get(key)
        if text is None:
            return None
        if not text.isascii() or not text.isdigit() or not least <= int(text[:16]) <= most:
            raise UsageError(f"{key}={text}: give a whole number from {least} to {most}")
        return int(text)

    def number(self, key: str) -> float | None:
        """Return a positive number; None where it was not given."""
        text = self._values.get(key)
        if text is None:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            raise UsageError(f"{key}={text}: give a positive number")
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return whether something is wished, `1` or `0`."""
        text = self._values.get(key)
        if text is None:
            return default
        if text not in _YES_OR_NO:
            raise UsageError(f"{key}={text}: give 1 or 0")
        return _YES_OR_NO[text]

    def choice(self, key: str, among: Iterable[str], default: str) -> str:
        """Return one of a few words."""
        value = self._values.get(key, default)
        if value not in (words := tuple(among)):
            raise UsageError(f"{key}={value}: give one of {', '.join(words)}")
        return value

    def rig(self) -> Rig | None:
        """Read the rig that `rig=` names, a built-in one or a file; None where it was not given."""
        name = self._values.get("rig")
        return None if name is None else Rig.read(name)

    def _choice(self) -> str:
        return ", ".join(self._known) or "none"
