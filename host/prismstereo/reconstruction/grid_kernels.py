"""Compiled loops over a grid of pixels: where it is cut, which triangles are left of it, and which way it faces.

`cuts` (H, W) uint8 says of each pixel whether the grid is cut between it and its right (bit 1) and lower (bit 2) neighbour.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled, compiled_any

__all__ = ["BELOW", "RIGHT", "cut_grid", "face_normals", "mark_used", "place_points", "write_triangles"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Index = NDArray[np.uint32]

RIGHT = 1
BELOW = 2
_SLOPE_REACH = 3
_NORMAL_REACH = 2
_SQUARES = np.float32(50.0)  # sum of dx^2 over the 25 pixels of a whole square
_FEWEST = 4  # pixels that a normal is made of


@compiled
def _leaps(before: float, near: float, far: float, after: float, allowed: float) -> bool:
    """Tell whether two neighbours differ by more than the slope at either side, and noise, explain; NaN: no such pixel."""
    step = far - near
    low, high = (near - before) / _SLOPE_REACH, (after - far) / _SLOPE_REACH
    if math.isnan(low):
        low = high
    if math.isnan(high):
        high = low
    if math.isnan(low):
        low = high = 0.0
    if low > high:
        low, high = high, low
    return not (low - allowed <= step <= high + allowed)


@compiled_any
def cut_grid(inverse: Float, sigma: Float, sigmas: float, first: int, end: int, cuts: Byte) -> None:
    """Write rows `first` .. `end` - 1 of `cuts`: between neighbours of which one is missing, or that lie on two surfaces.

    A step of a pixel or more to the right is a surface that the right view cannot see: it hides itself there.
    """
    height, width = inverse.shape
    m = _SLOPE_REACH
    for y in range(first, end):
        for x in range(width):
            own, noise = inverse[y, x], sigma[y, x]
            bits = RIGHT | BELOW
            if not math.isnan(own):
                if x + 1 < width and not math.isnan(inverse[y, x + 1]):
                    other = inverse[y, x + 1]
                    allowed = sigmas * math.sqrt(noise * noise + sigma[y, x + 1] ** 2)
                    before = inverse[y, x - m] if x >= m else np.nan
                    after = inverse[y, x + 1 + m] if x + 1 + m < width else np.nan
                    if other - own < 1.0 + allowed and not _leaps(before, own, other, after, allowed):
                        bits &= ~RIGHT
                if y + 1 < height and not math.isnan(inverse[y + 1, x]):
                    allowed = sigmas * math.sqrt(noise * noise + sigma[y + 1, x] ** 2)
                    before = inverse[y - m, x] if y >= m else np.nan
                    after = inverse[y + 1 + m, x] if y + 1 + m < height else np.nan
                    if not _leaps(before, own, inverse[y + 1, x], after, allowed):
                        bits &= ~BELOW
            cuts[y, x] = bits


@compiled
def _upper(cuts: Byte, y: int, x: int) -> bool:
    return bool(cuts[y, x] == 0)


@compiled
def _lower(cuts: Byte, y: int, x: int) -> bool:
    return bool((cuts[y, x + 1] & BELOW) == 0 and (cuts[y + 1, x] & RIGHT) == 0)


@compiled_any
def mark_used(cuts: Byte, used: Byte) -> int:
    """Mark with 1 in `used` (H, W), zeros before, the pixels that triangles have as corners; return how many triangles."""
    height, width = cuts.shape
    count = 0
    for y in range(height - 1):
        for x in range(width - 1):
            if _upper(cuts, y, x):
                count += 1
                used[y, x] = used[y + 1, x] = used[y, x + 1] = 1
            if _lower(cuts, y, x):
                count += 1
                used[y, x + 1] = used[y + 1, x] = used[y + 1, x + 1] = 1
    return count


@compiled_any
def write_triangles(cuts: Byte, number: Index, triangles: Index) -> None:
    """Write the triangles (M, 3) of pixels' numbers (H, W), counter-clockwise as the camera sees them."""
    height, width = cuts.shape
    at = 0
    for y in range(height - 1):
        for x in range(width - 1):
            right, below = number[y, x + 1], number[y + 1, x]
            if _upper(cuts, y, x):
                triangles[at, 0], triangles[at, 1], triangles[at, 2] = number[y, x], below, right
                at += 1
            if _lower(cuts, y, x):
                triangles[at, 0], triangles[at, 1], triangles[at, 2] = right, below, number[y + 1, x + 1]
                at += 1


@compiled
def _plane_slopes(n: float, x: float, y: float, xx: float, xy: float, yy: float, v: float, xv: float, yv: float) -> (
    tuple[float, float]
):  # fmt: skip
    """Return the slopes along x and y of the plane through values of which these are the sums; NaN where there is none."""
    xx, xy, yy = xx - x * x / n, xy - x * y / n, yy - y * y / n
    xv, yv = xv - x * v / n, yv - y * v / n
    determinant = xx * yy - xy * xy
    if n < _FEWEST or determinant <= 1e-6:
        return np.nan, np.nan
    return (xv * yy - yv * xy) / determinant, (yv * xx - xv * xy) / determinant


@compiled
def _slopes(inverse: Float, cuts: Byte, y: int, x: int) -> tuple[float, float]:
    """Return the slopes of the disparity at a pixel, from those around it that are joined to it."""
    height, width = inverse.shape
    own = inverse[y, x]
    n = sx = sy = sxx = sxy = syy = sv = sxv = syv = 0.0
    for direction in (-1, 1):
        for dy in range(0 if direction < 0 else 1, _NORMAL_REACH + 1):
            row = y + direction * dy
            if row < 0 or row >= height or (dy and cuts[row if direction < 0 else row - 1, x] & BELOW):
                break
            for side in (-1, 1):
                for dx in range(0 if side < 0 else 1, _NORMAL_REACH + 1):
                    column = x + side * dx
                    if column < 0 or column >= width or (dx and cuts[row, column if side < 0 else column - 1] & RIGHT):
                        break
                    a, b, value = float(side * dx), float(direction * dy), inverse[row, column] - own
                    n += 1.0
                    sx += a
                    sy += b
                    sxx += a * a
                    sxy += a * b
                    syy += b * b
                    sv += value
                    sxv += a * value
                    syv += b * value
    return _plane_slopes(n, sx, sy, sxx, sxy, syy, sv, sxv, syv)


@compiled
def _whole(cuts: Byte, y: int, x: int) -> bool:
    """Tell whether nothing is cut in the square around a pixel."""
    reach = _NORMAL_REACH
    if y < reach or x < reach or y >= cuts.shape[0] - reach or x >= cuts.shape[1] - reach:
        return False
    found = np.uint8(0)
    for row in range(y - reach, y + reach + 1):
        for column in range(x - reach, x + reach + 1):
            found |= cuts[row, column]
    return bool(found == 0)


@compiled
def _whole_slopes(inverse: Float, y: int, x: int) -> tuple[float, float]:
    """Return the slopes of the plane through all of the square around a pixel: `_slopes` of it, but quick."""
    reach = _NORMAL_REACH
    by_x = by_y = np.float32(0)
    for dy in range(-reach, reach + 1):
        sums = np.float32(0)
        for dx in range(-reach, reach + 1):
            value = inverse[y + dy, x + dx]
            sums += value
            by_x += np.float32(dx) * value
        by_y += np.float32(dy) * sums
    return float(by_x / _SQUARES), float(by_y / _SQUARES)


@compiled_any
def place_points(
    inverse: Float, sigma: Float, pixels: Index, pinhole: tuple[float, float, float], scale: float, first: int, end: int,
    points: Float, sigmas: Float,
) -> None:  # fmt: skip
    """Write rows `first` .. `end` - 1 of points (N, 3) and their sigmas along the ray (N,), at pixels (N,) of a grid."""
    width = np.uint32(inverse.shape[1])
    focal, cx, cy = pinhole
    for i in range(first, end):
        row, column = pixels[i] // width, pixels[i] % width
        x, y = (np.float64(column) - cx) / focal, (np.float64(row) - cy) / focal
        value = np.float64(inverse[row, column])
        depth = scale / value
        points[i, 0], points[i, 1], points[i, 2] = x * depth, y * depth, depth
        sigmas[i] = depth / value * sigma[row, column] * math.sqrt(x * x + y * y + 1.0)


@compiled_any
def face_normals(
    inverse: Float, cuts: Byte, pixels: Index, pinhole: tuple[float, float, float], first: int, end: int, normals: Float
) -> None:
    """Write rows `first` .. `end` - 1 of unit normals (N, 3) that face the camera, at pixels (N,) of a grid.

    A plane's disparity is linear in the pixels, and its slopes are its normal. `pinhole` is focal length, cx and cy in px.
    """
    width = inverse.shape[1]
    focal, cx, cy = pinhole
    for i in range(first, end):
        y, x = np.int64(pixels[i]) // width, np.int64(pixels[i]) % width
        a, b = _whole_slopes(inverse, y, x) if _whole(cuts, y, x) else _slopes(inverse, cuts, y, x)
        if math.isnan(a):
            a = b = 0.0  # too few pixels to lean on: it faces the camera's plane
        nx, ny = -focal * a, -focal * b
        nz = -(inverse[y, x] - a * (x - cx) - b * (y - cy))
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        normals[i, 0], normals[i, 1], normals[i, 2] = nx / length, ny / length, nz / length
