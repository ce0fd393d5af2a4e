"""A disc before a wall, both slanted planes, known everywhere: disparity at any place, and the picture a still would have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling import Grid

__all__ = ["Disc"]

Float = NDArray[np.float32]
_RAYS = 4  # a side, per pixel of the picture


@dataclass(frozen=True, slots=True)
class Disc:
    """Centre and radius in still pixels, disparities in still pixels; the picture is textured, and noisy from `seed`."""

    x: float = 90.5
    y: float = 71.5
    radius: float = 40.0
    seed: int = 3

    def near(self, x: Float, y: Float) -> NDArray[np.bool_]:
        """Tell whether places lie on the disc."""
        return np.asarray(np.hypot(x - self.x, y - self.y) < self.radius)

    def at(self, x: Float, y: Float) -> Float:
        """Return the disparity at places of the still."""
        wall, disc = 30 + 0.02 * x - 0.03 * y, 62 - 0.04 * x + 0.02 * y
        return np.where(self.near(x, y), disc, wall).astype(np.float32)

    def truth(self, size: tuple[int, int]) -> Float:
        """Return the disparity of a still (height, width)."""
        x, y = _places(size)
        return self.at(x, y)

    def low(self, size: tuple[int, int], grid: Grid) -> Float:
        """Return the map (h, w) that sees the disparity at its pixel centres, in pixels of its own."""
        u, v = _places(size)
        x, y = (u + 0.5) * grid.scale_x - 0.5 + grid.shift_x_px, (v + 0.5) * grid.scale_y - 0.5 + grid.shift_y_px
        return self.at(x, y) / np.float32(grid.scale_x)

    def picture(self, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return the still (height, width, 3): an orange disc before a blue wall, pixels on the border mixed by area."""
        rng = np.random.default_rng(self.seed)
        x, y = _places(size)
        steps = (np.arange(_RAYS) + 0.5) / _RAYS - 0.5
        share = np.mean([self.near(x + dx, y + dy) for dx in steps for dy in steps], axis=0)[..., None]
        colour = share * np.array([40.0, 120.0, 200.0]) + (1 - share) * np.array([150.0, 90.0, 60.0])
        texture = 12 * np.sin(0.7 * x + 0.2 * y) + 12 * np.sin(0.5 * y - 0.3 * x)
        noisy = colour + texture[..., None] + rng.normal(0, 3, colour.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _places(size: tuple[int, int]) -> tuple[Float, Float]:
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float32)
    return x, y
