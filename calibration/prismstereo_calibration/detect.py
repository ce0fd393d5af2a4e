"""Where the board is seen: corner pairs of every frame that shows it in both views, and why the others do not count.

Pixels are upright coordinates of the view (those of its cut-out picture plus the corner of its rectangle, see
`prismstereo_hw.view`). Corner k of both views of a frame is the same corner of the board.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.board import Board
from prismstereo_calibration.corners import Refusal, agree, find_corners, found_sizes
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.view import Side, View

__all__ = ["CornerPair", "Corners", "Detection", "NamedFrame", "Progress", "Rejection", "detect", "find_corners"]

Progress = Callable[[int, int, str], None]
"""Told after each frame: frames done, frames in all, the frame's name."""

_FRAMES_TO_EXPLAIN = 3


@dataclass(frozen=True, slots=True)
class NamedFrame:
    """A raw picture, (height, width[, 3]) uint8, and the name by which people know it (its file)."""

    name: str
    pixels: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Corners:
    """The board's corners in one view of one frame, (N, 2) float64 upright pixels."""

    name: str
    view: Side
    pixels: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CornerPair:
    """The same corners of the board in both views of one exposure."""

    name: str
    left: Corners
    right: Corners

    @classmethod
    def of(cls, name: str, left: NDArray[np.float64], right: NDArray[np.float64]) -> CornerPair:
        """Make the pair of upright pixels (N, 2) of both views."""
        return cls(name, Corners(name, "left", left), Corners(name, "right", right))


@dataclass(frozen=True, slots=True)
class Rejection:
    """A frame that does not count, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Detection:
    """Everything that was seen of the board: frame size, views, corner pairs in the order of the frames, rejections.

    The height is that of one exposure where the views are taken one after the other.
    """

    frame_width: int
    frame_height: int
    views: tuple[View, View]
    pairs: tuple[CornerPair, ...]
    rejected: tuple[Rejection, ...] = ()

    def only(self, names: Collection[str]) -> Detection:
        """Return this detection with the pairs of those frames alone."""
        return replace(self, pairs=tuple(pair for pair in self.pairs if pair.name in names))

    def pixels(self) -> NDArray[np.float64]:
        """Return the upright pixels of all pairs, (pairs, 2, N, 2): left view first."""
        return np.stack([np.stack([pair.left.pixels, pair.right.pixels]) for pair in self.pairs])


def detect(
    frames: Sequence[NamedFrame], views: tuple[View, View], board: Board, progress: Progress | None = None
) -> Detection:
    """Look for the board in both views of every frame.

    `frames` may be lazy: each is asked for once, at most three again to explain a failure. `CalibrationError` where
    nothing can be calibrated: no frame, frames of two sizes, no board, a board of another size, a board in one view only.
    """
    if not frames:
        raise CalibrationError("there is no frame: give the pictures of the board")
    pairs: list[CornerPair] = []
    rejected: list[Rejection] = []
    seen: Counter[Side] = Counter()
    first: tuple[str, int, int] | None = None
    for done, frame in enumerate(frames, start=1):
        first = _same_size(first, frame)
        found = _look(frame, views, board)
        seen.update(side for side, corners in found.items() if isinstance(corners, Corners))
        left, right = found["left"], found["right"]
        if isinstance(left, Corners) and isinstance(right, Corners):
            ordered = agree(left.pixels, right.pixels, board)
            pairs.append(CornerPair(frame.name, left, replace(right, pixels=ordered)))
        else:
            rejected.append(Rejection(frame.name, _why(left, right)))
        if progress is not None:
            progress(done, len(frames), frame.name)
    if not pairs:
        _explain(frames, views, board, seen)
    assert first is not None
    return Detection(first[1], first[2] // views[0].exposures, views, tuple(pairs), tuple(rejected))


def _same_size(first: tuple[str, int, int] | None, frame: NamedFrame) -> tuple[str, int, int]:
    height, width = frame.pixels.shape[:2]
    if first is None:
        return frame.name, width, height
    if (width, height) != first[1:]:
        raise CalibrationError(
            f"{frame.name} is {width}x{height}, but {first[0]} is {first[1]}x{first[2]}: one calibration is for one size"
            ", give the frames of one mode of one camera"
        )
    return first


def _look(frame: NamedFrame, views: tuple[View, View], board: Board) -> dict[Side, Corners | Refusal]:
    sides: tuple[Side, Side] = ("left", "right")
    found: dict[Side, Corners | Refusal] = {}
    for side, view in zip(sides, views, strict=True):
        corners = find_corners(view.cut(frame.pixels), board)
        if isinstance(corners, Refusal):
            found[side] = corners
        else:
            height, width = frame.pixels.shape[:2]
            corner_of_view = np.array(view.rectangle(width, height // view.exposures)[:2], np.float64)
            found[side] = Corners(frame.name, side, corners + corner_of_view)
    return found


def _why(left: Corners | Refusal, right: Corners | Refusal) -> str:
    if isinstance(left, Refusal) and isinstance(right, Refusal):
        same = left.reason == right.reason
        return (
            f"{left.reason} in either view" if same else f"{left.reason} in the left view, {right.reason} in the right"
        )
    side, refusal = ("left", left) if isinstance(left, Refusal) else ("right", right)
    assert isinstance(refusal, Refusal)
    return f"{refusal.reason} in the {side} view"


def _explain(frames: Sequence[NamedFrame], views: tuple[View, View], board: Board, seen: Counter[Side]) -> None:
    """Say why not one frame can be used; always raises."""
    asked = f"{board.columns}x{board.rows}"
    if seen["left"] and seen["right"]:
        raise CalibrationError(
            f"the {asked} board is never in both views of one frame (left view: {seen['left']} frames, right view: "
            f"{seen['right']}): hold it where both views see it whole"
        )
    if seen["left"] or seen["right"]:
        side, other = ("left", "right") if seen["left"] else ("right", "left")
        raise CalibrationError(
            f"the {asked} board is seen in the {side} view of {seen.total()} frames, but never in the {other} view: hold it "
            "where both views see it whole, and check that the layout or rig is the right one"
        )
    other_board = _another_size(frames, views, board)
    if other_board is not None:
        name, found = other_board
        raise CalibrationError(
            f"no {asked} board in any of {len(frames)} frames, but found a {found.columns}x{found.rows} board in {name}: "
            f"pass --board {found.name}"
        )
    raise CalibrationError(
        f"no {asked} board in any of {len(frames)} frames: count the inner corners (one less than the squares), keep the "
        "whole board with a white margin in both views, sharp and evenly lit"
    )


def _another_size(frames: Sequence[NamedFrame], views: tuple[View, View], board: Board) -> tuple[str, Board] | None:
    """Look into a few frames for a chessboard of any size; the size found most often, and the first frame with it."""
    found: list[tuple[str, tuple[int, int]]] = []
    for index in range(min(_FRAMES_TO_EXPLAIN, len(frames))):
        frame = frames[index]
        sizes = (found_sizes(view.cut(frame.pixels)) for view in views)
        found += [(frame.name, size) for size in sizes if size is not None]
    asked = max(board.columns, board.rows), min(board.columns, board.rows)
    found = [(name, size) for name, size in found if size != asked]
    if not found:
        return None
    counts = Counter(size for _, size in found)
    best = max(counts, key=lambda size: (counts[size], size))
    return next((name, Board(*size)) for name, size in found if size == best)
