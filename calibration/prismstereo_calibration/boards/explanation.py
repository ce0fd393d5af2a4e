"""Why a frame does not count, and why none does: one sentence each, with what to do about it.

A wrong count of squares, a wrong dictionary or a view that is mirrored by mistake look alike at first: no board anywhere. So a
few frames are looked at again for boards and markers of any kind, and what is there is named with the words to pass.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.chessboard import found_sizes
from prismstereo_calibration.boards.corners import Found
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.boards.markers import DICTIONARIES, read_markers
from prismstereo_calibration.boards.refusal import NO_BOARD, Refusal
from prismstereo_calibration.boards.saddle import grey_of
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.view import View

__all__ = ["another_board", "explain", "reason_of", "view_name"]

_FRAMES_TO_EXPLAIN = 3
_FEWEST_MARKERS = 6  # of a dictionary nobody asked for: clutter reads as two or three of a large one
_MOST_NUMBERS = 250  # that are told apart: boards with more markers are rare, and each costs time
_SIZES = (50, 100, 250, 1000)


def view_name(index: int) -> str:
    """Name a view: the left view, the right view, view 3."""
    return ("the left view", "the right view")[index] if index < 2 else f"view {index + 1}"


def reason_of(seen: Sequence[Found | Refusal]) -> str:
    """Say why a frame does not count: what every view that shows no board has against it."""
    refusals = [(index, one.reason) for index, one in enumerate(seen) if isinstance(one, Refusal)]
    if len(refusals) == len(seen) and len({reason for _, reason in refusals}) == 1:
        return f"{refusals[0][1]} in {'either' if len(seen) == 2 else 'any'} view"
    named = [f"{reason} in {view_name(index)}" for index, reason in refusals]
    if len(seen) == 2 and len(named) == 2:
        named[1] = named[1].removesuffix(" view")
    return ", ".join(named)


def explain(
    frames: Sequence[NamedFrame],
    views: tuple[View, ...],
    board: Board,
    looks: Sequence[Sequence[Found | Refusal]],
) -> NoReturn:
    """Say why not one frame can be used, by what was seen in each view of each frame."""
    asked = board.name if board.named_corners else f"{board.columns}x{board.rows}"
    counts = [sum(isinstance(one[index], Found) for one in looks) for index in range(len(views))]
    hold = "hold it where both views see it" + ("" if board.named_corners else " whole")
    if counts[0] and any(counts[1:]):
        told = ", ".join(
            f"{view_name(index).removeprefix('the ')}: {count} frames" for index, count in enumerate(counts)
        )
        raise CalibrationError(f"the {asked} board is never in both views of one frame ({told}): {hold}")
    reason = _usual_reason(looks)
    if any(counts):
        shown = int(np.argmax(np.array(counts) > 0))
        other = (
            "the right view" if shown == 0 and len(views) == 2 else "any other view" if shown == 0 else "the left view"
        )
        raise CalibrationError(
            f"the {asked} board is seen in {view_name(shown)} of {counts[shown]} frames, but never in {other}"
            f"{f' ({reason})' if reason else ''}: {hold}, and check that the layout or rig is the right one"
        )
    raise CalibrationError(f"no {asked} board in any of {len(frames)} frames{_nowhere(frames, views, board, reason)}")


def _nowhere(frames: Sequence[NamedFrame], views: tuple[View, ...], board: Board, reason: str | None) -> str:
    """Say why no view of any frame shows the board, and what to do."""
    if reason and board.named_corners:
        return f": {reason}"
    other = another_board(frames, views, board)
    if other is not None:
        return f", but {other}"
    if reason:
        return f": {reason}"
    if board.named_corners:
        return (
            f": compare its columns and rows ({'tags' if board.kind == 'aprilgrid' else 'squares'}) and its markers "
            "with the print, hold it nearer, sharp and evenly lit"
        )
    return (
        ": count the inner corners (one less than the squares), keep the whole board with a white margin in both "
        "views, sharp and evenly lit"
    )


def another_board(frames: Sequence[NamedFrame], views: tuple[View, ...], board: Board) -> str | None:
    """Look into the first few frames for a board other than the one that is asked for; say what was found and what to pass."""
    found = _other_markers(frames, views, board)
    if found is None and not board.named_corners:
        found = _another_size(frames, views, board)
    return found


def _usual_reason(looks: Sequence[Sequence[Found | Refusal]]) -> str | None:
    """Return what was against the board most often, if there was a board at all."""
    reasons = Counter(
        f"{one.reason} in {view_name(index)}"
        for seen in looks
        for index, one in enumerate(seen)
        if isinstance(one, Refusal) and one != NO_BOARD
    )
    return reasons.most_common(1)[0][0] if reasons else None


def _pictures(frames: Sequence[NamedFrame], views: tuple[View, ...]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield the views of the first few frames."""
    for index in range(min(_FRAMES_TO_EXPLAIN, len(frames))):
        frame = frames[index]
        for view in views:
            yield frame.name, grey_of(view.cut(frame.pixels))


def _another_size(frames: Sequence[NamedFrame], views: tuple[View, ...], board: Board) -> str | None:
    """Look into a few frames for a chessboard of any size; name the size found most often, and the first frame with it."""
    found = [(name, size) for name, grey in _pictures(frames, views) if (size := found_sizes(grey)) is not None]
    asked = max(board.columns, board.rows), min(board.columns, board.rows)
    found = [(name, size) for name, size in found if size != asked]
    if not found:
        return None
    counts = Counter(size for _, size in found)
    best = max(counts, key=lambda size: (counts[size], size))
    name = next(name for name, size in found if size == best)
    return f"found a {best[0]}x{best[1]} board in {name}: pass --board {Board(*best).name}"


def _other_markers(frames: Sequence[NamedFrame], views: tuple[View, ...], board: Board) -> str | None:
    """Look into a few frames for markers of any dictionary; say what the first picture with some shows."""
    for name, grey in _pictures(frames, views):
        for family in DICTIONARIES:
            read = _of_family(grey, family)
            if len(read.numbers) >= _FEWEST_MARKERS:
                return _to_pass(name, read, board)
    return None


@dataclass(frozen=True, slots=True)
class _Read:
    """Numbers of the markers of a family in a picture, and whether they are white on black."""

    family: str
    numbers: frozenset[int]
    inverted: bool


def _of_family(grey: NDArray[np.uint8], family: str) -> _Read:
    """Read the markers of a family, of whatever border and either polarity."""
    best = _Read(family, frozenset(), inverted=False)
    for border in (1, 2) if "h" in family else (1,):
        either = read_markers(grey, family, border, _MOST_NUMBERS, inverted_too=True).ids
        if len(either) >= max(_FEWEST_MARKERS, len(best.numbers) + 1):
            plain = read_markers(grey, family, border, _MOST_NUMBERS).ids
            best = _Read(family, frozenset(either.tolist()), 2 * len(plain) < len(either))
    return best


def _to_pass(name: str, read: _Read, board: Board) -> str:
    """Say what was found, and what to pass for it."""
    dictionary = _smallest(read.family, max(*read.numbers, board.marker_count - 1) + 1)
    shown = f"found {len(read.numbers)} {'white-on-black ' if read.inverted else ''}markers of {dictionary} in {name}"
    if not board.named_corners:
        return (
            f"{shown}: it is no plain chessboard, pass --board charuco:COLUMNSxROWS (squares) or aprilgrid:COLUMNSxROWS"
        )
    other = replace(board, dictionary=dictionary, inverted=read.inverted)
    if other == board:
        return f"{shown} that do not lie as on it: compare its columns and rows with the print"
    return f"{shown}: pass --board {other.name}"


def _smallest(family: str, numbers: int) -> str:
    """Name the smallest dictionary of a family that has so many markers."""
    if "h" in family:
        return family
    return f"{family.partition('_')[0]}_{next((size for size in _SIZES if size >= numbers), _SIZES[-1])}"
