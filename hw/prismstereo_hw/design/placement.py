"""Where the mirrors of a prism rig must stand: the closed form of a wished baseline.

What leaves the prism does not depend on the mirrors. Moving a mirror by p along its normal moves the virtual camera by
2 p, so at a given angle one plane gives the wished baseline, and the rays say which strip of that plane they use. Hence
nothing is searched here; `designer` alone chooses.

Everything lies in the xz plane of the rig frame, with the left view's side turned to positive x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.kinds.prism_tir import Mirrors, Prism, PrismRig
from prismstereo_hw.optics.trace import trace
from prismstereo_hw.rig import Camera, RangeWish

__all__ = ["MIRROR_LENGTHS_MM", "ExitRays", "exit_rays", "high_enough", "parallel_angle_deg", "place", "probe"]

Array = NDArray[np.float64]

MIRROR_LENGTHS_MM = (25.4, 38.1, 50.8, 63.5, 76.2)  # stock first-surface mirrors, one to three inches
_CLEARANCE_MM = 0.5  # between the mirror's near edge and the prism's face
_LEAST_MARGIN_MM = 0.2  # of mirror beyond the outermost ray
_ROUNDED_TO = 2  # digits of a mm: what a drawing can ask for


@dataclass(frozen=True, slots=True)
class ExitRays:
    """The left view's middle row behind the prism: points in mm and unit directions, both (N, 2) as x outward and z."""

    point_mm: Array
    direction: Array
    field_deg: tuple[float, float]  # of the columns kept: angles from the optical axis inside the real lens

    @property
    def width_deg(self) -> float:
        """Field of view of one view."""
        return self.field_deg[1] - self.field_deg[0]

    def thinned(self, count: int) -> ExitRays:
        """Return about `count` of the rays, first and last among them: enough to find out what can be had."""
        chosen = np.unique(np.linspace(0, len(self.point_mm) - 1, count).astype(int))
        return ExitRays(self.point_mm[chosen], self.direction[chosen], self.field_deg)


def probe(camera: Camera, prism: Prism, wish: RangeWish) -> PrismRig:
    """Return a rig whose mirrors are large and out of the prism's way; `RigError` where the prism does not fit."""
    mirrors = Mirrors(angle_deg=57.0, near_edge_mm=prism.side_mm, offset_mm=0.0, length_mm=500.0, height_mm=500.0)
    return PrismRig(name="probe", camera=camera, range=wish, prism=prism, mirrors=mirrors)


def exit_rays(rig: PrismRig) -> ExitRays:
    """Trace the left view's middle row through the prism of a rig; `RigError` where hardly anything comes through."""
    lens, video = rig.lens(), rig.camera.video
    x, _, w, _ = rig.views[0].rectangle(video.width, video.height)
    columns = np.arange(x, x + w, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    inward = _unit(slopes)
    traced = trace(rig.surfaces("left")[:-1], np.zeros(3), inward)
    kept = (traced.fate == 0) & (slopes[:, 0] > 0)
    if np.count_nonzero(kept) < 2:
        raise RigError(f"nothing comes through a prism of {rig.prism.side_mm:g} mm in front of {rig.camera.name!r}")
    angles = np.degrees(np.arctan(slopes[kept, 0]))
    outward = np.array([-1.0, 1.0])
    return ExitRays(
        traced.point_mm[kept][:, [0, 2]] * outward,
        traced.direction[kept][:, [0, 2]] * outward,
        (float(angles.min()), float(angles.max())),
    )


def parallel_angle_deg(rays: ExitRays) -> float:
    """Return the mirror angle that makes the two views' middles parallel: 60 - field / 8 where no column is lost."""
    return 60 - (rays.field_deg[0] + rays.field_deg[1]) / 4


def place(
    rays: ExitRays, prism: Prism, pupil_diameter_mm: float, angle_deg: float, baseline_mm: float
) -> Mirrors | None:
    """Return the mirrors that give the baseline at an angle and lose no ray; None where none can be bought or fit in.

    They reach half a beam beyond the outermost rays where there is room, and are as short as stock allows.
    """
    along = np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))])
    normal = np.array([-along[1], along[0]])
    incidence = rays.direction @ normal
    scene = rays.direction - 2 * incidence[:, None] * normal
    first_hits = rays.point_mm - rays.direction * ((rays.point_mm @ normal) / incidence)[:, None]
    centre = _nearest_to_all(
        first_hits, scene
    )  # of the mirror through the pupil; for the wished one, moved along normal
    plane_mm = (baseline_mm / 2 - centre[0]) / (2 * normal[0])
    used = (first_hits + rays.direction * (plane_mm / incidence)[:, None]) @ along
    nearest, farthest = int(np.argmin(used)), int(np.argmax(used))
    half_beam = pupil_diameter_mm / 2 / np.abs(incidence)
    lowest = _lowest(prism, plane_mm * normal, along)
    if lowest > used[nearest] - _LEAST_MARGIN_MM:
        return None
    begin = max(lowest, float(used[nearest] - max(half_beam[nearest], _LEAST_MARGIN_MM)))
    wanted = float(used[farthest] - begin + max(half_beam[farthest], _LEAST_MARGIN_MM))
    length = _stock(wanted) or _stock(float(used[farthest] - begin + _LEAST_MARGIN_MM))
    if length is None:
        return None
    edge = plane_mm * normal + begin * along
    return Mirrors(
        angle_deg=angle_deg,
        near_edge_mm=round(float(edge[0]), _ROUNDED_TO),
        offset_mm=round(float(edge[1]) - prism.pupil_to_prism_mm, _ROUNDED_TO),
        length_mm=length,
        height_mm=length,
    )


def high_enough(rig: PrismRig) -> PrismRig:
    """Return the rig with a prism and mirrors of the least stock size along y that passes the corners of the video."""
    lens, video = rig.lens(), rig.camera.video
    x, _, w, _ = rig.views[0].rectangle(video.width, video.height)
    columns = np.linspace(x, x + w - 1, 65)
    slopes = lens.slopes(np.stack([columns, np.zeros_like(columns)], axis=-1))
    reach = []
    for count in (3, 4):  # up to the prism's exit face, and up to the mirror
        traced = trace(rig.surfaces("left")[:count], np.zeros(3), _unit(slopes))
        reach.append(float(np.abs(traced.point_mm[slopes[:, 0] > 0, 1]).max()) + _LEAST_MARGIN_MM)
    prism_mm, mirror_mm = ((_stock(2 * y) or math.ceil(2 * y)) for y in reach)
    return msgspec.structs.replace(
        rig,
        prism=msgspec.structs.replace(rig.prism, length_mm=float(prism_mm)),
        mirrors=msgspec.structs.replace(rig.mirrors, height_mm=float(mirror_mm)),
    )


def _unit(slopes: Array) -> Array:
    direction = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
    return np.asarray(direction / np.linalg.norm(direction, axis=-1, keepdims=True))


def _stock(length_mm: float) -> float | None:
    return next((size for size in MIRROR_LENGTHS_MM if size >= length_mm), None)


def _nearest_to_all(point: Array, direction: Array) -> Array:
    """Return the point (2,) with the least squared distances to lines through points (N, 2) along unit directions."""
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    normal_matrix = across.T @ across
    return np.asarray(np.linalg.solve(normal_matrix, across.T @ np.sum(across * point, axis=1)))


def _lowest(prism: Prism, origin: Array, along: Array) -> float:
    """Return how far down a mirror can begin: clear of the prism's exit face, and not below its base, where the lens is."""
    face = np.array([math.cos(math.pi / 6), math.sin(math.pi / 6)])  # its outward normal
    corner = np.array([prism.side_mm / 2, prism.pupil_to_prism_mm])
    clear = (_CLEARANCE_MM - float((origin - corner) @ face)) / float(along @ face)
    above_base = (prism.pupil_to_prism_mm - float(origin[1])) / float(along[1])
    return max(clear, above_base)
