"""Joint adjustment of all views, their relative poses and every board pose: what `one_lens` and `two_camera` share.

Nine numbers of each view's lens are an affine function of the model's own: one lens for all views, or one each. A
rotation is moved by a small turn in front of it, R <- exp(w) R, so there is no chart to leave. Corners that a view does not
show are NaN and weigh nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving.arrow import Linearised, Minimum, minimise
from prismstereo_calibration.solving.poses import Pose, rotations
from prismstereo_calibration.solving.projection import lens_of, numbers_of, project
from prismstereo_hw.lens import Lens

__all__ = ["LensModel", "Unknowns", "adjust", "residuals", "warp_shapes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LensModel:
    """How the nine numbers of each view's lens follow from P own ones: numbers = matrix (9, P) @ own + constant (9,).

    `matrices` and `constants` have one entry for each view. `plate` is the glass before all of them. `warped` boards may bend:
    two numbers more.
    """

    name: str
    matrices: tuple[Array, ...]
    constants: tuple[Array, ...]
    fewest_frames: int
    focal_index: int = 0  # of the focal length among the own numbers
    plate: Plate | None = None
    warped: bool = False

    def numbers(self, own: Array) -> tuple[Array, ...]:
        """Return the nine numbers of each view's lens."""
        return tuple(matrix @ own + constant for matrix, constant in zip(self.matrices, self.constants, strict=True))

    def own(self, *lenses: Lens) -> Array:
        """Return the own numbers (P,) whose lenses come nearest to these, one for each view; exact for the model's own."""
        numbers = [numbers_of(lens) - constant for lens, constant in zip(lenses, self.constants, strict=True)]
        return np.asarray(np.linalg.lstsq(np.concatenate(self.matrices), np.concatenate(numbers), rcond=None)[0])

    def lenses(self, own: Array) -> tuple[Lens, ...]:
        """Return the lens of each view."""
        return tuple(lens_of(numbers) for numbers in self.numbers(own))


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Everything that is solved for: lens numbers (P,), poses of the other views from the first, board poses of V frames.

    `warp` (2,): how far the middle of the board stands off its plane because of a bend along x and along y, in the board's
    unit, positive away from the viewer.
    """

    lens: Array
    others: tuple[Pose, ...]
    R_left_from_board: Array  # (V, 3, 3)
    t_left_from_board: Array  # (V, 3)
    warp: Array

    def poses(self) -> tuple[Pose, ...]:
        """Return the pose of every view from the first, the first itself included."""
        return (Pose(np.eye(3), np.zeros(3)), *self.others)


def _advance(state: Unknowns, shared: Array, own: Array) -> Unknowns:
    P = state.lens.size
    others = []
    for index, pose in enumerate(state.others):
        turn, shift = shared[P + 6 * index :][:3], shared[P + 6 * index + 3 :][:3]
        others.append(Pose(rotations(turn) @ pose.R, pose.t + shift))
    warp = shared[P + 6 * len(others) :]
    return Unknowns(
        lens=state.lens + shared[:P],
        others=tuple(others),
        R_left_from_board=rotations(own[:, :3]) @ state.R_left_from_board,
        t_left_from_board=state.t_left_from_board + own[:, 3:],
        warp=state.warp + warp if warp.size else state.warp,
    )


def _cross(vectors: Array) -> Array:
    """Return the matrices (..., 3, 3) of -[v]x: how exp(w) v moves with w."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    o = np.zeros_like(x)
    return np.stack([np.stack([o, z, -y], -1), np.stack([-z, o, x], -1), np.stack([y, -x, o], -1)], axis=-2)


def warp_shapes(points: Array) -> Array:
    """Return how far corners (N, 3) stand off the plane for a unit of each warp (N, 2): parabolas, 0 at the board's ends."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return np.asarray(1 - (2 * (points[:, :2] - low) / (high - low) - 1) ** 2)


def _bent(points: Array, warp: Array) -> Array:
    """Return the corners (N, 3) of a board that is not quite flat."""
    return np.asarray(points + warp_shapes(points) @ warp[:, None] * np.array([0.0, 0.0, 1.0]))


def _linearise(
    model: LensModel, points: Array, pixels: Array, tolerance_px: float | None, state: Unknowns
) -> Linearised:
    """Linearise at a state; pixels are (V, K, N, 2), the first view first, points of the board (N, 3)."""
    V, K, N, _ = pixels.shape
    P, bends = state.lens.size, 2 * model.warped
    turned = _bent(points, state.warp) @ state.R_left_from_board.swapaxes(1, 2)  # (V, N, 3)
    in_left = turned + state.t_left_from_board[:, None]
    turn, rise = _cross(turned), warp_shapes(points)
    residual = np.empty((V, K, N, 2))
    by_shared = np.zeros((V, K, N, 2, P + 6 * (K - 1) + bends))
    by_own = np.empty((V, K, N, 2, 6))
    for k, (numbers, pose) in enumerate(zip(model.numbers(state.lens), state.poses(), strict=True)):
        carried = in_left @ pose.R.T
        there = carried + pose.t
        seen = project(numbers, there, model.plate)
        residual[:, k] = np.where(there[..., 2:] > 0, seen.pixels - pixels[:, k], np.nan)
        by_shared[:, k, ..., :P] = seen.by_lens @ model.matrices[k]
        if k:
            at = P + 6 * (k - 1)
            by_shared[:, k, ..., at : at + 3] = seen.by_point @ _cross(carried)
            by_shared[:, k, ..., at + 3 : at + 6] = seen.by_point
        through = seen.by_point @ pose.R
        by_own[:, k, ..., :3], by_own[:, k, ..., 3:] = through @ turn, through
        if bends:
            off_plane = through @ state.R_left_from_board[:, None, :, 2:]  # (V, N, 2, 1)
            by_shared[:, k, ..., -2:] = off_plane * rise[:, None, :]
    shown = np.isfinite(pixels[..., :1])
    residual = np.where(shown, residual, 0.0)
    cost, root = _loss(residual, tolerance_px)
    weight = root * shown
    return Linearised(
        cost=cost,
        count=2 * int(np.count_nonzero(shown)),
        residual=(weight * residual).reshape(V, -1),
        by_shared=_weighed(weight, by_shared).reshape(V, 2 * K * N, -1),
        by_own=_weighed(weight, by_own).reshape(V, 2 * K * N, 6),
    )


def _weighed(weight: Array, derivatives: Array) -> Array:
    """Return derivatives (V, K, N, 2, S) by their weights (V, K, N, 1); nothing of a corner that weighs nothing is left."""
    return np.where(weight[..., None] > 0, weight[..., None] * derivatives, 0.0)


def _loss(residual: Array, tolerance_px: float | None) -> tuple[float, Array]:
    """Return the cost of residuals (..., 2) and the roots of their weights (..., 1): squares, or Cauchy's loss."""
    square = np.sum(residual**2, axis=-1, keepdims=True)
    if tolerance_px is None:
        cost, root = float(np.sum(square)), np.ones_like(square)
    else:
        relative = square / tolerance_px**2
        cost, root = float(tolerance_px**2 * np.sum(np.log1p(relative))), 1 / np.sqrt(1 + relative)
    return cost if np.isfinite(cost) else np.inf, root


def adjust(
    model: LensModel,
    points: Array,
    pixels: Array,
    start: Unknowns,
    *,
    tolerance_px: float | None = None,
    most_rounds: int = 100,
) -> Minimum[Unknowns]:
    """Find the unknowns of least squares in pixels.

    The shared covariance is in the order lens, then turn (rad) and shift of each other view, then warp. With a tolerance,
    corners that are farther off count for less and less (Cauchy's loss).
    """
    linearise: Callable[[Unknowns], Linearised] = partial(_linearise, model, points, pixels, tolerance_px)
    if not model.warped:
        start = replace(start, warp=np.zeros(2))
    return minimise(start, linearise, _advance, most_rounds)


def residuals(model: LensModel, points: Array, pixels: Array, state: Unknowns) -> Array:
    """Return projected minus measured pixels (V, K, N, 2) of a state, NaN where a view does not show a corner."""
    turned = _bent(points, state.warp) @ state.R_left_from_board.swapaxes(1, 2)
    in_left = turned + state.t_left_from_board[:, None]
    off = []
    for k, (lens, pose) in enumerate(zip(model.lenses(state.lens), state.poses(), strict=True)):
        there = in_left @ pose.R.T + pose.t
        seen = lens.project(there) if model.plate is None else lens.project_slopes(model.plate.slopes(there))
        off.append(seen - pixels[:, k])
    return np.stack(off, axis=1)
