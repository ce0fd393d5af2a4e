"""Units whose mirrors crept after they were calibrated: ordinary scenes as traced points, and depth held to the truth.

Points go through the glass and both reflections (`FoldedView.slopes`) of the rig as it stands now, mirrors turned about
any line of their own, and get noise in each view and some mistaken partners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.judging.triangulation import triangulate
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.solving.poses import rotations
from prismstereo_calibration.upkeep.known_distance import known_distance
from prismstereo_calibration.upkeep.pose_fit import KnownDepth
from prismstereo_calibration.upkeep.sightlines import SceneMatches
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import FoldedView, fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

Array = NDArray[np.float64]

CREEP_DEG = 0.05
WAYS = ("turn", "tip")
_RIM_PX = 6.0
_MISTAKEN = 0.03  # of the matches
_TAPE = 0.001  # of a distance that was measured
_SIDES: tuple[Side, Side] = ("left", "right")


def exact_calibration(rig: Rig) -> Calibration:
    """What a perfect calibration of the unit as drawn would be, glass and all."""
    left, right = (fold(rig, side) for side in _SIDES)
    plate = Plate(left.plate_mm, left.index)
    from_left, from_right = (view.view_from_rig(np.zeros(3)) for view in (left, right))
    R = right.R @ left.R.T
    return replace(
        Calibration.nominal(rig),
        left=Camera.at_origin(rig.lens(), plate),
        right=Camera(rig.lens(), R, from_right - R @ from_left, plate),
    )


@dataclass(frozen=True)
class Unit:
    """A rig as it stands: its two views."""

    rig: Rig
    left: FoldedView
    right: FoldedView

    @classmethod
    def drawn(cls, rig: Rig) -> Unit:
        return cls(rig, fold(rig, "left"), fold(rig, "right"))

    def crept(self, side: Side, way: str, angle_deg: float = CREEP_DEG, pivot_mm: float = 0.0) -> Unit:
        """One mirror turned about the vertical, or tipped, about a line so far along it from its middle."""
        mirror, view = self.rig.surfaces(side)[-1], fold(self.rig, side)
        axis = mirror.across if way == "turn" else mirror.along
        turn = rotations(axis * math.radians(angle_deg))
        pivot = mirror.centre_mm + pivot_mm * mirror.along
        moved = replace(
            mirror,
            centre_mm=pivot + turn @ (mirror.centre_mm - pivot),
            along=turn @ mirror.along,
            across=turn @ mirror.across,
        )
        (M, m), (N, n) = mirror.reflection(), moved.reflection()
        stands = FoldedView(side, view.R @ M @ N, view.R @ (M @ n + m) + view.t, view.plate_mm, view.index)
        return replace(self, **{side: stands})

    def pixels(self, side: Side, points: Array) -> Array:
        """Pixels (N, 2) of rig points (N, 3) in a view, NaN where it does not show them."""
        view: FoldedView = self.left if side == "left" else self.right
        video, slopes = self.rig.camera.video, view.slopes(points)
        pixels = self.rig.lens().project_slopes(slopes)
        x, y, w, h = self.rig.views[_SIDES.index(side)].rectangle(video.width, video.height)
        low, high = np.array([x, y]) + _RIM_PX, np.array([x + w - 1, y + h - 1]) - _RIM_PX
        lit = view_fates(self.rig, side, np.nan_to_num(slopes)).fate == 0
        return np.where(((pixels >= low) & (pixels <= high)).all(axis=1)[:, None] & lit[:, None], pixels, np.nan)

    def matches(
        self, points: Array, rng: np.random.Generator, noise_px: float, name: str = "", mistaken: float = 0.0
    ) -> tuple[SceneMatches, Array]:
        """What both views show of points, with noise and mistakes, and the points themselves."""
        left, right = (self.pixels(side, points) for side in _SIDES)
        seen = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
        left, right = (pixels[seen] + rng.normal(0, noise_px, pixels[seen].shape) for pixels in (left, right))
        wrong = rng.random(len(right)) < mistaken
        right[wrong] += rng.uniform(-20, 20, (int(wrong.sum()), 2))
        return SceneMatches(name, left, right), points[seen]

    def scenes(
        self, rng: np.random.Generator, count: int = 10, matches: int = 1000, noise_px: float = 0.2
    ) -> list[SceneMatches]:
        """Ordinary scenes: six things between half a metre and four metres each."""
        wide = 1.3 * math.tan(math.radians(self.rig.camera.hfov_deg / 4))
        high = self.rig.camera.video.height / 2 / self.rig.lens().fy_px
        found, tried = [], round(2.5 * matches)
        for number in range(count):
            depth = rng.uniform(500, 4000, 6)[rng.integers(6, size=tried)] * rng.uniform(0.95, 1.05, tried)
            slopes = rng.uniform([-wide, -high], [wide, high], (tried, 2))
            points = np.column_stack([slopes * depth[:, None], depth])
            scene, _ = self.matches(points, rng, noise_px, f"scene{number:02d}", _MISTAKEN)
            found.append(scene.only(np.arange(len(scene.left_px)) < matches))
        return found

    def depths(self, calibration: Calibration, points: Array, pixels: SceneMatches) -> tuple[Array, Array]:
        """Depth (N,) of points as the calibration has it and as it is, along its own rectified z axis."""
        z = rectification(calibration).left.R_rectified_from_left[2]
        found, _ = triangulate(calibration, pixels.left_px, pixels.right_px)
        return found @ z, self.left.view_from_rig(points) @ z

    def bias(self, calibration: Calibration, distance_mm: float = 1000.0) -> float:
        """Mean relative error of depth over the common field at a distance."""
        pixels, points = self.plane(distance_mm, np.random.default_rng(0), 0.0, 3.0)
        found, true = self.depths(calibration, points, pixels)
        return float(np.mean(found / true) - 1)

    def plane_at(
        self, calibration: Calibration, distance_mm: float, rng: np.random.Generator, noise_px: float = 0.2
    ) -> KnownDepth:
        """A facing plane whose distance was measured with a tape, not quite right."""
        pixels, points = self.plane(distance_mm, rng, noise_px, 1.0)
        true = float(np.median(self.depths(calibration, points, pixels)[1]))
        return known_distance(calibration, pixels, true * (1 + rng.normal(0, _TAPE)))

    def plane(
        self, distance_mm: float, rng: np.random.Generator, noise_px: float, size: float
    ) -> tuple[SceneMatches, Array]:
        """What both views show of a facing plane, a fifth of its distance wide times `size`, and its points."""
        grid = np.stack(np.meshgrid(np.linspace(-1, 1, 25), np.linspace(-1, 1, 13)), axis=-1).reshape(-1, 2)
        flat = grid * np.array([0.1, 0.05]) * size * distance_mm
        return self.matches(np.column_stack([flat, np.full(len(flat), distance_mm)]), rng, noise_px)


def one_creep(unit: Unit, trial: int, rng: np.random.Generator) -> Unit:
    """Trial by trial: either mirror, turned or tipped, either way, about any line of it."""
    side, way = _SIDES[trial % 2], WAYS[trial // 2 % 2]
    return unit.crept(side, way, (CREEP_DEG, -CREEP_DEG)[trial // 4 % 2], float(rng.uniform(-25, 25)))
