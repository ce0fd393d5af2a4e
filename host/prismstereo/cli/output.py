"""How verbs speak: one JSON object or a few lines on stdout, progress on stderr."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import click

from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import RangeWish

__all__ = ["RANGE_HELP", "Ticker", "json_option", "parse_range", "say", "with_progress"]

Item = TypeVar("Item")
_QUIET_STEP_S = 2.0
RANGE_HELP = "Depths wished for, A:Z in mm; Z may be inf. Default: from the calibration."

json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object with stable keys.")


def say(result: dict[str, object], lines: Iterable[str], *, as_json: bool) -> None:
    """Print a result: one JSON object, or lines for people."""
    if as_json:
        click.echo(json.dumps(_plain(result), indent=2, allow_nan=False))
    else:
        for line in lines:
            click.echo(line)


def _plain(value: object) -> object:
    """Make a value fit for strict JSON: what is not finite is null, paths are text."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, bool | int | str) or value is None:
        return value
    number = float(value)  # type: ignore[arg-type]  # what is left is a number, numpy's included
    return number if math.isfinite(number) else None


def with_progress(items: Iterable[Item], total: int | None, label: str) -> Iterator[Item]:
    """Yield items while a bar on stderr shows how far things are; on a file or a pipe, a line every two seconds."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import track

        yield from track(items, description=label, total=total, console=Console(stderr=True), transient=True)
        return
    spoken_s = time.monotonic()
    for count, item in enumerate(items, start=1):
        yield item
        if count == total or time.monotonic() - spoken_s > _QUIET_STEP_S:
            spoken_s = time.monotonic()
            click.echo(f"{label}: {count}{f' of {total}' if total else ''}", err=True)


class Ticker:
    """Shows on stderr how far something is: a line every two seconds, and the last."""

    def __init__(self, label: str) -> None:
        self._label, self._spoken_s = label, 0.0

    def __call__(self, done: int, total: int, name: str) -> None:
        """Tell that so many of so many are done, and the name of the last."""
        if done == total or time.monotonic() - self._spoken_s > _QUIET_STEP_S:
            self._spoken_s = time.monotonic()
            click.echo(f"{self._label}: {done} of {total} ({name})", err=True)


def parse_range(text: str | None, labels: int) -> RangeWish | None:
    """Read A:Z in mm; `UsageError` shows the form."""
    if text is None:
        return None
    near, _, far = text.partition(":")
    try:
        return RangeWish(near_mm=float(near), far_mm=float(far), labels=labels)
    except ValueError:
        raise UsageError(f"range {text!r}: give near and far in mm as A:Z, e.g. 400:inf or 300:2000") from None
