"""Where the board is seen: corner pairs of every frame that shows it in both views, and why the others do not count.

Pixels are upright coordinates of the view (those of its cut-out picture plus the corner of its rectangle, see
`prismstereo_hw.view`). Corner k of both views of a frame is the same corner of the board.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.board import Board
from prismstereo_calibration.corners import Refusal, agree, find_corners, found_sizes
from prismstereo_calibration.detection import Detection, NamedFrame, Rejection, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.view import Side, View

__all__ = ["Progress", "detect", "find_corners"]

Progress = Callable[[int, int, str], None]
"""Told after each frame: frames done, frames in all, the frame's name."""

_FRAMES_TO_EXPLAIN = 3
Array = NDArray[np.float64]


def detect(
    frames: Sequence[NamedFrame], views: tuple[View, View], board: Board, progress: Progress | None = None
) -> Detection:
    """Look for the board in both views of every frame.

    `frames` may be lazy: each is asked for once, at most three again to explain a failure. `CalibrationError` where
    nothing can be calibrated: no frame, frames of two sizes, no board, a board of another size, a board in one view only.
    """
    if not frames:
        raise CalibrationError("there is no frame: give the pictures of the board")
    pairs: list[Sighting] = []
    rejected: list[Rejection] = []
    seen: Counter[Side] = Counter()
    first: tuple[str, int, int] | None = None
    for done, frame in enumerate(frames, start=1):
        first = _same_size(first, frame)
        found = _look(frame, views, board)
        seen.update(side for side, corners in found.items() if not isinstance(corners, Refusal))
        left, right = found["left"], found["right"]
        if not (isinstance(left, Refusal) or isinstance(right, Refusal)):
            pairs.append(Sighting.of(frame.name, left, agree(left, right, board)))
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


def _look(frame: NamedFrame, views: tuple[View, View], board: Board) -> dict[Side, Array | Refusal]:
    sides: tuple[Side, Side] = ("left", "right")
    found: dict[Side, Array | Refusal] = {}
    for side, view in zip(sides, views, strict=True):
        corners = find_corners(view.cut(frame.pixels), board)
        if isinstance(corners, Refusal):
            found[side] = corners
        else:
            height, width = frame.pixels.shape[:2]
            corner_of_view = np.array(view.rectangle(width, height // view.exposures)[:2], np.float64)
            found[side] = corners + corner_of_view
    return found


def _why(left: Array | Refusal, right: Array | Refusal) -> str:
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
