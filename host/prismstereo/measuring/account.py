"""The account of depth quality: the figures of flat targets and of scenes with truth, and the JSON file that keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from prismstereo.measuring.flat_target import FlatFigures
from prismstereo.measuring.gap import Gap
from prismstereo.measuring.levels import Levels
from prismstereo.measuring.truth_bins import TruthBin
from prismstereo_hw.errors import DataError

__all__ = ["Account", "FlatTarget", "TrueScene", "read"]

_MOST_BYTES = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class FlatTarget:
    """A flat target at one distance; `expected_rms_mm` is what its sub-pixel rms is worth there."""

    source: str
    figures: FlatFigures
    expected_rms_mm: float
    triangulation_gap_mm: Gap | None
    levels: Levels


@dataclass(frozen=True, slots=True)
class TrueScene:
    """A scene whose truth is known, by distance; `fill_percent` is of the pixels that have a match in truth."""

    source: str
    frames: int
    fill_percent: float
    by_distance: tuple[TruthBin, ...]
    triangulation_gap_mm: Gap | None
    levels: Levels


@dataclass(frozen=True, slots=True)
class Account:
    """All figures of one run, nearest flat target first."""

    flat: tuple[FlatTarget, ...]
    scenes: tuple[TrueScene, ...]
    schema: Literal["prismstereo-quality/1"] = "prismstereo-quality/1"

    def told(self) -> dict[str, object]:
        """Return the account as plain objects, for JSON."""
        told: dict[str, object] = msgspec.to_builtins(self)
        return told


def read(path: Path) -> Account:
    """Read what `prismstereo quality --json` printed; `DataError` for a file that is something else."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise DataError(f"{path} has {path.stat().st_size} bytes: no quality report has more than {_MOST_BYTES}")
        return msgspec.json.decode(path.read_bytes(), type=Account)
    except OSError as error:
        raise DataError(
            f"cannot read {path}: {error.strerror}: give what `prismstereo quality --json` printed"
        ) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(
            f"{path} is no quality report: {error}: give what `prismstereo quality --json` printed"
        ) from error
