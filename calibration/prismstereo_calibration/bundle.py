"""Joint adjustment of both views, their relative pose and every board pose: what `one_lens` and `two_camera` share.

Nine numbers of each view's lens are an affine function of the model's own: one lens for both views, or one each. A
rotation is moved by a small turn in front of it, R <- exp(w) R, so there is no chart to leave.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.arrow import Linearised, Minimum, minimise
from prismstereo_calibration.poses import Pose, rotations
from prismstereo_calibration.projection import Projection, lens_of, numbers_of, project
from prismstereo_hw.lens import Lens

__all__ = ["LensModel", "Unknowns", "adjust", "residuals"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LensModel:
    """How the nine numbers of each view's lens follow from P own ones: numbers = matrix (9, P) @ own + constant (9,)."""

    name: str
    left_matrix: Array
    left_constant: Array
    right_matrix: Array
    right_constant: Array
    fewest_frames: int
    focal_index: int = 0  # of the focal length among the own numbers

    def numbers(self, own: Array) -> tuple[Array, Array]:
        """Return the nine numbers of the left and of the right view's lens."""
        return self.left_matrix @ own + self.left_constant, self.right_matrix @ own + self.right_constant

    def own(self, left: Lens, right: Lens) -> Array:
        """Return the own numbers (P,) whose lenses come nearest to these two; exact where the model made them."""
        matrix = np.concatenate([self.left_matrix, self.right_matrix])
        numbers = np.concatenate([numbers_of(left) - self.left_constant, numbers_of(right) - self.right_constant])
        return np.asarray(np.linalg.lstsq(matrix, numbers, rcond=None)[0])

    def lenses(self, own: Array) -> tuple[Lens, Lens]:
        """Return the lenses of the left and of the right view."""
        left, right = self.numbers(own)
        return lens_of(left), lens_of(right)


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Everything that is solved for: lens numbers (P,), right-from-left pose, left-from-board poses of V frames."""

    lens: Array
    right: Pose
    R_left_from_board: Array  # (V, 3, 3)
    t_left_from_board: Array  # (V, 3)


def _advance(state: Unknowns, shared: Array, own: Array) -> Unknowns:
    count = state.lens.size
    turn, shift = shared[count : count + 3], shared[count + 3 :]
    return Unknowns(
        lens=state.lens + shared[:count],
        right=Pose(rotations(turn) @ state.right.R, state.right.t + shift),
        R_left_from_board=rotations(own[:, :3]) @ state.R_left_from_board,
        t_left_from_board=state.t_left_from_board + own[:, 3:],
    )


def _cross(vectors: Array) -> Array:
    """Return the matrices (..., 3, 3) of -[v]x: how exp(w) v moves with w."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    o = np.zeros_like(x)
    return np.stack([np.stack([o, z, -y], -1), np.stack([-z, o, x], -1), np.stack([y, -x, o], -1)], axis=-2)


def _linearise(
    model: LensModel, points: Array, pixels: Array, tolerance_px: float | None, state: Unknowns
) -> Linearised:
    """Linearise at a state; pixels are (V, 2, N, 2), left view first, points of the board (N, 3)."""
    V, _, N, _ = pixels.shape
    P = state.lens.size
    left_numbers, right_numbers = model.numbers(state.lens)
    Q, s = state.right.R, state.right.t
    turned = points @ state.R_left_from_board.swapaxes(1, 2)  # (V, N, 3)
    in_left = turned + state.t_left_from_board[:, None]
    carried = in_left @ Q.T
    left, right = project(left_numbers, in_left), project(right_numbers, carried + s)

    by_shared = np.zeros((V, 2, N, 2, P + 6))
    by_shared[:, 0, ..., :P] = left.by_lens @ model.left_matrix
    by_shared[:, 1, ..., :P] = right.by_lens @ model.right_matrix
    by_shared[:, 1, ..., P : P + 3] = right.by_point @ _cross(carried)
    by_shared[:, 1, ..., P + 3 :] = right.by_point
    by_own = np.empty((V, 2, N, 2, 6))
    turn = _cross(turned)
    by_own[:, 0, ..., :3], by_own[:, 0, ..., 3:] = left.by_point @ turn, left.by_point
    through = right.by_point @ Q
    by_own[:, 1, ..., :3], by_own[:, 1, ..., 3:] = through @ turn, through
    residual = np.stack([_off(left, in_left, pixels[:, 0]), _off(right, carried + s, pixels[:, 1])], axis=1)
    cost, root = _loss(residual, tolerance_px)
    return Linearised(
        cost=cost,
        residual=(root * residual).reshape(V, -1),
        by_shared=(root[..., None] * by_shared).reshape(V, 4 * N, -1),
        by_own=(root[..., None] * by_own).reshape(V, 4 * N, 6),
    )


def _loss(residual: Array, tolerance_px: float | None) -> tuple[float, Array]:
    """Return the cost of residuals (..., 2) and the roots of their weights (..., 1): squares, or Cauchy's loss."""
    square = np.sum(residual**2, axis=-1, keepdims=True)
    if tolerance_px is None:
        cost, root = float(np.sum(square)), np.ones_like(square)
    else:
        relative = square / tolerance_px**2
        cost, root = float(tolerance_px**2 * np.sum(np.log1p(relative))), 1 / np.sqrt(1 + relative)
    return cost if np.isfinite(cost) else np.inf, root


def _off(projection: Projection, points: Array, pixels: Array) -> Array:
    """Return projected minus measured pixels; NaN behind the lens, so that no step goes there."""
    return np.where(points[..., 2:] > 0, projection.pixels - pixels, np.nan)


def adjust(
    model: LensModel,
    points: Array,
    pixels: Array,
    start: Unknowns,
    *,
    tolerance_px: float | None = None,
    most_rounds: int = 100,
) -> Minimum[Unknowns]:
    """Find the unknowns of least squares in pixels; the shared covariance is in the order lens, turn (rad), shift.

    With a tolerance, corners that are farther off count for less and less (Cauchy's loss).
    """
    linearise: Callable[[Unknowns], Linearised] = partial(_linearise, model, points, pixels, tolerance_px)
    return minimise(start, linearise, _advance, most_rounds)


def residuals(model: LensModel, points: Array, pixels: Array, state: Unknowns) -> Array:
    """Return projected minus measured pixels (V, 2, N, 2) of a state."""
    left_numbers, right_numbers = model.numbers(state.lens)
    in_left = points @ state.R_left_from_board.swapaxes(1, 2) + state.t_left_from_board[:, None]
    in_right = in_left @ state.right.R.T + state.right.t
    off = [
        np.asarray(lens_of(numbers).project(there)) - pixels[:, view]
        for view, (numbers, there) in enumerate(((left_numbers, in_left), (right_numbers, in_right)))
    ]
    return np.stack(off, axis=1)
