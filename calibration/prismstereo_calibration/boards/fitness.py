"""Whether a board is seen well enough to measure by: contrast, width of its edges, tilt and size in pixels.

Corners of a view that fails would be found all the same, only wrong by tenths of a pixel, and nobody would notice. The edges
are measured on the board itself, between dark and bright squares beside the corners; what lies behind may be as blurred as
it likes. The width is the way over which the grey changes if it went on as steeply as in the middle of the edge: 1.2 for the
sharpest picture, 2.5 s for a blur of deviation s, the streak itself for a movement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.saddle import jacobians, sample

__all__ = ["Fitness", "fitness"]

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

_LEAST_CONTRAST = 15.0  # grey levels between dark and bright squares: a tenth of it is noise and steps of grey
_DARK = 64.0  # brighter than that, and it is not for want of light
_BLUR_SHARE = 0.35  # of a square; from half a square on, corners go wrong by tenths of a pixel, and some by whole ones
_BLUR_PX = 7.0  # whatever the squares: of a picture up to 1200 pixels wide, and as many times more of a larger one
_BLUR_PICTURE_PX = 1200.0
_STEEPEST_DEG = 70.0  # squares are a third as high as they are wide, and half a degree more changes that by 2 %
_LEAST_GAP_PX = 3.0  # between corners: the window around a saddle is 5 wide
_PROFILE = np.linspace(-1, 1, 41)
_PROFILE_PX = 10.0
_AROUND = np.stack(np.meshgrid(*[np.linspace(-0.6, 0.6, 13)] * 2), axis=-1).reshape(-1, 2)
_ALONG = np.linspace(0, 1, 4)


@dataclass(frozen=True, slots=True)
class Fitness:
    """How a board is seen. `dark`, `bright`: grey of its squares; `square_px`: the shorter way across a square."""

    dark: float
    bright: float
    edge_px: float
    tilt_deg: float
    square_px: float
    blur_limit_px: float

    def fault(self, board: Board) -> str | None:
        """Say what is too bad to measure by, with the figure and its limit; None if nothing is."""
        if self.bright - self.dark < _LEAST_CONTRAST:
            light = "too dark" if self.bright < _DARK else "too bright" if self.dark > 255 - _DARK else "too flat"
            return (
                f"the board is {light} (its squares are {self.dark:.0f} and {self.bright:.0f} of 255, {_LEAST_CONTRAST:.0f} "
                "apart are the least)"
            )
        if self.tilt_deg > _STEEPEST_DEG:
            return f"the board is seen too much from the side ({self.tilt_deg:.0f} degrees, limit {_STEEPEST_DEG:.0f})"
        gap = float(board.share or 1) if board.kind == "aprilgrid" else 1.0
        if gap * self.square_px < _LEAST_GAP_PX:
            return (
                f"the board is too far away ({gap * self.square_px:.1f} px between corners, limit {_LEAST_GAP_PX:.0f})"
            )
        if self.edge_px > self.blur_limit_px:
            return f"the board is blurred (edges {self.edge_px:.1f} px wide, limit {self.blur_limit_px:.1f})"
        return None


def fitness(grey: Grey, corners: Array, board: Board, stretch: tuple[float, float] = (1.0, 1.0)) -> Fitness:
    """Measure how a board is seen in a grey picture at its corners (N, 2) pixels, NaN where one is unseen.

    `stretch`: by how much the picture must be drawn out in x and y for its pixels to be square.
    """
    seen = np.isfinite(corners).all(axis=1)
    flat, pixels = board.points()[seen, :2] / board.square, corners[seen]
    H, _ = cv2.findHomography(flat.reshape(-1, 1, 2), pixels.reshape(-1, 1, 2))
    if np.shape(H) != (3, 3):
        return Fitness(0.0, 255.0, math.inf, 90.0, 0.0, 0.0)
    J = jacobians(np.asarray(H), flat)
    if not (np.isfinite(J).all() and (np.linalg.det(J) > 0).all()):  # the horizon of the board's plane goes through it
        return Fitness(0.0, 255.0, math.inf, 90.0, 0.0, 0.0)
    square_px = float(np.median(np.linalg.svd(J, compute_uv=False)[:, 1]))
    middle = np.diag(stretch) @ jacobians(np.asarray(H), flat.mean(axis=0)[None])[0]
    longer, shorter = np.linalg.svd(middle, compute_uv=False)
    around = sample(grey, pixels[:, None] + np.einsum("nij,kj->nki", J, _AROUND))
    around = np.where(
        np.isnan(around), np.nanmean(around, axis=1, keepdims=True), around
    )  # the corner itself is inside
    dark, bright = np.percentile(around, [2, 98], axis=1)
    return Fitness(
        float(np.median(dark)),
        float(np.median(bright)),
        _edge_px(grey, pixels, J, board, bright - dark),
        math.degrees(math.acos(min(1.0, float(shorter / longer)))),
        square_px,
        min(_BLUR_PX * max(1.0, max(grey.shape) / _BLUR_PICTURE_PX), _BLUR_SHARE * square_px),
    )


def _edge_px(grey: Grey, pixels: Array, J: Array, board: Board, contrast: Array) -> float:
    """Return the width of the edges that meet in corners (N, 2), the median of those along x or along y, the wider ones."""
    first, last, aside = _free_edge(board)
    widths = []
    for axis in (0, 1):
        along, across = J[:, :, axis], J[:, :, 1 - axis]
        lean = np.abs(np.linalg.det(J)) / np.linalg.norm(along, axis=1)  # pixels from the edge, per square aside
        reach = np.minimum(aside, _PROFILE_PX / np.maximum(lean, 1e-6))
        step_px = lean * reach * (_PROFILE[2] - _PROFILE[0])
        for sign in (1, -1):
            starts = pixels[:, None] + sign * (first + (last - first) * _ALONG)[:, None] * along[:, None]
            profile = starts[:, :, None] + (reach[:, None] * _PROFILE)[:, None, :, None] * across[:, None, None]
            values = sample(grey, profile.reshape(len(pixels), -1, 2)).reshape(profile.shape[:3]).mean(axis=1)
            steepest = np.abs(values[:, 2:] - values[:, :-2]).max(axis=1) / step_px
            widths.append(contrast / np.maximum(steepest, 1e-6))
    one, other = np.concatenate(widths[:2]), np.concatenate(widths[2:])
    return max(float(np.nanmedian(w)) if np.isfinite(w).any() else 0.0 for w in (one, other))


def _free_edge(board: Board) -> tuple[float, float, float]:
    """Return from where to where an edge runs beside a corner, and how far to its sides nothing else is printed: squares."""
    share = float(board.share or 0)
    if board.kind == "chessboard":
        return 0.2, 0.45, 0.3
    if board.kind == "charuco":
        return 0.2, 0.45, min(0.3, (1 - share) / 2)
    return 0.08, min(0.25, 0.8 * share), min(0.12, share)
