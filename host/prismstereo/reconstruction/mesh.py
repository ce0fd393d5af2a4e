"""The mesh of one surface: a grid of its pixels, cut where depth leaps by more than slope and noise explain.

Every frame of a camera has the same grid, so a vertex is named by its pixel and a triangle by its place: between two frames
of a sequence only what is valid changes. Triangles go counter-clockwise as the camera sees them, and none is turned over.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.reconstruction.grid_kernels import cut_grid, face_normals, mark_used, write_triangles
from prismstereo.reconstruction.surface import Surface
from prismstereo_hw.errors import UsageError

__all__ = ["CUT_SIGMAS", "Mesh", "mesh_of"]

Float = NDArray[np.float32]

CUT_SIGMAS = 4.0
_THREADS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Points and normals (N, 3) float32 of the rectified left frame in `unit`, normals towards the camera.

    `sigma` (N,) float32 is one standard deviation along the ray, in `unit`. `texture` (N, 2) float32 are places in the left
    picture, 0 to 1 from its upper left corner; `colours` (N, 3) uint8 RGB or None. `pixels` (N,) uint32: row * width + column
    of the grid, the same for a vertex in every frame. `triangles` (M, 3) uint32.
    """

    points: Float
    normals: Float
    sigma: Float
    texture: Float
    colours: NDArray[np.uint8] | None
    pixels: NDArray[np.uint32]
    triangles: NDArray[np.uint32]
    unit: str = "mm"


def mesh_of(surface: Surface, sigmas: float = CUT_SIGMAS) -> Mesh:
    """Join the pixels of a surface; the grid is cut where a step is more than `sigmas` off what the slopes beside it say."""
    if not sigmas > 0:
        raise UsageError(f"cut at {sigmas:g} sigmas: give a number above 0, e.g. {CUT_SIGMAS:g}")
    cuts = grid_cuts(surface, sigmas)
    used = np.zeros(cuts.shape, np.uint8)
    count = int(mark_used(cuts, used))
    pixels = np.flatnonzero(used).astype(np.uint32)
    number = np.zeros(cuts.shape, np.uint32)
    number.ravel()[pixels] = np.arange(len(pixels), dtype=np.uint32)
    triangles = np.empty((count, 3), np.uint32)
    write_triangles(cuts, number, triangles)
    height, width = cuts.shape
    rows, columns = np.divmod(pixels, np.uint32(width))
    texture = np.empty((len(pixels), 2), np.float32)
    texture[:, 0], texture[:, 1] = (columns + 0.5) / width, (rows + 0.5) / height
    points, sigma = surface.points(pixels)
    return Mesh(
        points=points,
        normals=_normals(surface, cuts, pixels),
        sigma=sigma,
        texture=texture,
        colours=surface.colours(pixels),
        pixels=pixels,
        triangles=triangles,
        unit=surface.geometry.unit,
    )


def grid_cuts(surface: Surface, sigmas: float = CUT_SIGMAS) -> NDArray[np.uint8]:
    """Return where the grid is cut (height, width) uint8: bit 1 to the right of a pixel, bit 2 below it."""
    inverse, sigma = np.ascontiguousarray(surface.inverse_px), np.ascontiguousarray(surface.sigma_px)
    cuts = np.empty(inverse.shape, np.uint8)
    _in_bands(lambda first, end: cut_grid(inverse, sigma, float(sigmas), first, end, cuts), len(inverse))
    return cuts


def _normals(surface: Surface, cuts: NDArray[np.uint8], pixels: NDArray[np.uint32]) -> Float:
    made = surface.geometry
    pinhole = float(made.focal_px), float(made.cx_px), float(made.cy_px)
    inverse = np.ascontiguousarray(surface.inverse_px)
    normals = np.empty((len(pixels), 3), np.float32)
    _in_bands(lambda first, end: face_normals(inverse, cuts, pixels, pinhole, first, end, normals), len(pixels))
    return normals


def _in_bands(work: Callable[[int, int], None], rows: int) -> None:
    """Do work on rows from one number up to another, by two threads: the kernels hold no lock."""
    edges = np.linspace(0, rows, _THREADS + 1).astype(int).tolist()
    with ThreadPoolExecutor(_THREADS) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
