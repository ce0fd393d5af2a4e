"""What a conversion gives: files by name, and what had to be said about them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from prismstereo_calibration.convert.pair import StereoPairModel
from prismstereo_hw.errors import UsageError

__all__ = ["Export", "number", "require_metric", "row"]


@dataclass(frozen=True, slots=True)
class Export:
    """Contents by file name, notes in sentences, and the error in pixels that the format forced, at most."""

    files: dict[str, bytes]
    notes: tuple[str, ...] = ()
    residual_px: float = 0.0


def require_metric(pair: StereoPairModel, form: str) -> None:
    """Refuse lengths in board squares where a format has lengths in metres; `UsageError`."""
    if pair.unit != "mm":
        raise UsageError(
            f"the calibration's unit is {pair.unit!r}, but lengths of {form} are metric: measure a square and calibrate "
            "again with --square-mm"
        )


def number(value: float) -> str:
    """Write a number so that it comes back exactly, and that YAML 1.1 takes for a number: with a point."""
    text = repr(float(value) + 0.0)  # no minus before a 0
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def row(values: object) -> str:
    """Write numbers, an array of any shape in row order, as a list between brackets."""
    return f"[{', '.join(number(value) for value in np.ravel(np.asarray(values, float)))}]"
