"""A flat texture on a round thing: seen along its three axes, and blended by where the surface faces. No seams, no poles."""

from __future__ import annotations

import numpy as np

from prismstereo_hw.shapes.shape import Array
from prismstereo_hw.texture import Texture

__all__ = ["triplanar"]

_SHARPNESS = 8  # power of the normal's parts: blended bands are narrow, for a blend of noises has less contrast
_LEAST = 1e-3
_OFFSETS_MM = ((0.0, 0.0), (311.7, 173.3), (97.1, 523.9))  # so that the three do not mirror each other


def triplanar(texture: Texture, point: Array, normal: Array, pixel_mm: Array) -> Array:
    """Return grey levels (N,) at body points (N, 3) with unit normals (N, 3), for pixels of a size (N,) in mm."""
    power = np.abs(normal) ** _SHARPNESS
    weight = np.maximum(power / power.sum(axis=1, keepdims=True) - _LEAST, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    grey = np.zeros(len(point))
    for axis, (du, dv) in enumerate(_OFFSETS_MM):
        seen = weight[:, axis] > 0
        if seen.any():
            u, v = point[seen, axis - 2] + du, point[seen, axis - 1] + dv
            grey[seen] += weight[seen, axis] * texture.shade(u, v, pixel_mm[seen])
    return grey
