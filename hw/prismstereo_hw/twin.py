"""The optical twin: a rig and a scene give the raw frame that the real sensor would give, and the truth behind it.

Exact rays per pixel through prism glass and mirrors (see `optics`); a pixel belongs to the view whose prism face its ray
meets, wherever the software thinks the seam is. The twin knows no calibration, and can therefore test one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.frame import RawFrame
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import FoldedView, fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Scene
from prismstereo_hw.view import Side

__all__ = ["Truth", "Twin"]

Array = NDArray[np.float64]
_BAND_PIXELS = 1 << 18  # rows are rendered in bands of about this many pixels, so that memory stays small
_SAME_POINT = 1e-3  # relative tolerance that says two rays met the same surface point


@dataclass(frozen=True, slots=True)
class Truth:
    """What is really there, for every pixel of the LEFT view's rectangle (height, width) of the raw frame.

    `depth_mm`: along the left view's optical axis from its paraxial pinhole, NaN where nothing is seen.
    `match_px` (height, width, 2): raw-frame pixel of the same surface point in the RIGHT view, exact, NaN where none.
    `occluded`: seen by the left view alone (hidden, or outside of what the right view shows).
    `objects`: index of the surface plus one, 0 for nothing.
    """

    depth_mm: NDArray[np.float32]
    match_px: NDArray[np.float32]
    occluded: NDArray[np.bool_]
    objects: NDArray[np.uint8]


@dataclass(frozen=True)
class Twin:
    """A simulated rig in front of a scene.

    `noise` is the standard deviation of sensor noise in grey levels; `seed` makes it. The same twin gives the same frames.
    """

    rig: Rig
    scene: Scene
    mode: Mode | None = None
    noise: float = 1.0
    seed: int = 1

    @cached_property
    def _mode(self) -> Mode:
        return self.mode or self.rig.camera.video

    @cached_property
    def _views(self) -> dict[Side, FoldedView]:
        return {"left": fold(self.rig, "left"), "right": fold(self.rig, "right")}

    @cached_property
    def _sees(self) -> NDArray[np.bool_]:
        """Where light comes through, (height, width); the same for every frame."""
        return np.concatenate([self._band_sees(*rows) for rows in self._bands()])

    def _bands(self) -> list[tuple[int, int]]:
        step = max(1, _BAND_PIXELS // self._mode.width)
        return [(top, min(top + step, self._mode.height)) for top in range(0, self._mode.height, step)]

    def _slopes(self, top: int, bottom: int) -> Array:
        columns, rows = np.meshgrid(np.arange(self._mode.width, dtype=float), np.arange(top, bottom, dtype=float))
        return self.rig.lens(self._mode).slopes(np.stack([columns, rows], axis=-1))

    def _band_sees(self, top: int, bottom: int) -> NDArray[np.bool_]:
        slopes = self._slopes(top, bottom)
        sees = np.zeros(slopes.shape[:2], bool)
        for side, mine in _sides(slopes):
            sees[mine] = view_fates(self.rig, side, slopes[mine]).fate == 0
        return sees

    def frame(self, index: int = 0, timestamp_us: int | None = None) -> RawFrame:
        """Expose frame `index` at its time (default: the index over the video rate): (height, width) grey, both views."""
        if timestamp_us is None:
            timestamp_us = round(index * 1e6 / self.rig.camera.video.rate_hz)
        scene = self.scene.at(timestamp_us / 1e6)
        grey = np.concatenate([self._render(scene, *rows) for rows in self._bands()])
        rng = np.random.default_rng([self.seed, index])
        noisy = grey + self.noise * rng.standard_normal(grey.shape, np.float32) if self.noise else grey
        return RawFrame(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), index, timestamp_us)

    def _render(self, scene: Scene, top: int, bottom: int) -> NDArray[np.float32]:
        slopes = self._slopes(top, bottom)
        grey = np.zeros(slopes.shape[:2], np.float32)
        sees = self._sees[top:bottom]
        for side, mine in _sides(slopes):
            lit = mine & sees
            origin, direction = self._views[side].rays(slopes[lit])
            grey[lit] = self._shade(scene, origin, direction)
        return grey

    def _shade(self, scene: Scene, origin: Array, direction: Array) -> Array:
        reach, which = scene.first_hit(origin, direction)
        grey = np.full(len(reach), scene.background_grey)
        pixel_mm = reach / self.rig.lens(self._mode).fx_px
        for index, surface in enumerate(scene.surfaces):
            here = which == index
            if here.any():
                point = origin[here] + reach[here, None] * direction[here]
                grey[here] = surface.shade(point, pixel_mm[here])
        return grey

    def truth(self, index: int = 0, timestamp_us: int | None = None) -> Truth:
        """Return the truth behind frame `index`; `match_px` is exact to floating point of 32 bits."""
        if timestamp_us is None:
            timestamp_us = round(index * 1e6 / self.rig.camera.video.rate_hz)
        scene = self.scene.at(timestamp_us / 1e6)
        x, _, w, h = self.rig.views[0].rectangle(self._mode.width, self._mode.height)
        slopes = self._slopes(0, h)[:, x : x + w]
        shown = self._sees[:h, x : x + w] & (slopes[..., 0] > 0)
        truth = Truth(
            depth_mm=np.full((h, w), np.nan, np.float32),
            match_px=np.full((h, w, 2), np.nan, np.float32),
            occluded=np.zeros((h, w), bool),
            objects=np.zeros((h, w), np.uint8),
        )
        origin, direction = self._views["left"].rays(slopes[shown])
        reach, which = scene.first_hit(origin, direction)
        point = origin + np.where(np.isfinite(reach), reach, 0)[:, None] * direction
        hit = np.isfinite(reach)
        truth.objects[shown] = which + 1
        truth.depth_mm[shown] = np.where(hit, self._views["left"].view_from_rig(point)[:, 2], np.nan)
        match, visible = self._in_right(scene, point)
        truth.match_px[shown] = np.where((hit & visible)[:, None], match, np.nan)
        truth.occluded[shown] = hit & ~visible
        return truth

    def _in_right(self, scene: Scene, point: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) into the right view and tell which of them are seen there."""
        right = self._views["right"]
        slopes = right.slopes(point)
        pixel = self.rig.lens(self._mode).project_slopes(slopes)
        x, y, w, h = self.rig.views[1].rectangle(self._mode.width, self._mode.height)
        within = (pixel[:, 0] >= x) & (pixel[:, 0] <= x + w - 1) & (pixel[:, 1] >= y) & (pixel[:, 1] <= y + h - 1)
        visible = within & (slopes[:, 0] < 0)
        candidates = np.flatnonzero(visible)
        origin, direction = right.rays(slopes[candidates])
        reach, _ = scene.first_hit(origin, direction)
        own = np.linalg.norm(point[candidates] - origin, axis=1)
        lit = view_fates(self.rig, "right", slopes[candidates]).fate == 0
        visible[candidates] = lit & (reach > own * (1 - _SAME_POINT))
        return pixel, visible


def _sides(slopes: Array) -> tuple[tuple[Side, NDArray[np.bool_]], tuple[Side, NDArray[np.bool_]]]:
    """Tell which pixels look through which mirror: rays to the right of the axis cross over to the left one."""
    left = slopes[..., 0] > 0
    return ("left", left), ("right", ~left)
