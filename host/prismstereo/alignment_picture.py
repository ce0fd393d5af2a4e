"""A picture of an alignment for people: the raw frame with its seam, pairs of points on their rows, and the figures."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.alignment import Alignment
from prismstereo_hw.frame import RawFrame

__all__ = ["alignment_picture"]

_LINE_PX = 18
_PAIRS = 40  # drawn: more hide the picture
_SEAM_BGR, _GOOD_BGR, _BAD_BGR, _UNKNOWN_BGR = (255, 160, 0), (90, 200, 90), (60, 60, 240), (160, 160, 160)
_COLOURS = {"ok": _GOOD_BGR, "adjust": _BAD_BGR, "unknown": _UNKNOWN_BGR}


def alignment_picture(frame: RawFrame, found: Alignment) -> NDArray[np.uint8]:
    """Paint the first frame of an alignment with its figures below it: (height + lines, width, 3) BGR.

    A pair is a dot in each view; from the dot of the right view a bar ten times as long as the pair is off its row points
    to where it should be.
    """
    grey = frame.pixels.ndim == 2
    picture = np.array(cv2.cvtColor(frame.pixels, cv2.COLOR_GRAY2BGR) if grey else frame.pixels, np.uint8)
    _draw_pairs(picture, found)
    if found.seam is not None:
        ends = [(round(found.seam.column_at(row, frame.height)), row) for row in (0, frame.height - 1)]
        cv2.line(picture, ends[0], ends[1], _SEAM_BGR, 1, cv2.LINE_8)
        for side in (-1, 1) if found.seam.width_px else ():
            edges = [(round(x + side * found.seam.width_px / 2), y) for x, y in ends]
            cv2.line(picture, edges[0], edges[1], _SEAM_BGR, 1, cv2.LINE_4)
    words = np.full((_LINE_PX * len(found.figures) + 10, frame.width, 3), 24, np.uint8)
    for number, figure in enumerate(found.figures, start=1):
        value = "-" if math.isnan(figure.value) else f"{figure.value:.2f}"
        text = f"{figure.verdict:8}{figure.name}: {value}, wish {figure.wish:.2f} +- {figure.tolerance:.2f}"
        place, colour = (8, _LINE_PX * number), _COLOURS[figure.verdict]
        cv2.putText(words, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)
    return np.concatenate([picture, words])


def _draw_pairs(picture: NDArray[np.uint8], found: Alignment) -> None:
    rows = found.rows
    off = rows.right_px[:, 1] - rows.left_px[:, 1]
    order = np.argsort(rows.raw_left_px[:, 1])
    good_px = found.figure("vertical_offset_px").tolerance
    for index in order[:: max(1, rows.count // _PAIRS)]:
        colour = _GOOD_BGR if abs(off[index]) <= good_px else _BAD_BGR
        (x, y), (u, v) = (
            np.rint(points[index]).astype(int).tolist() for points in (rows.raw_left_px, rows.raw_right_px)
        )
        cv2.circle(picture, (x, y), 2, colour, -1, cv2.LINE_AA)
        cv2.circle(picture, (u, v), 2, colour, -1, cv2.LINE_AA)
        cv2.line(picture, (u, v), (u, round(v - 10 * off[index])), colour, 1, cv2.LINE_AA)
