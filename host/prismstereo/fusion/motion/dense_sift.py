"""Dense SIFT: what a picture's gradients look like around every fourth pixel, whatever the light.

The form is made for speed: with a step as wide as a spatial bin all descriptors share one lattice of cells, so a picture is
read once, and a descriptor is 4 x 4 neighbouring cells of 8 orientations.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion import dense_sift_kernels as kernels

__all__ = ["STEP_PX", "DenseSift"]

STEP_PX = 4
_SMOOTHING_PX = 1.0
_CLIP = 0.2
_FIRST_PX = 7.5  # centre of the first descriptor


@dataclass(frozen=True, slots=True)
class DenseSift:
    """Descriptors (n, m, 128) float32 of unit length; number (i, j) is centred on pixel (4 j + 7.5, 4 i + 7.5).

    `texture` (n, m) float32 is the length of each before it was made one: grey levels of gradient, summed.
    """

    descriptors: NDArray[np.float32]
    texture: NDArray[np.float32]

    @classmethod
    def of(cls, grey: NDArray[np.float32]) -> DenseSift:
        """Describe a picture (height, width) float32 of at least 16 x 16 pixels, grey levels 0 to 255."""
        smooth = cv2.GaussianBlur(np.ascontiguousarray(grey, np.float32), (0, 0), _SMOOTHING_PX)
        height, width = grey.shape
        cells = np.zeros((height // STEP_PX, width // STEP_PX, 8), np.float32)
        kernels.orientation_cells(np.asarray(smooth, np.float32), 0, height, cells)
        n, m = cells.shape[0] - 3, cells.shape[1] - 3
        descriptors, texture = np.empty((n, m, 128), np.float32), np.empty((n, m), np.float32)
        kernels.unit_descriptors(cells, _CLIP, descriptors, texture)
        return cls(descriptors, texture)

    def distances(self, other: DenseSift, reach: int = 1) -> NDArray[np.float32]:
        """Return how far (n, m) each descriptor is from the nearest of `other` within `reach` steps: 0 alike, 1.41 at most."""
        distances = np.empty(self.texture.shape, np.float32)
        kernels.least_distances(self.descriptors, other.descriptors, reach, distances)
        return distances

    @staticmethod
    def spread(values: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
        """Interpolate one value per descriptor (n, m) to the pixels (height, width) of the picture; the rim is continued."""
        to_lattice = np.array([[1 / STEP_PX, 0, -_FIRST_PX / STEP_PX], [0, 1 / STEP_PX, -_FIRST_PX / STEP_PX]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(
            cv2.warpAffine(values, to_lattice, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32
        )
