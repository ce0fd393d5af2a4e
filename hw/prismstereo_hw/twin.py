"""The optical twin: a rig and a scene give the raw frame that the real sensor would give, and the truth behind it.

Exact rays per pixel through prism glass and mirrors (see `optics`); a pixel belongs to the view whose prism face its ray
meets, wherever the software thinks the seam is. The twin knows no calibration, and can therefore test one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.coverage import coverage
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.kinds import AnyRig
from prismstereo_hw.optics.sight import Sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.pupil import Pupil
from prismstereo_hw.render import Renderer, Strip
from prismstereo_hw.rig import Mode
from prismstereo_hw.scene import Scene
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.surroundings import Surroundings

__all__ = ["Truth", "Twin"]

Array = NDArray[np.float64]
_MIDDLE = Pupil()
_AS_DRAWN = Surroundings()
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
    A `sensor` takes the place of that plain noise. `rig` is the rig of the file; the frames and the truth are those of
    the rig as its `surroundings` make it stand, but the truth is seen through clean glass and the middle of the pupil.
    """

    rig: AnyRig
    scene: Scene
    mode: Mode | None = None
    noise: float = 1.0
    seed: int = 1
    pupil: Pupil = _MIDDLE
    sensor: SensorModel | None = None
    surroundings: Surroundings = _AS_DRAWN

    @cached_property
    def standing(self) -> AnyRig:
        """The rig as it really stands in its surroundings."""
        return self.surroundings.applied(self.rig)

    @cached_property
    def _mode(self) -> Mode:
        return self.mode or self.rig.camera.video

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self.standing, self._mode, self.pupil, self.surroundings.spots)

    @property
    def _views(self) -> tuple[Sight, Sight]:
        return self._renderer.views

    @property
    def _row_us(self) -> float:
        return self.sensor.rolling_shutter_us if self.sensor else 0.0

    def frame(self, index: int = 0, timestamp_us: int | None = None) -> RawFrame:
        """Expose frame `index` at its time (default: the index over the video rate): (height, width) grey, all views.

        Behind a rolling shutter that is the middle of row 0's exposure. Views that are taken one after the other lie one
        below the other, `height` rows each; the scene rests meanwhile.
        """
        timestamp_us = self._timestamp_us(index, timestamp_us)
        instants = self.sensor.instants_us(timestamp_us) if self.sensor else [float(timestamp_us)]
        grey = self._renderer.grey(self._strips(instants))
        return RawFrame(self._read_out(grey, index), index, timestamp_us, self.surroundings.lens_position)

    def _timestamp_us(self, index: int, timestamp_us: int | None) -> int:
        return round(index * 1e6 / self.rig.camera.video.rate_hz) if timestamp_us is None else timestamp_us

    def _strips(self, instants_us: Sequence[float]) -> list[Strip]:
        """Say which rows see the scene at which times: all at once, or row by row."""

        def scenes(delay_us: float) -> tuple[Scene, ...]:
            return tuple(self.scene.at((instant_us + delay_us) / 1e6) for instant_us in instants_us)

        if not self._row_us:
            return self._renderer.strips(scenes(0.0))
        return [(row, row + 1, scenes(row * self._row_us)) for row in range(self._mode.height)]

    def _read_out(self, grey: NDArray[np.float32], index: int) -> NDArray[np.uint8]:
        rng = np.random.default_rng([self.seed, index])
        if self.sensor:
            return self.sensor.expose(grey, rng)
        if self.noise:
            noise = rng.standard_normal(grey.shape, np.float32)
            noise *= np.float32(self.noise)
            grey += noise
        return np.clip(np.rint(grey, out=grey), 0, 255, out=grey).astype(np.uint8)

    def truth(self, index: int = 0, timestamp_us: int | None = None) -> Truth:
        """Return the truth behind frame `index`; `match_px` is exact to floating point of 32 bits.

        Behind a rolling shutter each pixel has the truth of its own row's time, and so has its match: a match in another
        row is off by what moves between the two rows.
        """
        timestamp_us = self._timestamp_us(index, timestamp_us)
        slopes, rows, shown = self._left_picture()
        h, w = shown.shape
        truth = Truth(
            depth_mm=np.full((h, w), np.nan, np.float32),
            match_px=np.full((h, w, 2), np.nan, np.float32),
            occluded=np.zeros((h, w), bool),
            objects=np.zeros((h, w), np.uint8),
        )
        for top, bottom, (scene,) in self._strips([float(timestamp_us)]):
            here = shown & (rows >= top) & (rows < bottom)
            if here.any():
                self._add_truth(truth, scene, here, slopes[here])
        return truth

    def _add_truth(self, truth: Truth, scene: Scene, shown: NDArray[np.bool_], slopes: Array) -> None:
        """Fill in the truth of pixels `shown` (height, width), whose slopes are (N, 2), while the scene stands like that."""
        left = self._views[0]
        origin, direction = left.rays(slopes)
        reach, which = scene.first_hit(origin, direction)
        hit = np.isfinite(reach)
        point = origin + np.where(hit, reach, 0)[:, None] * direction
        truth.objects[shown] = which + 1
        truth.depth_mm[shown] = np.where(hit, left.view_from_rig(point)[:, 2], np.nan)
        match, visible = self._in_right(scene, point)
        truth.match_px[shown] = np.where((hit & visible)[:, None], match, np.nan)
        truth.occluded[shown] = hit & ~visible

    def _left_picture(self) -> tuple[Array, NDArray[np.intp], NDArray[np.bool_]]:
        """Return slopes (height, width, 2) and raw rows of the left view's upright picture, and where it shows anything."""
        view, width, height = self.standing.views[0], self._mode.width, self._mode.height
        x, y, _, _ = view.rectangle(width, height)
        w, h = view.upright_size(width, height)
        upright = np.stack(np.meshgrid(np.arange(x, x + w, dtype=float), np.arange(y, y + h, dtype=float)), axis=-1)
        raw = view.raw_from_upright(upright, width, height)
        columns, rows = np.rint(raw).astype(np.intp)[..., 0], np.rint(raw).astype(np.intp)[..., 1]
        shown = coverage(self.standing, self._mode)[view.exposure, rows, columns] == 0
        return self.standing.lens(self._mode).slopes(raw), rows, shown

    def _in_right(self, scene: Scene, point: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) into the right view and tell which of them are seen there."""
        right = self._views[1]
        slopes = right.slopes(point)
        pixel = self.standing.lens(self._mode).project_slopes(slopes)
        x, y, w, h = self.standing.views[1].rectangle(self._mode.width, self._mode.height)
        with np.errstate(invalid="ignore"):
            visible = np.all((pixel >= [x, y]) & (pixel <= [x + w - 1, y + h - 1]), axis=1)
        candidates = np.flatnonzero(visible)
        origin, direction = right.rays(slopes[candidates])
        reach, _ = scene.first_hit(origin, direction)
        own = np.linalg.norm(point[candidates] - origin, axis=1)
        lit = view_fates(self.standing, "right", slopes[candidates]).fate == 0
        visible[candidates] = lit & (reach > own * (1 - _SAME_POINT))
        return pixel, visible
