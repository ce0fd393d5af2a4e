"""The formats by name: how each is written and read, and in which unit its lengths are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from prismstereo_calibration.convert import colmap, kalibr, luxonis, opencv, ros
from prismstereo_calibration.convert.export import Export
from prismstereo_calibration.convert.pair import StereoPairModel

__all__ = ["FORMATS", "Format"]


@dataclass(frozen=True, slots=True)
class Format:
    """One format: `read` and `write`, its files' names, and whether these lie in a folder or there is just one file."""

    write: Callable[[StereoPairModel], Export]
    read: Callable[[Sequence[Path]], StereoPairModel]
    names: tuple[str, ...]
    unit: str

    @property
    def folder(self) -> bool:
        """Tell whether the format consists of several files."""
        return len(self.names) > 1


FORMATS = {
    "ros": Format(ros.write, ros.read, ros.NAMES, "m"),
    "opencv": Format(opencv.write, opencv.read, opencv.NAMES, "mm"),
    "kalibr": Format(kalibr.write, kalibr.read, kalibr.NAMES, "m"),
    "luxonis": Format(luxonis.write, luxonis.read, luxonis.NAMES, "cm"),
    "colmap": Format(colmap.write, colmap.read, colmap.NAMES, "mm"),
}
