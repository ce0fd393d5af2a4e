"""Where the board is seen: its corners in every frame that shows it in two views, and why the other frames do not count.

Pixels are upright coordinates of the view (those of its cut-out picture plus the corner of its rectangle, see
`prismstereo_hw.view`). Corner k of all views of a frame is the same corner of the board; NaN where a view does not show it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.chessboard import agree
from prismstereo_calibration.boards.corners import Found, find_corners, look
from prismstereo_calibration.boards.detection import Detection, NamedFrame, Rejection, Sighting
from prismstereo_calibration.boards.explanation import another_board, explain, reason_of, view_name
from prismstereo_calibration.boards.marker_corners import too_few
from prismstereo_calibration.boards.refusal import Refusal
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.seam import Seam
from prismstereo_hw.view import View

__all__ = ["Progress", "detect", "find_corners"]

Progress = Callable[[int, int, str], None]
"""Told after each frame: frames done, frames in all, the frame's name."""

_SEAM_MARGIN_PX = 4.0  # beside the blended band: what a corner's surroundings reach into it
_ODD_BLUR = 2.5  # times the usual width of edges in a view: something moved, or stood far out of focus
_ODD_BLUR_PX = 4.0
_FEWEST_TO_COMPARE = 5
_FRAMES_BEFORE_DOUBT = 6
Array = NDArray[np.float64]
Looks = tuple[Found | Refusal, ...]


def detect(
    frames: Sequence[NamedFrame],
    views: tuple[View, ...],
    board: Board,
    progress: Progress | None = None,
    seam: Seam | None = None,
) -> Detection:
    """Look for the board in every view of every frame.

    A frame counts where the first view and at least one other show the board. `frames` may be lazy: each is asked for once, and
    three again where no board is in the first six, or in any, to see what else is in them. With a `seam`, corners in its
    blended band are left out. `CalibrationError` where nothing can be calibrated: no frame, one view, frames of two sizes,
    no board, a board of another size, a board in one view only.
    """
    if not frames:
        raise CalibrationError("there is no frame: give the pictures of the board")
    if len(views) < 2:
        raise CalibrationError(f"{len(views)} view: a calibration is between two or more, choose a layout or a rig")
    sightings: dict[int, tuple[Sighting, Array]] = {}
    rejected: dict[int, Rejection] = {}
    looks: list[Looks] = []
    first: tuple[str, int, int] | None = None
    for place, frame in enumerate(frames):
        first = _same_size(first, frame)
        seen = tuple(_look(frame, view, board, seam) for view in views)
        looks.append(seen)
        if isinstance(seen[0], Found) and any(isinstance(one, Found) for one in seen[1:]):
            sightings[place] = _sighting(frame.name, seen, board)
        else:
            rejected[place] = Rejection(frame.name, reason_of(seen))
        if progress is not None:
            progress(place + 1, len(frames), frame.name)
        if place + 1 == _FRAMES_BEFORE_DOUBT < len(frames):
            _doubt(frames, views, board, looks)
    if not sightings:
        explain(frames, views, board, looks)
    blurred = _oddly_blurred(list(sightings.values()))
    rejected |= {place: blurred[number] for number, place in enumerate(sightings) if number in blurred}
    assert first is not None
    clear = tuple(one for place, (one, _) in sightings.items() if place not in rejected)
    refused = tuple(rejected[place] for place in sorted(rejected))
    return Detection(first[1], first[2] // views[0].exposures, views, clear, refused)


def _doubt(frames: Sequence[NamedFrame], views: tuple[View, ...], board: Board, looks: Sequence[Looks]) -> None:
    """Stop where another board than the one asked for is in the first frames: all the others would take minutes for nothing."""
    if any(isinstance(one, Found) for one in chain(*looks)):
        return
    other = another_board(frames, views, board)
    if other is not None:
        raise CalibrationError(f"no {board.name} board in any of the first {_FRAMES_BEFORE_DOUBT} frames, but {other}")


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


def _look(frame: NamedFrame, view: View, board: Board, seam: Seam | None) -> Found | Refusal:
    """Find the board in one view: upright pixels, without what lies in the seam."""
    thinned = (1.0, float(view.row_step))
    found = look(_shown(frame, view), board, thinned if view.turn_deg in (0, 180) else thinned[::-1])
    if isinstance(found, Refusal):
        return found
    height, width = frame.pixels.shape[:2]
    height //= view.exposures
    pixels = found.pixels + np.array(view.rectangle(width, height)[:2], np.float64)
    if seam is not None:
        raw = view.raw_from_upright(pixels, width, height)
        columns = np.array([seam.column_at(row, height) for row in raw[:, 1]])
        with np.errstate(invalid="ignore"):
            blended = np.abs(raw[:, 0] - columns) < seam.width_px / 2 + _SEAM_MARGIN_PX
        if blended.any() and not board.named_corners:
            return Refusal("the board lies over the seam")
        pixels = np.where(blended[:, None], np.nan, pixels)
        few = too_few(board, pixels) if board.named_corners else None
        if few is not None:
            return few
    return Found(pixels, found.edge_px)


def _shown(frame: NamedFrame, view: View) -> NDArray[np.uint8]:
    """Cut a view out of a frame; what lies beyond its polygon, another view perhaps, is painted over."""
    cut = view.cut(frame.pixels)
    if not view.polygon:
        return cut
    height, width = frame.pixels.shape[:2]
    height //= view.exposures
    x, y, _, _ = view.rectangle(width, height)
    columns, rows = np.meshgrid(np.arange(cut.shape[1]) + x, np.arange(cut.shape[0]) + y)
    raw = view.raw_from_upright(np.stack([columns, rows], axis=-1).astype(np.float64), width, height)
    beyond = ~view.shows(raw, width, height)
    painted = cut.copy()
    painted[beyond] = np.mean(cut, axis=(0, 1)).astype(np.uint8)
    return painted


def _sighting(name: str, seen: Looks, board: Board) -> tuple[Sighting, Array]:
    """Join what the views show of one frame: the sighting, and how wide the edges are in each view (V,), NaN for unseen."""
    first = seen[0]
    assert isinstance(first, Found)
    pixels = [first.pixels]
    for one in seen[1:]:
        if isinstance(one, Refusal):
            pixels.append(np.full_like(first.pixels, np.nan))
        else:
            pixels.append(one.pixels if board.named_corners else agree(first.pixels, one.pixels, board))
    edges = np.array([one.edge_px if isinstance(one, Found) else np.nan for one in seen])
    return Sighting.of(name, *pixels), edges


def _oddly_blurred(seen: Sequence[tuple[Sighting, Array]]) -> dict[int, Rejection]:
    """Name the sightings far more blurred in a view than the others: what they show is off without looking it."""
    blurred: dict[int, Rejection] = {}
    edges = np.array([edge for _, edge in seen])
    for view in np.flatnonzero(np.isfinite(edges).sum(axis=0) >= _FEWEST_TO_COMPARE):
        usual = float(np.nanmedian(edges[:, view]))
        with np.errstate(invalid="ignore"):
            odd = np.flatnonzero(edges[:, view] > max(_ODD_BLUR_PX, _ODD_BLUR * usual))
        for number in odd.tolist():
            reason = (
                f"the board is blurred (edges {edges[number, view]:.1f} px wide, {usual:.1f} px in the other frames)"
            )
            blurred.setdefault(number, Rejection(seen[number][0].name, f"{reason} in {view_name(int(view))}"))
    return blurred
