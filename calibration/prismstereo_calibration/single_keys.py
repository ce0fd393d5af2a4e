"""Keys that stand once: JSON allows a key twice, readers take the first or the last, and nobody knows which was meant."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass

from prismstereo_calibration.errors import CalibrationError

__all__ = ["require_single_keys"]


@dataclass(frozen=True, slots=True)
class _Object:
    """A JSON object as it stands in the text, with every key that is written."""

    pairs: list[tuple[str, object]]


def require_single_keys(text: bytes) -> None:
    """Refuse JSON in which a key stands twice; `CalibrationError` names it with the keys that lead there.

    The text is one that a strict decoder has read already, so it is JSON and no deeper than the file's form.
    """
    _require(json.loads(text, object_pairs_hook=_Object), "")


def _require(value: object, place: str) -> None:
    if isinstance(value, list):
        for index, entry in enumerate(value):
            _require(entry, f"{place}[{index}]")
    if not isinstance(value, _Object):
        return
    joint = f"{place}." if place else ""
    for key, count in Counter(key for key, _ in value.pairs).items():
        if count > 1:
            raise CalibrationError(f"{joint}{key} is given {'twice' if count == 2 else f'{count} times'}: keep one")
    for key, entry in value.pairs:
        _require(entry, f"{joint}{key}")
