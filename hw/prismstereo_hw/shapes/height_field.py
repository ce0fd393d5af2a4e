"""A sheet given by heights z = f(x, y): met by marching no farther than its steepest slope allows, then bracketing.

Within a gap g = z - f(x, y) of the sheet a unit ray (dx, dy, dz) cannot meet it before g / (|dz| + steepest |dx, dy|); so
steps of that length never jump over a ridge. Where they would become tiny, a least step makes a crossing and the
root in it is found by the Illinois method, to 1e-6 mm of gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.shapes.box import through_slabs
from prismstereo_hw.shapes.culling import among_passing
from prismstereo_hw.shapes.heights import Heights
from prismstereo_hw.shapes.pose import Motion, Pose
from prismstereo_hw.shapes.shape import NEAREST_MM, Array
from prismstereo_hw.texture import Texture

__all__ = ["HeightField"]

_LEAST_STEP = 1e-3  # of the sheet's size: thinner ridges may be missed by rays that graze them
_GAP_MM = 1e-6
_ROOT_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class HeightField:
    """A two-sided sheet over the xy rectangle of its pose; the texture lies in x and y and does not follow the slope.

    The heights may change with time (`Heights.at`): each point of the sheet then moves along the body's z.
    """

    name: str
    pose: Pose
    heights: Heights
    texture: Texture
    motion: Motion = field(default_factory=Motion)

    def at(self, seconds: float) -> HeightField:
        """Return this sheet where it is, and as it is shaped, at a time."""
        return replace(self, pose=self.pose.at(self.motion, seconds), heights=self.heights.at(seconds))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) the sheet is met, (N,) mm; inf where it is not."""
        low, high = self.heights.limits_mm()
        middle = self.pose.direction_to_rig(np.array([[0.0, 0.0, (low + high) / 2]]))[0]
        radius = math.hypot(self.heights.half_x_mm, self.heights.half_y_mm, (high - low) / 2)
        return among_passing(origin, direction, self.pose.centre_mm + middle, radius, self._distance)

    def _distance(self, origin: Array, direction: Array) -> Array:
        o, d = self.pose.to_body(origin), self.pose.direction_to_body(direction)
        half_x, half_y = self.heights.half_x_mm, self.heights.half_y_mm
        low, high = self.heights.limits_mm()
        enter, leave = through_slabs(o, d, np.array([-half_x, -half_y, low]), np.array([half_x, half_y, high]))
        enter = np.maximum(enter, NEAREST_MM)
        near = np.flatnonzero(enter < leave)
        reach = np.full(len(o), np.inf)
        if near.size:
            ray = _Rays(self.heights, o[near], d[near])
            reach[near] = ray.first(enter[near], leave[near], _LEAST_STEP * max(half_x, half_y))
        return reach

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        body = self.pose.to_body(point)
        return self.texture.shade(body[:, 0], body[:, 1], pixel_mm)

    def normals(self, point: Array) -> Array:
        """Return unit normals (N, 3) at points (N, 3) of the sheet, towards the body's +z."""
        body = self.pose.to_body(point)
        by_x, by_y = self.heights.gradient(body[:, 0], body[:, 1])
        normal = np.stack([-by_x, -by_y, np.ones_like(by_x)], axis=1)
        return self.pose.direction_to_rig(normal / np.linalg.norm(normal, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays (N, 3) in the body's frame over heights."""

    heights: Heights
    origin: Array
    direction: Array

    def gap(self, which: NDArray[np.intp], reach: Array) -> Array:
        """Return how far above the sheet, along z, some of the rays are after a way."""
        x, y, z = (self.origin[which] + reach[:, None] * self.direction[which]).T
        return np.asarray(z - self.heights.height(x, y))

    def first(self, enter: Array, leave: Array, least_mm: float) -> Array:
        """Return where each ray first meets the sheet between two distances (N,); inf where it does not."""
        rate = np.abs(self.direction[:, 2]) + self.heights.steepest() * np.hypot(*self.direction[:, :2].T)
        met = np.full(len(enter), np.inf)
        on, here = np.arange(len(enter)), enter
        gap = self.gap(on, here)
        while on.size:
            # no longer than to the rim: what lies beyond is not the sheet
            there = np.minimum(here + np.maximum(np.abs(gap) / rate[on], least_mm), leave[on])
            after = self.gap(on, there)
            crossed = (gap * after <= 0) & (gap != 0)
            if crossed.any():
                bracket = (here[crossed], there[crossed], gap[crossed], after[crossed])
                met[on[crossed]] = self._root(on[crossed], *bracket)
            going = ~crossed & (there < leave[on])
            on, here, gap = on[going], there[going], after[going]
        return met

    def _root(self, which: NDArray[np.intp], a: Array, b: Array, gap_a: Array, gap_b: Array) -> Array:
        """Return the crossing between a and b (M,) by regula falsi, halving the end that stays (Illinois)."""
        found = b.copy()
        on = np.flatnonzero(np.abs(gap_b) > _GAP_MM)
        a, b, gap_a, gap_b = a[on], b[on], gap_a[on], gap_b[on]
        for _ in range(_ROOT_ROUNDS):
            if not on.size:
                break
            guess = b - gap_b * (b - a) / (gap_b - gap_a)
            gap = self.gap(which[on], guess)
            found[on] = guess
            flips = gap * gap_b < 0
            a, gap_a = np.where(flips, b, a), np.where(flips, gap_b, gap_a / 2)
            b, gap_b = guess, gap
            going = np.abs(gap) > _GAP_MM
            on, a, b, gap_a, gap_b = on[going], a[going], b[going], gap_a[going], gap_b[going]
        return found
