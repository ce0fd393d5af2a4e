"""The corners of a ChArUco board or an AprilGrid in one picture, as many as it shows.

The markers say which part of the board is where; a homography through all of them, corrected by how far the nearest ones
stand off it (a lens bends), puts each corner to a fraction of a square. There the grey must look like the print: only
then the saddle counts, so a finger on the board, a glare or a wrong count of squares costs corners, and makes none up.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.marker_layout import MarkerLayout, border_modules, marker_layouts
from prismstereo_calibration.boards.markers import Markers, read_markers
from prismstereo_calibration.boards.refusal import NO_BOARD, Refusal
from prismstereo_calibration.boards.saddle import centred, jacobians, refined, sample

__all__ = ["FEWEST_CORNERS", "MIRRORED", "find_marker_corners", "too_few"]

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

FEWEST_CORNERS = 6  # a pose needs 4; with 6 the corners can contradict each other, so a wrong one shows
MIRRORED = Refusal("its markers are mirror images: the view's `mirrored` is wrong")
_FEWEST_MARKERS = 2  # the corners of one alone fit any homography
_STRAY_SHARE = 0.35  # of a marker's side, from where the homography puts it; barrel distortion of k1 -0.3 makes 0.2
_AGREEING_SHARE = 0.7  # of the markers that the board could have: of a board with other counts, one row agrees at most
_FEWEST_ASTRAY = 4  # markers that say so; of clutter, two or three may be taken for some
_FEWEST_BEYOND = 3
_LIKE_SIZE = 2.0
_LEAST_NUMBERS = 50  # markers that are told apart: the board's, and as many again to notice a larger board
_SUPPORT = 8  # nearest known points that correct a corner
_FARTHEST_SUPPORT = 1.6  # squares from a corner to the nearest known point
_ROUNDS = 6
_REACH_SHARE = 0.9  # of what of the print is sure
_MOST_SHIFT = 0.25  # squares between where a corner must be and its saddle
_LIKENESS = 0.6  # correlation with the print: 0.75 is left of it when the blur is as wide as a square
_PATCH = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2), axis=-1).reshape(-1, 2)  # no sample lies on an edge
_LEAST_SPREAD = 0.2  # squares, root mean square off the best line through the corners


@dataclass(frozen=True, slots=True)
class _Match:
    """Markers that lie as on a print, and the homography (3, 3) from its plane to the picture."""

    layout: MarkerLayout
    markers: Markers
    H: Array


def find_marker_corners(grey: Grey, board: Board) -> Array | Refusal:
    """Find the corners (N, 2) float64 pixels of a board with markers in a grey picture, NaN where one is not seen.

    A part of the board is enough: six corners, not on one line.
    """
    match = _match(grey, board)
    if isinstance(match, Refusal):
        other = _match(np.ascontiguousarray(grey[:, ::-1]), board)
        return match if isinstance(other, Refusal) else MIRRORED
    corners = _corners(grey, match)
    few = too_few(board, corners)
    return corners if few is None else few


def too_few(board: Board, corners: Array) -> Refusal | None:
    """Refuse corners (N, 2), NaN where unseen, that are too few to measure by, or all on one line."""
    seen = (board.points() / board.square)[np.isfinite(corners).all(axis=1), :2]
    if len(seen) < FEWEST_CORNERS:
        return Refusal(f"{len(seen)} corners of the board ({FEWEST_CORNERS} are the least)")
    if np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)[1] < _LEAST_SPREAD * np.sqrt(len(seen)):
        return Refusal(f"{len(seen)} corners of the board on one line")
    return None


def _match(grey: Grey, board: Board) -> _Match | Refusal:
    """Find the print whose markers the picture shows best."""
    best: _Match | None = None
    named = beyond = 0
    for border in border_modules(board):
        markers = read_markers(grey, board.dictionary, border, max(_LEAST_NUMBERS, 2 * board.marker_count))
        on_board = markers.those(markers.ids < board.marker_count)
        for layout in marker_layouts(board, border):
            match = _fit(on_board, layout)
            if match is not None and (best is None or len(match.markers.ids) > len(best.markers.ids)):
                best, named = match, len(np.unique(on_board.ids))
                beyond = _beyond(markers, match.markers, board)
            if best is not None and len(best.markers.ids) == named:
                break
        if best is not None:
            break
        named = max(named, len(np.unique(on_board.ids)))
    if beyond >= _FEWEST_BEYOND:
        return Refusal(f"{beyond} markers that {board.name} has not: its counts are wrong")
    if named >= _FEWEST_ASTRAY and (best is None or len(best.markers.ids) < _AGREEING_SHARE * named):
        return Refusal(f"markers that do not lie as on {board.name}: its counts are wrong")
    if best is None:
        return Refusal("a single marker of the board") if named == 1 else NO_BOARD
    return best


def _beyond(markers: Markers, on_board: Markers, board: Board) -> int:
    """Count markers with numbers beyond the board's that are about as large as those on it: the same print, not clutter."""
    likeness = markers.sides_px / np.median(on_board.sides_px)
    like = (likeness < _LIKE_SIZE) & (likeness > 1 / _LIKE_SIZE)
    return len(np.unique(markers.ids[(markers.ids >= board.marker_count) & like]))


def _fit(markers: Markers, layout: MarkerLayout) -> _Match | None:
    """Return the markers that lie as on a print; None for fewer than two, or a plane that shows its back."""
    if len(markers.ids) < _FEWEST_MARKERS:
        return None
    flat, seen = layout.markers[markers.ids], markers.corners
    limit = _STRAY_SHARE * float(np.median(markers.sides_px))
    H, _ = cv2.findHomography(flat.reshape(-1, 1, 2), seen.reshape(-1, 1, 2), cv2.RANSAC, limit)
    if np.shape(H) != (3, 3):
        return None
    off = np.linalg.norm(_projected(np.asarray(H, np.float64), flat) - seen, axis=-1).max(axis=1)
    agreeing = off < np.minimum(2 * limit, 2 * _STRAY_SHARE * markers.sides_px)
    for number in np.unique(markers.ids[agreeing]):  # of two with one number, the better placed one is on the board
        twins = np.flatnonzero(agreeing & (markers.ids == number))
        agreeing[twins] = twins == twins[np.argmin(off[twins])]
    if agreeing.sum() < _FEWEST_MARKERS:
        return None
    H, _ = cv2.findHomography(flat[agreeing].reshape(-1, 1, 2), seen[agreeing].reshape(-1, 1, 2))
    if np.shape(H) != (3, 3) or (np.linalg.det(jacobians(H, flat[agreeing].reshape(-1, 2))) <= 0).any():
        return None
    return _Match(layout, markers.those(agreeing), np.asarray(H))


def _projected(H: Array, flat: Array) -> Array:
    return np.reshape(cv2.perspectiveTransform(flat.reshape(-1, 1, 2), H), flat.shape).astype(np.float64)


def _corners(grey: Grey, match: _Match) -> Array:
    """Find the saddles (N, 2) outwards from the markers; those found so far say where the next ones must be."""
    layout = match.layout
    places = [layout.markers[match.markers.ids].reshape(-1, 2)]
    off = [match.markers.corners.reshape(-1, 2) - _projected(match.H, places[0])]
    corners, open_ = np.full_like(layout.saddles, np.nan), np.ones(len(layout.saddles), bool)
    for _ in range(_ROUNDS):
        rest = np.flatnonzero(open_)
        shift, nearest = _carried(np.concatenate(places), np.concatenate(off), layout.saddles[rest])
        near = nearest < _FARTHEST_SUPPORT
        rest = rest[near]
        if not len(rest):
            break
        straight = _projected(match.H, layout.saddles[rest])
        found, good = _saddles(grey, match, rest, straight + shift[near])
        open_[rest] = False
        corners[rest[good]] = found[good]
        places.append(layout.saddles[rest[good]])
        off.append(found[good] - straight[good])
    return corners


def _carried(places: Array, off: Array, wanted: Array) -> tuple[Array, Array]:
    """Carry what known places (M, 2) are off by to wanted ones (N, 2): the shifts (N, 2), and the nearest one's distance."""
    distance = np.linalg.norm(wanted[:, None] - places[None], axis=-1)
    count = min(_SUPPORT, len(places))
    nearest = np.argpartition(distance, count - 1, axis=1)[:, :count]
    reach = np.take_along_axis(distance, nearest, axis=1)
    weight = 1 / (reach**2 + 0.1)
    shift = (weight[..., None] * off[nearest]).sum(axis=1) / weight.sum(axis=1, keepdims=True)
    return shift, reach.min(axis=1)


def _saddles(grey: Grey, match: _Match, which: NDArray[np.intp], start: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Refine corners `which` from where they must be (N, 2), and tell where the picture looks like the print."""
    stretch = jacobians(match.H, match.layout.saddles[which])
    square_px = np.asarray(np.linalg.svd(stretch, compute_uv=False)[:, 1], np.float64)
    reach = _REACH_SHARE * match.layout.reach
    height, width = grey.shape
    inside = ((start > 1) & (start < [width - 2, height - 2])).all(axis=1)
    found = np.full_like(start, np.nan)
    if inside.any():
        rough = refined(grey, start[inside], reach * square_px[inside])
        arms = [_arms(match, which[inside], sign * reach * _PATCH[: len(_PATCH) // 2]) for sign in (1, -1)]
        found[inside] = centred(grey, rough, *arms)
    near = np.linalg.norm(found - start, axis=1) <= np.maximum(_MOST_SHIFT * square_px, 1.0)
    patches = sample(grey, found[:, None] + np.einsum("nij,kj->nki", stretch, reach * _PATCH))
    print_ = match.layout.shade(reach * _PATCH)[which]
    return found, near & (_correlation(patches, print_) > _LIKENESS)


def _arms(match: _Match, which: NDArray[np.intp], offsets: Array) -> Array:
    """Return how far in pixels (N, K, 2) places of the print at offsets (K, 2) squares are from their corners."""
    places = match.layout.saddles[which, None] + offsets
    return _projected(match.H, places) - _projected(match.H, match.layout.saddles[which])[:, None]


def _correlation(patches: Array, prints: Array) -> Array:
    """Return the correlation (N,) of patches with prints (N, K); 0 for a flat patch or one that leaves the picture."""
    a, b = (values - values.mean(axis=1, keepdims=True) for values in (patches, prints))
    norm = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num((a * b).sum(axis=1) / norm))
