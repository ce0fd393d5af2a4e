"""Random still lifes of the optical twin's shapes, seen in colour by a plain pinhole: what the net is trained on.

The twin is grey; a colour picture is three of its scenes with the same shapes and other textures. Pixels average two by two
rays, a lens blurs them, a sensor adds noise. The truth is the disparity on the ray through the pixel's centre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.light import Light
from prismstereo_hw.scene import Scene
from prismstereo_hw.shapes.box import Box
from prismstereo_hw.shapes.mesh import Mesh
from prismstereo_hw.shapes.pose import Motion, Pose
from prismstereo_hw.shapes.rectangle import Rectangle
from prismstereo_hw.shapes.shape import Array
from prismstereo_hw.shapes.sphere import Sphere
from prismstereo_hw.shapes.triangles import Triangles, cylinder_triangles
from prismstereo_hw.texture import Noise, Plain

__all__ = ["StillLife", "still_life"]

_Thing = Sphere | Box | Rectangle | Mesh
_FOCAL_WIDTHS = 1.2
_BACKGROUND_GREY = 60.0
_NEAREST_MM, _WALL_MM = 600.0, 2000.0
_PIXELS_AT_WALL = 45.0
_RAYS = 2  # a side, per pixel


@dataclass(frozen=True, slots=True)
class StillLife:
    """A colour picture (H, W, 3) BGR and the disparity behind it, (H, W) float32 pixels."""

    picture: NDArray[np.uint8]
    disparity_px: NDArray[np.float32]


def still_life(seed: int, width: int = 960, height: int = 720) -> StillLife:
    """Return the still life of a seed."""
    rng = np.random.default_rng(seed)
    things = [_wall(rng), _table(rng)] + [_thing(rng) for _ in range(int(rng.integers(30, 60)))]
    focal_px = _FOCAL_WIDTHS * width
    fine = _rays(width * _RAYS, height * _RAYS, focal_px * _RAYS)
    channels = _seen(rng, things, fine, focal_px * _RAYS)
    picture = channels.reshape(height, _RAYS, width, _RAYS, 3).mean((1, 3))
    blur = rng.uniform(0.45, 0.9)
    picture = cv2.GaussianBlur(picture, (0, 0), blur) + rng.normal(0, rng.uniform(0.5, 3.0), picture.shape)
    rays = _rays(width, height, focal_px)
    reach, _ = Scene("still life", tuple(things)).first_hit(np.zeros_like(rays), rays)
    disparity = _PIXELS_AT_WALL * _WALL_MM / (reach * rays[:, 2])
    return StillLife(
        np.clip(np.rint(picture), 0, 255).astype(np.uint8), disparity.reshape(height, width).astype(np.float32)
    )


def _rays(width: int, height: int, focal_px: float) -> Array:
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    rays = np.stack([x.ravel(), y.ravel(), np.full(x.size, focal_px)], 1)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _seen(rng: np.random.Generator, things: list[_Thing], rays: Array, focal_px: float) -> Array:
    """Return what the rays (N, 3) bring in blue, green and red: (N, 3) grey levels."""
    light = Light(towards=(float(rng.uniform(-1, 1)), -0.6, -0.8))
    origin, palette = np.zeros_like(rays), _palette(rng)
    scene = Scene("still life", tuple(things))
    reach, which = scene.first_hit(origin, rays)
    seen = np.full((len(rays), 3), _BACKGROUND_GREY)
    for index, shape in enumerate(things):
        here = which == index
        textures = _colours(rng, palette)
        if not here.any():
            continue
        point, pixel_mm = reach[here, None] * rays[here], reach[here] / focal_px
        share = light.share(point, shape.normals(point), rays[here], _free)
        for channel, texture in enumerate(textures):
            seen[here, channel] = replace(shape, texture=texture).shade(point, pixel_mm) * share
    return np.asarray(np.minimum(seen, 255.0))


def _free(origin: Array, direction: Array) -> Array:
    del direction
    return np.full(len(origin), np.inf)


def _palette(rng: np.random.Generator) -> Array:
    """Return the few colours (N, 3) that all of a scene is painted in: near and far often look alike."""
    grey = rng.uniform(30, 215, int(rng.integers(4, 8)))
    return np.asarray(np.clip(grey[:, None] + rng.normal(0, rng.uniform(4, 30), (len(grey), 3)), 10, 240))


def _colours(rng: np.random.Generator, palette: Array) -> tuple[Plain | Noise, ...]:
    """Return a texture per channel: one colour, clouds of one or several, or patches of two with sharp borders."""
    first, second = (palette[k] + rng.normal(0, 4, 3) for k in rng.integers(0, len(palette), 2))
    kind, seed, texel_mm = rng.random(), int(rng.integers(1, 9)), float(np.exp(rng.uniform(-1.5, 1.5)))
    if kind < 0.15:
        return tuple(Plain(float(mean)) for mean in first)
    if kind < 0.5:
        return tuple(
            Patches(seed, texel_mm, 128.0, 42.0, float(a), float(b)) for a, b in zip(first, second, strict=True)
        )
    contrast = float(rng.choice([3.0, 8.0, 16.0, 30.0, 50.0]))
    seeds = [seed, seed, seed] if kind < 0.85 else rng.integers(1, 9, 3).tolist()
    return tuple(
        Noise(int(seed), texel_mm, float(mean), contrast * float(rng.uniform(0.7, 1.2)))
        for seed, mean in zip(seeds, first, strict=True)
    )


@dataclass(frozen=True, slots=True)
class Patches(Noise):
    """Two grey levels in patches with sharp borders, where a noise of mean 128 is above and below its mean."""

    above: float = 200.0
    below: float = 50.0

    def shade(self, u_mm: Array, v_mm: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at surface coordinates (N,), seen by pixels of a size in mm."""
        share = np.clip((Noise.shade(self, u_mm, v_mm, pixel_mm) - 128.0) / 4.0 + 0.5, 0.0, 1.0)
        return np.asarray(self.below + share * (self.above - self.below))


def _wall(rng: np.random.Generator) -> _Thing:
    tilt = rng.uniform(-0.3, 0.3)
    u = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    return Rectangle("wall", np.array([0.0, 0.0, _WALL_MM]), u, np.array([0.0, 1.0, 0.0]), np.inf, np.inf, Plain())


def _table(rng: np.random.Generator) -> _Thing:
    height = rng.uniform(180, 500)
    v = np.array([0.0, -0.25, 1.0]) / np.hypot(0.25, 1.0)
    centre = np.array([0.0, height, 1300.0])
    return Rectangle("table", centre, np.array([1.0, 0.0, 0.0]), v, np.inf, 700.0, Plain())


def _thing(rng: np.random.Generator) -> _Thing:
    z = float(rng.uniform(_NEAREST_MM, 0.9 * _WALL_MM))
    half = 0.5 * z / _FOCAL_WIDTHS
    centre = np.array([rng.uniform(-half, half), rng.uniform(-0.75 * half, 0.75 * half), z])
    size = half * float(np.exp(rng.uniform(np.log(0.03), np.log(0.35))))
    pose = Pose(centre, Motion(spin_deg_s=tuple(rng.uniform(-180, 180, 3))).turn(1.0))
    kind = rng.integers(5)
    if kind == 0:
        return Sphere("ball", pose, size, Plain())
    if kind == 1:
        return Box("box", pose, tuple(size * rng.uniform(0.15, 1.0, 3)), Plain())
    if kind == 2:
        turn = Motion(spin_deg_s=tuple(rng.uniform((-40, -40, -180), (40, 40, 180)))).turn(1.0)
        sides = size * rng.uniform(0.1, 1.5, 2)
        return Rectangle("card", centre, turn[:, 0], turn[:, 1], float(sides[0]), float(sides[1]), Plain())
    if kind == 3:
        return Mesh("tube", pose, cylinder_triangles(size * rng.uniform(0.1, 0.6), size), Plain())
    return Mesh("leaves", pose, _leaves(rng, 1.5 * size), Plain())


def _leaves(rng: np.random.Generator, length_mm: float) -> Triangles:
    """Return a bush of pointed leaves that all grow from one place."""
    count = int(rng.integers(4, 12))
    along = rng.normal(size=(count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, rng.normal(size=(count, 3)))
    aside *= rng.uniform(0.06, 0.2, (count, 1)) / np.linalg.norm(aside, axis=1, keepdims=True)
    leaves = np.stack([aside, -aside, along], 1) * length_mm
    return Triangles(leaves.reshape(-1, 3), np.arange(3 * count).reshape(count, 3))
