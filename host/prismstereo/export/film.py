"""Depth as a film: one picture a frame, whose colours mean the same distance from one to the next."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator
from itertools import chain, islice, pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.picture import LEGEND_WIDTH, depth_picture, disparity_span
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import DataError, UsageError

__all__ = ["ENDINGS", "write_film"]

ENDINGS = {".mp4": "mp4v", ".avi": "MJPG"}
_LOOKED_AT = 12  # frames, of which the middle step of time is the film's
_NS_PER_S = 1e9
_RATE_HZ = 15.0  # of a single frame
_SLOWEST_HZ, _FASTEST_HZ = 0.5, 240.0


def write_film(out: Path, frames: Iterable[ExportFrame]) -> tuple[int, float]:
    """Write a film of depth beside the rectified left picture; return its frames and its rate in Hz.

    The colours' range grows with what is seen and never shrinks. Pictures that come more seldom stand until the next.
    UsageError for an ending that is not one of `ENDINGS`, DataError where there are no frames or the film cannot be written.
    """
    code = ENDINGS.get(out.suffix.lower())
    if code is None:
        raise UsageError(f"{out}: a film ends in {' or '.join(ENDINGS)}")
    ahead = iter(frames)
    begin = list(islice(ahead, _LOOKED_AT))
    if not begin:
        raise DataError(f"there are no frames to write to {out}: see what the source holds")
    pictured = any(frame.left is not None for frame in begin)
    rate_hz = _rate_hz([frame.timestamp_ns for frame in begin])
    unfinished = out.parent / f".{secrets.token_hex(6)}{out.suffix.lower()}"
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        count = _written(unfinished, code, rate_hz, _pictures(chain(begin, ahead), pictured=pictured))
        unfinished.replace(out)
    except OSError as error:
        raise DataError(f"cannot write {out}: {error.strerror}: give a folder that can be written to") from error
    finally:
        unfinished.unlink(missing_ok=True)
    return count, rate_hz


def _rate_hz(stamps_ns: list[int]) -> float:
    steps = [later - sooner for sooner, later in pairwise(stamps_ns) if later > sooner]
    rate_hz = _NS_PER_S / float(np.median(steps)) if steps else _RATE_HZ
    return min(max(rate_hz, _SLOWEST_HZ), _FASTEST_HZ)


def _pictures(frames: Iterable[ExportFrame], *, pictured: bool) -> Iterator[NDArray[np.uint8]]:
    low, high = np.inf, -np.inf
    left: NDArray[np.uint8] | None = None
    size: tuple[int, int] | None = None
    for frame in frames:
        own = disparity_span(frame.disparity)
        low, high = min(low, own[0]), max(high, own[1])
        factor = frame.geometry.decimated
        shown = depth_picture(_enlarged(frame.disparity, factor), frame.geometry.unit, (low, high))
        if pictured:
            left = _colour(frame.left, factor) if frame.left is not None else left
            shown = np.concatenate([_beside(left, shown), shown], axis=1)
        size = size or (shown.shape[1] & ~1, shown.shape[0] & ~1)  # coders want even sides
        yield np.ascontiguousarray(_cut(shown, size))


def _enlarged(disparity: DisparityMap, factor: int) -> DisparityMap:
    """Give a map of less than the full resolution the size of the others; its values and its window stay."""
    large = np.repeat(np.repeat(disparity.disparity_px, factor, axis=0), factor, axis=1)
    return DisparityMap(large, disparity.window)


def _colour(picture: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    large = np.repeat(np.repeat(picture, factor, axis=0), factor, axis=1)
    return large if large.ndim == 3 else np.repeat(large[..., None], 3, axis=2)


def _beside(left: NDArray[np.uint8] | None, shown: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give the picture that stands beside: the last that came, dark before the first."""
    if left is None:
        return np.zeros((shown.shape[0], shown.shape[1] - LEGEND_WIDTH, 3), np.uint8)
    return _cut(left, (shown.shape[1] - LEGEND_WIDTH, shown.shape[0]))


def _cut(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Cut a picture to a width and height, or fill it up with black: full and half resolution differ by a pixel or so."""
    width, height = size
    cut = picture[:height, :width]
    missing = ((0, height - cut.shape[0]), (0, width - cut.shape[1]), (0, 0))
    return np.pad(cut, missing)


def _written(path: Path, code: str, rate_hz: float, pictures: Iterator[NDArray[np.uint8]]) -> int:
    first = next(pictures)
    four = cv2.VideoWriter.fourcc(*code)
    writer = cv2.VideoWriter(str(path), four, rate_hz, (first.shape[1], first.shape[0]))
    count = 0
    try:
        if not writer.isOpened():
            raise DataError(
                f"no {path.suffix[1:]} film of {first.shape[1]}x{first.shape[0]} can be begun: this OpenCV lacks the coder "
                f"{code}, or the folder cannot be written to"
            )
        for picture in chain([first], pictures):
            writer.write(picture)
            count += 1
    finally:
        writer.release()
    return count
