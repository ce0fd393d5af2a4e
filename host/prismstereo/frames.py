"""Raw frames from picture files: one file a frame, or two files side by side for two cameras."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.files import read_picture
from prismstereo_hw.frame import RawFrame

__all__ = ["BoardFrames", "expand", "named_frames", "paired_frames", "pairs"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff", ".bmp"}


def expand(patterns: Sequence[str | Path]) -> list[Path]:
    """Expand files, folders, sessions (their video) and patterns into picture files, in order; `UsageError` for no match."""
    files: list[Path] = []
    for pattern in patterns:
        path = Path(pattern)
        if path.is_dir():
            folder = path / "video" if (path / "session.toml").is_file() else path  # a session: its raw frames
            found = (
                sorted(file for file in folder.iterdir() if file.suffix.lower() in _SUFFIXES) if folder.is_dir() else []
            )
        elif path.exists():
            found = [path]
        else:
            found = sorted(Path(name) for name in glob.glob(str(pattern)))
        if not found:
            raise UsageError(f"no picture matches {str(pattern)!r}: give files, a folder, or a quoted pattern")
        files += found
    return files


def named_frames(patterns: Sequence[str | Path]) -> Iterator[tuple[str, RawFrame]]:
    """Read raw frames one at a time, with the name of each: its file's, without the ending."""
    files = expand(patterns)
    return ((file.stem, RawFrame(read_picture(file), index)) for index, file in enumerate(files))


def pairs(left: str, right: str) -> list[tuple[Path, Path]]:
    """Pair the files of two patterns by the last number in their names; `UsageError` names what has no partner."""
    sides = [{_number(path): path for path in expand([pattern])} for pattern in (left, right)]
    alone = sorted(path.name for number in sides[0].keys() ^ sides[1].keys() for path in _of(sides, number))
    if alone:
        raise UsageError(f"without a partner of the same number: {', '.join(alone)}; take them out, or name them alike")
    return [(sides[0][number], sides[1][number]) for number in sorted(sides[0])]


def _of(sides: list[dict[int, Path]], number: int) -> list[Path]:
    return [side[number] for side in sides if number in side]


def _number(path: Path) -> int:
    digits = re.findall(r"\d+", path.stem)
    if not digits:
        raise UsageError(f"{path} has no number in its name to pair it by: name pictures like left01.jpg, right01.jpg")
    return int(digits[-1])


def paired_frames(left: str, right: str) -> Iterator[tuple[str, RawFrame]]:
    """Read the pictures of two cameras as raw frames side by side, left one left."""
    files = pairs(left, right)
    return ((one.stem, _side_by_side(one, other, index)) for index, (one, other) in enumerate(files))


def _side_by_side(left: Path, right: Path, index: int) -> RawFrame:
    pictures = read_picture(left), read_picture(right)
    if pictures[0].shape != pictures[1].shape:
        raise ImageError(f"{left} is {pictures[0].shape} and {right} {pictures[1].shape}: both cameras have one size")
    return RawFrame(np.hstack(pictures), index)


class BoardFrames(Sequence[NamedFrame]):
    """Board pictures read when they are asked for, one at a time: one file a frame, or (left, right) pairs of files."""

    def __init__(self, files: Sequence[Path | tuple[Path, Path]]) -> None:
        self._files = files

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> NamedFrame: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[NamedFrame]: ...
    def __getitem__(self, index: int | slice) -> NamedFrame | Sequence[NamedFrame]:
        if isinstance(index, slice):
            return BoardFrames(self._files[index])
        file = self._files[index]
        if isinstance(file, tuple):
            return NamedFrame(file[0].name, _side_by_side(*file, index).pixels)
        return NamedFrame(file.name, read_picture(file))
