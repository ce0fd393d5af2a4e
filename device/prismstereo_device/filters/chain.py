"""A chain of filters, from a small TOML file or by the name of one that comes with the product.

    [[filters]]
    kind = "speckle"
    largest_pixels = 100

Filters work in the order they are given in. `holes` may only be followed by `range` and `decimate`: no other filter may take a
guess for a measurement.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.clean import Clean
from prismstereo_device.filters.decimate import Decimate
from prismstereo_device.filters.filter import Stage
from prismstereo_device.filters.holes import Holes
from prismstereo_device.filters.range_gate import RangeGate
from prismstereo_device.filters.sheet import Sheet
from prismstereo_device.filters.spatial import Spatial
from prismstereo_device.filters.speckle import Speckle
from prismstereo_device.filters.temporal import Temporal
from prismstereo_hw.errors import UsageError

__all__ = ["PRESETS", "AnyFilter", "FilterChain", "FilterStream", "chain"]

PRESETS = ("near", "robot", "face", "outdoor", "measure")
AnyFilter = Clean | Decimate | Holes | RangeGate | Spatial | Speckle | Temporal

_KINDS = ("clean", "decimate", "holes", "range", "spatial", "speckle", "temporal")
_MOST_FILTERS = 32
_MOST_BYTES = 64 * 1024
_MOST_THREADS = 64


class _ChainFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A chain file: its filters in order."""

    filters: tuple[AnyFilter, ...] = ()


@dataclass(frozen=True, slots=True)
class FilterChain:
    """Filters in order, and how many threads work; the result does not depend on the threads."""

    filters: tuple[AnyFilter, ...] = ()
    threads: int = 2

    def __post_init__(self) -> None:
        """Refuse numbers that no filter can have, and an order in which guesses become measurements."""
        if not 1 <= self.threads <= _MOST_THREADS:
            raise UsageError(f"{self.threads} threads: give 1 to {_MOST_THREADS}")
        if len(self.filters) > _MOST_FILTERS:
            raise UsageError(f"{len(self.filters)} filters: a chain has at most {_MOST_FILTERS}")
        try:
            msgspec.convert(msgspec.to_builtins(self.filters), tuple[AnyFilter, ...])
        except (msgspec.ValidationError, TypeError) as error:
            raise UsageError(f"a filter cannot be as it is: {error}") from error
        guessed = False
        for each in self.filters:
            if guessed and not isinstance(each, RangeGate | Decimate):
                raise UsageError(
                    f"{_kind(each)} stands behind holes and would take guesses for measurements: put holes last"
                )
            guessed = guessed or isinstance(each, Holes)

    @classmethod
    def parse(cls, text: str, origin: str) -> FilterChain:
        """Make a chain of TOML text; `origin` is named in every complaint (`UsageError`)."""
        try:
            return cls(msgspec.toml.decode(text, type=_ChainFile).filters)
        except msgspec.DecodeError as error:  # a wrong field is one of them
            raise UsageError(
                f"{origin}: {error}: the kinds of filters are {', '.join(_KINDS)}; compare a preset"
            ) from error
        except UsageError as error:
            raise UsageError(f"{origin}: {error}") from error

    def stream(self) -> FilterStream:
        """Begin a stream of maps: what its filters remember is its own."""
        return FilterStream(self)

    def apply(self, disparity: DisparityMap, picture: NDArray[np.uint8] | None = None) -> DisparityMap:
        """Filter a single map, see `FilterStream.apply`."""
        return self.stream().apply(disparity, picture)


class FilterStream:
    """The filters of one stream of maps, with what they remember of the maps before."""

    def __init__(self, filters: FilterChain) -> None:
        self._threads = filters.threads
        self._stages: tuple[Stage, ...] = tuple(each.stage() for each in filters.filters)

    def apply(
        self, disparity: DisparityMap, picture: NDArray[np.uint8] | None = None, time_us: int | None = None
    ) -> DisparityMap:
        """Filter the next map; the one that is given stays as it is.

        `picture` is the left rectified picture (height, width[, 3]) uint8, for the filters that look at it; `time_us` is the
        device's time of mid-exposure. What a filter takes away has its reason in `reasons`. `ImageError` for a picture
        that does not fit, `UsageError` for a range filter without a scale.
        """
        return self.filtered(disparity, picture, time_us)[0]

    def filtered(
        self, disparity: DisparityMap, picture: NDArray[np.uint8] | None = None, time_us: int | None = None
    ) -> tuple[DisparityMap, NDArray[np.bool_] | None]:
        """Filter the next map as `apply` does, and tell which pixels (height, width) bool were filled.

        None where no filter of the chain fills any.
        """
        if not self._stages:
            return disparity, None
        sheet = Sheet.of(disparity, picture, time_us, self._threads)
        for stage in self._stages:
            sheet = stage(sheet)
        told = disparity.confidence is not None
        made = replace(
            disparity,
            disparity_px=sheet.disparity_px,
            window=sheet.window,
            confidence=sheet.confidence if told else None,
            reasons=sheet.reasons,
            filled=sheet.filled,
        )
        return made, sheet.filled


def chain(source: str | Path) -> FilterChain:
    """Read a chain: the name of a preset (`near`, `robot`, `face`, `outdoor`, `measure`) or the path of a TOML file.

    `UsageError` for a name that is neither, and for a file with a field or a number that no filter has.
    """
    if str(source) in PRESETS:
        text = resources.files("prismstereo_device.filters").joinpath("presets", f"{source}.toml").read_text("utf-8")
        return FilterChain.parse(text, str(source))
    path = Path(source)
    if not os.path.isfile(path):  # unlike Path.is_file, says no to a name that no file can have
        raise UsageError(
            f"there are no filters {str(source)!r}: give one of {', '.join(PRESETS)}, or the path of a TOML file"
        )
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise UsageError(f"{path} has {path.stat().st_size} bytes: a filter file has at most {_MOST_BYTES}")
        return FilterChain.parse(path.read_text("utf-8-sig"), str(path))  # editors put a byte order mark there
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read as UTF-8 text: {error}") from error


def _kind(each: AnyFilter) -> str:
    return str(each.__struct_config__.tag)
