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
from prismstereo_hw.optics.sight import Sight, sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Scene
from prismstereo_hw.view import Side

__all__ = ["Truth", "Twin"]

Array = NDArray[np.float64]
_BAND_PIXELS = 1 << 18  # rows are rendered in bands of about this many pixels, so that memory stays small
_SIDES: tuple[Side, Side] = ("left", "right")
_SAME_POINT = 1e-3  # relative tolerance that says two rays met the same surface point


@dataclass(frozen=True, slots=True)
class Truth:
    """What is really there, for every pixel of the LEFT view's upright picture (height, width), cut from the raw frame.

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
    def _views(self) -> dict[Side, Sight]:
        return {"left": sight(self.rig, "left"), "right": sight(self.rig, "right")}

    @cached_property
    def _seen_by(self) -> NDArray[np.int8]:
        """Which view each pixel of each exposure belongs to, (exposures, height, width): 0 left, 1 right, -1 no light."""
        return np.stack(
            [
                np.concatenate([self._band_seen_by(exposure, *rows) for rows in self._bands()])
                for exposure in range(self.rig.views[0].exposures)
            ]
        )

    def _bands(self) -> list[tuple[int, int]]:
        step = max(1, _BAND_PIXELS // self._mode.width)
        return [(top, min(top + step, self._mode.height)) for top in range(0, self._mode.height, step)]

    def _slopes(self, top: int, bottom: int) -> Array:
        columns, rows = np.meshgrid(np.arange(self._mode.width, dtype=float), np.arange(top, bottom, dtype=float))
        return self.rig.lens(self._mode).slopes(np.stack([columns, rows], axis=-1))

    def _band_seen_by(self, exposure: int, top: int, bottom: int) -> NDArray[np.int8]:
        slopes = self._slopes(top, bottom)
        rows = np.arange(top, bottom)[:, None]
        seen_by = np.full(slopes.shape[:2], -1, np.int8)
        # a direct view is blocked by the mirror of the other one, so whoever meets more surfaces comes first
        for side in sorted(_SIDES, key=lambda side: -len(self.rig.surfaces(side))):
            view = self.rig.views[_SIDES.index(side)]
            if view.exposure == exposure:
                mine = (seen_by < 0) & (rows % view.row_step == view.row_start)
                lit = view_fates(self.rig, side, slopes[mine]).fate == 0
                seen_by[mine] = np.where(lit, _SIDES.index(side), -1)
        return seen_by

    def frame(self, index: int = 0, timestamp_us: int | None = None) -> RawFrame:
        """Expose frame `index` at its time (default: the index over the video rate): (height, width) grey, all views.

        Views that are taken one after the other lie one below the other, `height` rows each; the scene rests meanwhile.
        """
        if timestamp_us is None:
            timestamp_us = round(index * 1e6 / self.rig.camera.video.rate_hz)
        scene = self.scene.at(timestamp_us / 1e6)
        bands = [
            self._render(scene, exposure, *rows) for exposure in range(len(self._seen_by)) for rows in self._bands()
        ]
        grey = np.concatenate(bands)
        rng = np.random.default_rng([self.seed, index])
        noisy = grey + self.noise * rng.standard_normal(grey.shape, np.float32) if self.noise else grey
        return RawFrame(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), index, timestamp_us)

    def _render(self, scene: Scene, exposure: int, top: int, bottom: int) -> NDArray[np.float32]:
        slopes = self._slopes(top, bottom)
        grey = np.zeros(slopes.shape[:2], np.float32)
        seen_by = self._seen_by[exposure, top:bottom]
        for number, side in enumerate(_SIDES):
            lit = seen_by == number
            if lit.any():
                origin, direction = self._views[side].rays(slopes[lit])
                grey[lit] = self._shade(scene, self._views[side].centre_mm, origin, direction)
        return grey

    def _shade(self, scene: Scene, centre_mm: Array, origin: Array, direction: Array) -> Array:
        reach, which = scene.first_hit(origin, direction)
        grey = np.full(len(reach), scene.background_grey)
        way_mm = reach + np.linalg.norm(origin - centre_mm, axis=1)  # from the pinhole: what sizes a pixel's footprint
        pixel_mm = way_mm / self.rig.lens(self._mode).fx_px
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
        slopes, shown = self._left_picture()
        h, w = shown.shape
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

    def _left_picture(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return the slopes (height, width, 2) of the left view's upright picture, and where it shows anything."""
        view, width, height = self.rig.views[0], self._mode.width, self._mode.height
        x, y, _, _ = view.rectangle(width, height)
        w, h = view.upright_size(width, height)
        upright = np.stack(np.meshgrid(np.arange(x, x + w, dtype=float), np.arange(y, y + h, dtype=float)), axis=-1)
        raw = view.raw_from_upright(upright, width, height)
        columns, rows = np.rint(raw).astype(np.intp)[..., 0], np.rint(raw).astype(np.intp)[..., 1]
        return self.rig.lens(self._mode).slopes(raw), self._seen_by[view.exposure, rows, columns] == 0

    def _in_right(self, scene: Scene, point: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) into the right view and tell which of them are seen there."""
        right = self._views["right"]
        slopes = right.slopes(point)
        pixel = self.rig.lens(self._mode).project_slopes(slopes)
        x, y, w, h = self.rig.views[1].rectangle(self._mode.width, self._mode.height)
        with np.errstate(invalid="ignore"):
            visible = np.all((pixel >= [x, y]) & (pixel <= [x + w - 1, y + h - 1]), axis=1)
        candidates = np.flatnonzero(visible)
        origin, direction = right.rays(slopes[candidates])
        reach, _ = scene.first_hit(origin, direction)
        own = np.linalg.norm(point[candidates] - origin, axis=1)
        lit = view_fates(self.rig, "right", slopes[candidates]).fate == 0
        visible[candidates] = lit & (reach > own * (1 - _SAME_POINT))
        return pixel, visible
