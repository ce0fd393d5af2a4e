"""Boards traced through a rig's exact optics: corner pairs with known truth, and noise as the only thing added.

The corners go through the glass plate and both reflections (`FoldedView.slopes`) and the true lens, so none of the
solver's pinholes made them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

Array = NDArray[np.float64]

PRISM_RIGS = ("dslr-35mm", "oak-1", "pi-camera-v2")
MARGIN_PX = 4.0
NEAR_AND_FAR_MM = {"dslr-35mm": (380.0, 560.0), "oak-1": (220.0, 420.0), "pi-camera-v2": (220.0, 420.0)}
SQUARE_MM = 10.0


def flawed(rig: Rig, offset_px: tuple[float, float], distortion: tuple[float, float]) -> Rig:
    """The same rig behind a lens with a principal point off the middle and distortion."""
    camera = msgspec.structs.replace(rig.camera, principal_offset_px=offset_px, distortion=distortion)
    return msgspec.structs.replace(rig, camera=camera)


def tipped(rig: Rig, right_tip_deg: float) -> Rig:
    """The same rig with its right mirror tipped, as assembly may leave it."""
    return msgspec.structs.replace(rig, mirrors=msgspec.structs.replace(rig.mirrors, right_tip_deg=right_tip_deg))


def paraxial_baseline_mm(rig: Rig) -> float:
    """The distance of the two virtual pinholes on the axis."""
    left, right = (fold(rig, side).paraxial_centre_mm for side in ("left", "right"))
    return float(np.linalg.norm(right - left))


@dataclass(frozen=True)
class TracedView:
    """One view of a rig as pixels of points, NaN where a point is not seen."""

    rig: Rig
    side: Side

    def pixels(self, points_rig: Array) -> Array:
        video = self.rig.camera.video
        slopes = fold(self.rig, self.side).slopes(points_rig)
        pixels = self.rig.lens().project_slopes(slopes)
        x, y, w, h = self.rig.views[0 if self.side == "left" else 1].rectangle(video.width, video.height)
        low, high = np.array([x, y]) + MARGIN_PX, np.array([x + w - 1, y + h - 1]) - MARGIN_PX
        inside = ((pixels >= low) & (pixels <= high)).all(axis=-1)
        seen = inside & (view_fates(self.rig, self.side, np.nan_to_num(slopes)).fate == 0)
        return np.where(seen[..., None], pixels, np.nan)


@cache
def traced_detection(
    rig: Rig,
    seed: int,
    *,
    poses: int = 15,
    board: Board | None = None,
    noise_px: float = 0.2,
    tilt_deg: float = 30.0,
    within_mm: tuple[float, float] | None = None,
) -> Detection:
    """Corner pairs of so many random poses within the common field, in upright pixels, noise per axis; made once.

    The boards' middles are `within_mm`, or between the near and far distance of the rig.
    """
    board = board or Board(9, 7, SQUARE_MM)
    random = np.random.default_rng(seed)
    flat = (board.points() / board.square - np.array([board.columns - 1, board.rows - 1, 0]) / 2) * SQUARE_MM
    near, far = within_mm or NEAR_AND_FAR_MM[rig.name]
    views = TracedView(rig, "left"), TracedView(rig, "right")
    pairs: list[Sighting] = []
    for _ in range(4000):
        centre_z = random.uniform(near, far)
        reach = 0.25 * centre_z
        centre = np.array([random.uniform(-reach, reach), random.uniform(-reach, reach), centre_z])
        points = flat @ turn(random, tilt_deg).T + centre
        left, right = (view.pixels(points) for view in views)
        if np.isnan(left).any() or np.isnan(right).any():
            continue
        noise = random.normal(0, noise_px, (2, *left.shape)) if noise_px else np.zeros((2, *left.shape))
        pairs.append(Sighting.of(f"pose{len(pairs):02d}.png", left + noise[0], right + noise[1]))
        if len(pairs) == poses:
            video = rig.camera.video
            return Detection(video.width, video.height, rig.views, tuple(pairs))
    raise AssertionError(f"only {len(pairs)} of {poses} boards fit the common field of {rig.name}")


def turn(random: np.random.Generator, tilt_deg: float) -> Array:
    """A tilt about a random axis in the board's plane, then a small turn in the picture."""
    axis, tilt = random.uniform(0, 2 * math.pi), math.radians(random.uniform(0, tilt_deg))
    spin = random.uniform(-0.2, 0.2)
    c, s = math.cos(axis), math.sin(axis)
    about = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    tilted = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
    spun = np.array([[math.cos(spin), -math.sin(spin), 0], [math.sin(spin), math.cos(spin), 0], [0, 0, 1.0]])
    return spun @ about @ tilted @ about.T
