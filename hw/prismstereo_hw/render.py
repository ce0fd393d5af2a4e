"""Grey levels of raw pixels: exact rays from the pupil through a rig into a scene, strip by strip."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.coverage import SIDES, coverage, hidden_last, own_rows
from prismstereo_hw.modes import from_video
from prismstereo_hw.optics.sight import Sight, sight
from prismstereo_hw.pupil import Pupil, rays_from
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Scene
from prismstereo_hw.surroundings import Spot

__all__ = ["Renderer", "Strip"]

Array = NDArray[np.float64]
_STRIP_PIXELS = 1 << 15  # of a strip, so that its arrays stay in the cache
_THREADS = 2  # numpy lets go of the interpreter while it computes

Strip = tuple[int, int, tuple[Scene, ...]]  # rows top .. bottom - 1; the scene at the instants of their exposure


@dataclass(frozen=True)
class Renderer:
    """What a rig shows in a mode, whatever the scene."""

    rig: Rig
    mode: Mode
    pupil: Pupil
    spots: tuple[Spot, ...] = ()

    @cached_property
    def views(self) -> tuple[Sight, Sight]:
        """The left and the right view."""
        return sight(self.rig, "left"), sight(self.rig, "right")

    @cached_property
    def _blended(self) -> NDArray[np.bool_]:
        return self.pupil.blended(self.rig, self.mode)

    @cached_property
    def _focal_px(self) -> float:
        return self.rig.lens(self.mode).fx_px

    def strips(self, scenes: tuple[Scene, ...]) -> list[Strip]:
        """Cut the frame into strips that are exposed together."""
        step = max(1, _STRIP_PIXELS // self.mode.width)
        height = self.mode.height
        return [(top, min(top + step, height), scenes) for top in range(0, height, step)]

    def grey(self, strips: Sequence[Strip]) -> NDArray[np.float32]:
        """Return grey levels (exposures x height, width) float32 of strips that make up the frame."""
        seen_by, _ = coverage(self.rig, self.mode), self.views
        grey = np.zeros((len(seen_by) * self.mode.height, self.mode.width), np.float32)

        def draw(job: tuple[int, Strip]) -> None:
            exposure, (top, bottom, scenes) = job
            into = grey[exposure * self.mode.height :][top:bottom]
            self._draw(into, scenes, exposure, np.arange(top, bottom))

        with ThreadPoolExecutor(_THREADS) as threads:
            for _ in threads.map(draw, [(exposure, strip) for exposure in range(len(seen_by)) for strip in strips]):
                pass  # an error comes out here
        return grey

    def _draw(
        self, into: NDArray[np.float32], scenes: tuple[Scene, ...], exposure: int, rows: NDArray[np.intp]
    ) -> None:
        columns = np.arange(self.mode.width)
        pixels = np.stack(np.meshgrid(columns.astype(float), rows.astype(float)), axis=-1)
        seen_by = coverage(self.rig, self.mode)[exposure, rows[0] : rows[-1] + 1]
        for number, view in enumerate(self.views):
            sharp = (seen_by == number) & ~self._blended
            if sharp.any():
                origin, direction = view.rays(self._slopes(number, pixels[sharp]))
                into[sharp] = self._shade(scenes, number, pixels[sharp], origin, direction)
        if self._blended.any():
            mixed = pixels[:, self._blended]
            into[:, self._blended] = self._through_pupil(scenes, exposure, mixed.reshape(-1, 2)).reshape(
                mixed.shape[:2]
            )

    def _through_pupil(self, scenes: tuple[Scene, ...], exposure: int, pixels: Array) -> Array:
        """Average over the points of the pupil, each of which looks through whichever mirror its ray meets: (N,) grey."""
        points = self.pupil.points_mm(self.rig.camera.pupil_diameter_mm)
        focus_mm = self.pupil.focused_mm(self.rig)
        total = np.zeros(len(pixels))
        dark = np.ones((len(points), len(pixels)), bool)  # no view has claimed that ray yet
        rows = np.rint(pixels[:, 1]).astype(np.intp)
        for number in hidden_last(self.rig):
            mine = own_rows(self.rig, number, exposure, rows)
            slopes, surfaces = self._slopes(number, pixels), self.rig.surfaces(SIDES[number])
            for point, unclaimed in zip(points, dark, strict=True):
                asked = np.flatnonzero(unclaimed & mine)
                rays = rays_from(point, focus_mm, slopes[asked], surfaces)
                comes = rays.fate == 0
                unclaimed[asked[comes]] = False
                total[asked[comes]] += self._shade(
                    scenes, number, pixels[asked[comes]], rays.point_mm[comes], rays.direction[comes]
                )
        return total / len(points)

    def _spots_on(self, number: int) -> tuple[Spot, ...]:
        return tuple(spot for spot in self.spots if spot.side == SIDES[number])

    def _slopes(self, number: int, pixels: Array) -> Array:
        """Return the ideal slopes (N, 2) at which raw pixels (N, 2) of a view look out, through its drops."""
        for spot in self._spots_on(number):
            if spot.bend:
                pixels = self._pixels(spot.looks_at(self._video_pixels(pixels)))
        return self.rig.lens(self.mode).slopes(pixels)

    def _video_pixels(self, pixels: Array) -> Array:
        scale, dx, dy = from_video(self.rig, self.mode)
        return np.asarray((pixels + 0.5 - np.array([dx, dy])) / scale - 0.5)

    def _pixels(self, video_pixels: Array) -> Array:
        scale, dx, dy = from_video(self.rig, self.mode)
        return np.asarray(scale * (video_pixels + 0.5) - 0.5 + np.array([dx, dy]))

    def _shade(self, scenes: tuple[Scene, ...], number: int, pixels: Array, origin: Array, direction: Array) -> Array:
        """Return grey levels (N,), the mean of all instants, at the ends of rays of a view, dimmed by its dust."""
        behind = origin - self.views[number].centre_mm
        way_mm = np.sqrt(np.einsum("ij,ij->i", behind, behind))  # from the pinhole: what sizes a pixel's footprint
        grey = scenes[0].shade(origin, direction, way_mm, self._focal_px)
        for scene in scenes[1:]:
            grey = grey + scene.shade(origin, direction, way_mm, self._focal_px)
        grey = grey / len(scenes)
        for spot in self._spots_on(number):
            if spot.dark:
                grey = grey * spot.transmission(self._video_pixels(pixels))
        return grey
