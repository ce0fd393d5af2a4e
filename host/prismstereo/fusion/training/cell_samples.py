"""What the net sees of a cell, and what is really there: samples from still lifes, at random scales and of random quality."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.training.still_lifes import StillLife
from prismstereo.fusion.upsampling.edge_snap import EdgeSnap
from prismstereo.fusion.upsampling.grid import Grid

__all__ = ["Samples", "gather", "low_resolution"]

Float = NDArray[np.float32]
_LEAST_GAP_PX = 2.0  # of a depth edge in still pixels; what is closer is no matter


@dataclass(frozen=True, slots=True)
class Samples:
    """Cells (N): `inputs` (N, F) as `EdgeSnap` makes them, `near` (N, places) 0 or 1, `weights` (N, places)."""

    inputs: Float
    near: Float
    weights: Float

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        """Return many as one."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("inputs", "near", "weights")))


def low_resolution(disparity_px: Float, scale: float) -> Float:
    """Return the disparity (H, W) at the centres of pixels `scale` times as large, in such pixels."""
    high = disparity_px.shape
    low = round(high[0] / scale), round(high[1] / scale)
    rows, columns = (
        np.clip(np.rint((np.arange(few) + 0.5) * many / few - 0.5), 0, many - 1).astype(int)
        for few, many in zip(low, high, strict=True)
    )
    return np.asarray(disparity_px[rows][:, columns] * low[1] / high[1], np.float32)


def gather(lifes: Iterator[StillLife], scales: tuple[float, ...], rng: np.random.Generator) -> Samples:
    """Return the cells across depth edges of still lifes, each taken at each scale, give or take 7 percent."""
    parts = [
        _cells(_worsened(life, rng), float(scale * rng.uniform(0.93, 1.07)), rng) for life in lifes for scale in scales
    ]
    return Samples.joined(parts)


def _worsened(life: StillLife, rng: np.random.Generator) -> StillLife:
    """Return a still life as a lesser camera sees it: softer, of less contrast, noisier, or grey."""
    picture: NDArray[np.uint8] = life.picture
    if rng.random() < 0.5:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.0)), np.uint8)
    if rng.random() < 0.7:
        faint = picture * rng.uniform(0.4, 1.1) + rng.normal(0, rng.uniform(0, 4), picture.shape)
        picture = np.clip(faint, 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)[:, :, None], np.uint8)
    return StillLife(np.ascontiguousarray(picture), life.disparity_px)


def _cells(life: StillLife, scale: float, rng: np.random.Generator) -> Samples:
    top, left = rng.integers(0, int(scale) + 1, 2)
    picture, truth = np.ascontiguousarray(life.picture[top:, left:]), life.disparity_px[top:, left:]
    low = low_resolution(truth, scale)
    snap = EdgeSnap(low.shape, truth.shape, picture.shape[2], Grid.between(low.shape, truth.shape), learned=False)
    cells = snap.look_into(low, picture)
    there = truth[cells.pixel_rows[:, :, None], cells.pixel_columns[:, None, :]].reshape(len(cells.far_px), -1)
    gap = cells.near_px - cells.far_px
    near = np.abs(there - cells.near_px[:, None]) < np.abs(there - cells.far_px[:, None])
    told = np.clip(gap / scale, 0, 1) * (gap > _LEAST_GAP_PX)
    weights = np.broadcast_to(told[:, None], near.shape)
    return Samples(cells.inputs, near.astype(np.float32), weights.astype(np.float32))
