"""Least squares with a few shared unknowns and many small blocks of own ones: the normal matrix is an arrow.

Each frame has its own board pose and they all share the cameras, so the poses are eliminated frame by frame (Schur
complement) and one small system is left. Sixty frames take as long per step as three frames in a dense solver, and every
step is exact. Damping after Levenberg and Marquardt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["Linearised", "Minimum", "minimise"]

Array = NDArray[np.float64]
State = TypeVar("State")

_SMALL_DECREASE = 1e-12  # relative, of the sum of squares
_FIRST_DAMPING, _MOST_DAMPING = 1e-4, 1e12
_LESS, _MORE = 0.1, 10.0


@dataclass(frozen=True, slots=True)
class Linearised:
    """Residuals and derivatives at one state: V blocks of M residuals, S shared and K own unknowns.

    `cost` is the sum of squares, or of a robust loss whose weights' square roots are in the three arrays; inf where a
    residual is not finite. Of the residuals `count` were measured, the others are zeros in every array.
    """

    cost: float
    count: int
    residual: Array  # (V, M)
    by_shared: Array  # (V, M, S)
    by_own: Array  # (V, M, K)


@dataclass(frozen=True, slots=True)
class Minimum(Generic[State]):
    """The state of least cost, and the covariance (S, S) of the shared unknowns.

    The covariance is scaled by the residuals themselves: noise is taken to be equal and independent. It is NaN where the
    residuals do not determine the unknowns.
    """

    state: State
    covariance: Array
    rounds: int


@dataclass(frozen=True, slots=True)
class _Normal:
    """The normal equations, block by block."""

    A: Array  # (S, S)
    B: Array  # (V, S, K)
    C: Array  # (V, K, K)
    g: Array  # (S,)
    h: Array  # (V, K)

    @classmethod
    def of(cls, at: Linearised) -> _Normal:
        shared_T, own_T = at.by_shared.swapaxes(1, 2), at.by_own.swapaxes(1, 2)
        residual = at.residual[..., None]
        return cls(
            A=np.sum(shared_T @ at.by_shared, axis=0),
            B=shared_T @ at.by_own,
            C=own_T @ at.by_own,
            g=-np.sum(shared_T @ residual, axis=0)[:, 0],
            h=-(own_T @ residual)[..., 0],
        )

    def reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Eliminate the own unknowns: the matrix and right side of the shared ones, and C^-1 [B^T h] to go back."""
        S, K = self.A.shape[0], self.C.shape[-1]
        C = self.C * (1 + damping * np.eye(K))
        right = np.concatenate([self.B.swapaxes(1, 2), self.h[..., None]], axis=-1)
        solved = np.linalg.solve(C, right)
        folded = np.sum(self.B @ solved, axis=0)
        return self.A * (1 + damping * np.eye(S)) - folded[:, :S], self.g - folded[:, S], solved

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the damped step of the shared (S,) and of the own unknowns (V, K)."""
        matrix, right, solved = self.reduced(damping)
        scale = 1 / np.sqrt(np.diag(self.A))  # pixels beside distortion terms: unit diagonals keep the digits
        shared = scale * np.linalg.solve(matrix * np.outer(scale, scale), right * scale)
        return shared, solved[..., -1] - solved[..., :-1] @ shared


def minimise(
    state: State,
    linearise: Callable[[State], Linearised],
    advance: Callable[[State, Array, Array], State],
    most_rounds: int = 100,
) -> Minimum[State]:
    """Minimise the cost from `state` on.

    `advance(state, shared, own)` makes the state moved by a step (S,), (V, K). Raises `numpy.linalg.LinAlgError` where
    the equations are singular for every damping.
    """
    at = linearise(state)
    damping, rounds = _FIRST_DAMPING, 0
    normal = _Normal.of(at)
    while rounds < most_rounds and damping < _MOST_DAMPING and at.cost > 0:
        rounds += 1
        trial = advance(state, *normal.step(damping))
        there = linearise(trial)
        if not there.cost < at.cost:
            damping *= _MORE
            continue
        decrease = (at.cost - there.cost) / at.cost
        state, at, damping = trial, there, damping * _LESS
        normal = _Normal.of(at)
        if decrease < _SMALL_DECREASE:
            break
    return Minimum(state, _covariance(normal, at), rounds)


def _covariance(normal: _Normal, at: Linearised) -> Array:
    matrix, _, _ = normal.reduced(0.0)
    scale = 1 / np.sqrt(np.diag(normal.A))
    unknowns = normal.g.size + normal.h.size
    variance = at.cost / max(at.count - unknowns, 1)
    try:
        return variance * np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    except np.linalg.LinAlgError:
        return np.full_like(normal.A, np.nan)
