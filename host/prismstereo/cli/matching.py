"""How a verb is told to match: one set of options, read into one thing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING

import click

from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_device.filters import FilterChain
    from prismstereo_device.match import Matcher

__all__ = ["Matching", "matching_options"]

_LEARNED = "onnx:"
_REGION_SIDES = 4
Region = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Matching:
    """What was asked for: a matcher by name (None: the default), how it is to search, and the filters behind it."""

    matcher: str | None
    first_px: int
    region: Region | None
    subpixel_bits: int
    threads: int
    providers: tuple[str, ...]
    filters: str | None

    @property
    def name(self) -> str:
        """The matcher's whole name; `UsageError` for providers of a matcher that has none."""
        from prismstereo_device.match import DEFAULT

        name = self.matcher or DEFAULT
        if self.providers and not name.startswith(_LEARNED):
            raise UsageError(
                f"--provider {self.providers[0]} goes with a learned matcher, {_LEARNED}MODEL.onnx, not {name}"
            )
        return name + "".join(f",provider={provider}" for provider in self.providers)

    def create(self) -> Matcher:
        """Make the matcher; `UsageError` or `DataError` where it cannot be."""
        from prismstereo_device.match import MatchSettings, create

        return create(self.name, MatchSettings(self.first_px, self.region, self.subpixel_bits, self.threads))

    def chain(self) -> FilterChain | None:
        """Read the filters, None where none were asked for; `UsageError` names what is wrong with them."""
        if self.filters is None:
            return None
        from dataclasses import replace

        from prismstereo_device.filters import chain

        return replace(chain(self.filters), threads=self.threads)


def matching_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb the options of matching, and its function what was asked for as `matching`."""

    @wraps(verb)
    def gathered(
        *, matcher: str | None, first_px: int, region: Region | None, subpixel_bits: int, threads: int,
        providers: tuple[str, ...], filters: str | None, **others: object,
    ) -> None:  # fmt: skip
        wish = Matching(matcher, first_px, region, subpixel_bits, threads, providers, filters)
        verb(matching=wish, **others)

    decorated: Callable[..., None] = gathered
    for option in reversed(_OPTIONS):
        decorated = option(decorated)
    return decorated


def _region(context: click.Context, parameter: click.Parameter, text: str | None) -> Region | None:
    del context, parameter
    if text is None:
        return None
    sides = text.split(",")
    if len(sides) != _REGION_SIDES or not all(side.strip().isascii() and side.strip().isdigit() for side in sides):
        raise UsageError(f"--region {text}: give X,Y,WIDTH,HEIGHT in whole pixels, e.g. 100,50,320,240")
    x, y, width, height = map(int, sides)
    return x, y, width, height


_OPTIONS = (
    click.option(
        "--matcher",
        metavar="NAME",
        help="How to match, by name, or onnx:MODEL.onnx[,preset=NAME][,check=yes] for a learned one.",
    ),
    click.option(
        "--min-disparity", "first_px", default=0, show_default=True, type=int, help="The first label to search."
    ),
    click.option("--region", metavar="X,Y,W,H", callback=_region, help="Match in this part of the left picture only."),
    click.option("--subpixel-bits", default=4, show_default=True, type=int, help="Fractions of a pixel, 0 to 8."),
    click.option("--threads", default=2, show_default=True, type=int, help="How many work at once."),
    click.option(
        "--provider",
        "providers",
        multiple=True,
        metavar="P",
        help="What a learned matcher runs on: cpu, cuda, ...; first choice first.",
    ),
    click.option("--filters", metavar="NAME|FILE", help="Filters behind the matcher: a preset or a TOML file."),
)
