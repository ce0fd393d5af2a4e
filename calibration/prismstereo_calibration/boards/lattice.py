"""Whether a picture can hold a chessboard at all: a quick look that spares the slow detectors most pictures without one.

Points where dark and bright change over four times on the way around are everywhere in leaves and gravel. On a board they
stand in rows, equally far apart, the dark squares by turns on the one and on the other diagonal, and the rows hang together.
The largest such net is counted, in the picture and in smaller copies of it where blur is less wide.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["largest_lattice"]

Array = NDArray[np.float64]

_LEVELS = 4
_SMALLEST_SIDE = 16
_RING_PX = 3
_RING = np.rint(_RING_PX * np.stack([f(np.arange(16) * np.pi / 8) for f in (np.cos, np.sin)], axis=-1)).astype(int)
_LEAST_CURVATURE = 1.0  # (grey levels per square pixel) squared: squares 5 grey levels apart have it
_LEAST_SWING = 3.0  # grey levels around a crossing
_LEAST_SYMMETRY = 0.5  # correlation of the ring with its half turn
_MOST = 4000  # crossings of a level, the clearest ones: more are foliage
_NEIGHBOURS = 10  # the nearest ones: of a board seen from the side, the next in its own row is the seventh or so
_STRAIGHT = 0.25  # of a spacing: how far the middle of three in a row may be off
_LIKE = 3.0  # curvatures of neighbours on a board differ by less
_TURNED_OVER = -0.7  # correlation of the grey around neighbours: where the one is dark, the other is bright


def largest_lattice(grey: NDArray[np.uint8]) -> int:
    """Return how many crossings the largest net has that may be a chessboard's, in a grey picture (height, width)."""
    largest = 0
    for _ in range(_LEVELS):
        if min(grey.shape) < _SMALLEST_SIDE:
            break
        largest = max(largest, _largest(*_crossings(grey)))
        grey = np.asarray(cv2.pyrDown(grey), np.uint8)
    return largest


def _crossings(grey: NDArray[np.uint8]) -> tuple[Array, Array, Array]:
    """Find crossings of dark and bright: pixels (N, 2), curvature (N,), and the grey on a ring around (N, 16), length 1."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0).astype(np.float32)
    xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order, ksize=3, scale=0.25) for order in ((2, 0), (0, 2), (1, 1)))
    curvature = xy * xy - xx * yy
    peak = (curvature > _LEAST_CURVATURE) & (curvature >= cv2.dilate(curvature, np.ones((5, 5), np.uint8)))
    peak[:_RING_PX], peak[-_RING_PX:], peak[:, :_RING_PX], peak[:, -_RING_PX:] = False, False, False, False
    y, x = np.nonzero(peak)
    clearest = np.argsort(-curvature[y, x], kind="stable")[:_MOST]
    y, x = y[clearest], x[clearest]
    ring = smooth[y[:, None] + _RING[:, 1], x[:, None] + _RING[:, 0]].astype(np.float64)
    ordered = np.sort(ring, axis=1)
    ring -= (ordered[:, :4].mean(axis=1) + ordered[:, -4:].mean(axis=1))[:, None] / 2
    bright = ring > 0
    changes = (bright != np.roll(bright, 1, axis=1)).sum(axis=1)
    symmetry = (ring * np.roll(ring, 8, axis=1)).sum(axis=1) / np.maximum((ring * ring).sum(axis=1), 1e-6)
    good = (changes == 4) & (symmetry > _LEAST_SYMMETRY) & (np.abs(ring).max(axis=1) > _LEAST_SWING)
    rings = ring[good] / np.linalg.norm(ring[good], axis=1, keepdims=True)
    return np.stack([x, y], axis=-1)[good].astype(np.float64), curvature[y, x][good].astype(np.float64), rings


def _largest(points: Array, curvature: Array, rings: Array) -> int:
    """Return how many points the largest net of equal steps has, diagonals changing over at every step."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if len(points) <= _NEIGHBOURS:
        return len(points)
    distances, places = cKDTree(points).query(points, k=_NEIGHBOURS + 1)
    distance, nearest = np.asarray(distances)[:, 1:], np.asarray(places, np.intp)[:, 1:]
    likeness = curvature[nearest] / curvature[:, None]
    turned_over = np.einsum("nkr,nr->nk", rings[nearest], rings) < _TURNED_OVER
    usable = turned_over & (likeness < _LIKE) & (likeness > 1 / _LIKE)
    step = points[nearest] - points[:, None]
    # In a row a, b, c of a net, a and c stand opposite each other as b sees them.
    pairs = np.linalg.norm(step[:, :, None] + step[:, None], axis=-1)
    opposite = pairs < _STRAIGHT * np.minimum(distance[:, :, None], distance[:, None])
    joined = (opposite & usable[:, :, None] & usable[:, None]).any(axis=2)
    start, which = np.nonzero(joined)
    ends = nearest[start, which]
    graph = coo_matrix((np.ones(len(start)), (start, ends)), shape=(len(points), len(points)))
    _, names = connected_components(graph, directed=False)
    return int(np.bincount(names).max())
