"""Rays through an ordered list of plane surfaces with finite apertures: where they come out, or why they do not.

The oracle of `unfold`, and the only judge of what a pixel really sees: a ray can miss a surface, or fail to be totally
reflected where that was counted on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.view import Side

if TYPE_CHECKING:
    from prismstereo_hw.rig import Rig

__all__ = ["Traced", "trace", "view_fates"]

Array = NDArray[np.float64]
_LEFT_MM = 1e-6  # beyond this a ray has left the surface it was last on


@dataclass(frozen=True, slots=True)
class Traced:
    """Outgoing rays, and for each the reason why there is none.

    `point_mm` and `direction` are (..., 3) in the rig frame; `fate` (...) is 0 for a ray that came through, else the
    index into `fates`.
    """

    point_mm: Array
    direction: Array
    fate: NDArray[np.uint8]
    fates: tuple[str, ...]


def _refract(direction: Array, normal: Array, ratio: float) -> tuple[Array, NDArray[np.bool_]]:
    cos_in = np.sum(direction * normal, axis=-1, keepdims=True)
    normal = np.where(cos_in < 0, -normal, normal)
    cos_in = np.abs(cos_in)
    inside = 1 - ratio**2 * (1 - cos_in**2)
    bent = ratio * direction + (np.sqrt(np.maximum(inside, 0)) - ratio * cos_in) * normal
    return bent, inside[..., 0] >= 0


def trace(surfaces: tuple[Surface, ...], point_mm: Array, direction: Array) -> Traced:
    """Send rays, points and unit directions (..., 3), through the surfaces in order.

    Rays that fail go on as if nothing had happened, so every output is finite or NaN but never refused; look at `fate`.
    """
    fates = ["comes through"]
    fate = np.zeros(direction.shape[:-1], np.uint8)
    point = np.broadcast_to(point_mm, direction.shape)

    def fail(where: NDArray[np.bool_], why: str) -> None:
        fates.append(why)
        fate[where & (fate == 0)] = len(fates) - 1

    for surface in surfaces:
        normal = surface.normal
        point, distance, inside = _meet(surface, point, direction)
        fail(~(inside & (distance > 0)), f"misses the {surface.name}")
        if surface.action == "refract":
            direction, passes = _refract(direction, normal, surface.index_before / surface.index_after)
            fail(~passes, f"cannot leave through the {surface.name}")
        else:
            cos_in = direction @ normal
            if surface.action == "total":
                leaks = surface.index_before**2 * (1 - cos_in**2) < 1
                fail(leaks, f"is not totally reflected at the {surface.name}")
            direction = direction - 2 * cos_in[..., None] * normal
    return Traced(point, direction, fate, tuple(fates))


def view_fates(rig: Rig, side: Side, slopes: Array) -> Traced:
    """Trace the real lens' ideal slopes (..., 2) through one view of a rig, from the entrance pupil, and on to the scene."""
    direction = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return _onwards(trace(rig.surfaces(side), np.zeros(3), direction), rig.obstacles(side))


def _onwards(traced: Traced, obstacles: tuple[Surface, ...]) -> Traced:
    """Give rays that came through, and then run into something, that as their fate."""
    fate, fates = traced.fate.copy(), list(traced.fates)
    for obstacle in obstacles:
        _, distance, inside = _meet(obstacle, traced.point_mm, traced.direction)
        if obstacle.name not in fates:
            fates.append(obstacle.name)
        fate[inside & (distance > _LEFT_MM) & (fate == 0)] = fates.index(obstacle.name)
    return Traced(traced.point_mm, traced.direction, fate, tuple(fates))


def _meet(surface: Surface, point: Array, direction: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return where rays meet a surface's plane, how far ahead, and whether that is within its aperture."""
    normal = surface.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((surface.centre_mm - point) @ normal) / (direction @ normal)
        met = point + distance[..., None] * direction
    offset = met - surface.centre_mm
    inside = (np.abs(offset @ surface.along) <= surface.half_along_mm) & (
        np.abs(offset @ surface.across) <= surface.half_across_mm
    )
    return met, distance, inside
