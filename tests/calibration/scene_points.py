"""Points of an imagined scene before the two views of one frame, with known cameras: for rectification without a board."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.uncalibrated.scene_matches import SceneMatches
from prismstereo_hw.view import layout

Array = NDArray[np.float64]

WIDTH, HEIGHT = 640, 720  # of a view; two of them stand side by side
FOCAL_PX = 2009.0  # of the dslr-35mm rig


def turn(x_deg: float, y_deg: float, z_deg: float) -> Array:
    """A rotation about x, after one about y, after one about z."""
    (a, b, c), (s, t, w) = np.cos(np.radians([x_deg, y_deg, z_deg])), np.sin(np.radians([x_deg, y_deg, z_deg]))
    about_x, about_y = np.array([[1, 0, 0], [0, a, -s], [0, s, a]]), np.array([[b, 0, t], [0, 1, 0], [-t, 0, b]])
    return np.asarray(about_x @ about_y @ np.array([[c, -w, 0], [w, c, 0], [0, 0, 1]]), float)


def prism_halves(seed: int, noise_px: float = 0.3) -> SceneMatches:
    """Both halves of a frame behind a prism with a lens axis at the seam: 900 points at 0.6 to 1.1 m, those that both show.

    The toe-in is that of dslr-35mm, each view besides turned by some tenths of a degree.
    """
    random = np.random.default_rng(seed)
    points = np.stack([random.uniform(*ends, 900) for ends in ((-120, 120), (-140, 140), (600, 1100))], axis=1)
    left = seen(points, turn(0.3, 10.7, 0.8), np.array([-24.3, 0, 0]), FOCAL_PX, np.array([WIDTH, HEIGHT / 2]))
    right = seen(points, turn(-0.2, -10.7, -0.6), np.array([24.3, 0.6, -0.8]), FOCAL_PX, np.array([0, HEIGHT / 2]))
    return shown(left, right, random, noise_px)


def seen(points: Array, R: Array, centre_mm: Array, focal_px: float, axis_px: Array) -> Array:
    """Pixels of points in a camera that stands at `centre_mm`, turned by R (scene from camera)."""
    own = (points - centre_mm) @ R
    return np.asarray(focal_px * own[:, :2] / own[:, 2:] + axis_px)


def shown(left: Array, right: Array, random: np.random.Generator, noise_px: float) -> SceneMatches:
    """Keep what lies in both views, add noise, and put the right view beside the left one."""
    size = np.array([WIDTH, HEIGHT])
    kept = np.all((left > 0) & (left < size) & (right > 0) & (right < size), axis=1)
    noisy = [pixels[kept] + random.normal(0, noise_px, (kept.sum(), 2)) for pixels in (left, right)]
    return SceneMatches(noisy[0], noisy[1] + [WIDTH, 0], layout("side-by-side"), 2 * WIDTH, HEIGHT, 1)
