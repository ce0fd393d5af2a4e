"""Least squares of a few unknowns by Levenberg and Marquardt, with soft-L1 loss and bounds.

The loss of a residual r of scale s is 2 s^2 (sqrt(1 + (r/s)^2) - 1): a square near zero, a straight line far out, so that
a wrong match pulls with a constant force at most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Bounds", "Found", "minimise"]

Array = NDArray[np.float64]

_STEP = 1e-7  # of an unknown, for the derivative; all unknowns here are angles and logarithms of about one
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e10
_LESS, _MORE = 0.1, 10.0
_SMALL_DECREASE = 1e-10


@dataclass(frozen=True, slots=True)
class Bounds:
    """Lowest and highest value of every unknown, (K,) each; may be infinite."""

    low: Array
    high: Array


@dataclass(frozen=True, slots=True)
class Found:
    """The unknowns (K,) of least cost, and that cost: the sum of the losses."""

    unknowns: Array
    cost: float


def minimise(
    residuals: Callable[[Array], Array], start: Array, scale: Array, bounds: Bounds, most_rounds: int = 60
) -> Found:
    """Minimise the loss of `residuals(unknowns)` (M,), each with its own `scale` (M,) (inf: plain squares).

    An unknown that is pushed against a bound stays there for that step. A residual that is not finite counts as the worst
    there can be, so the way never leads there; the start itself must be finite.
    """
    here = np.clip(start, bounds.low, bounds.high)
    residual = residuals(here)
    cost, damping = _loss(residual, scale), _FIRST_DAMPING
    for _ in range(most_rounds):
        weight = 1 / np.sqrt(1 + (residual / scale) ** 2)
        jacobian = _jacobian(residuals, here, residual)
        normal, downhill = jacobian.T @ (jacobian * weight[:, None]), -jacobian.T @ (weight * residual)
        free = ~((here <= bounds.low) & (downhill < 0) | (here >= bounds.high) & (downhill > 0))
        before = cost
        while damping < _MOST_DAMPING:
            trial = np.clip(here + _step(normal, downhill, free, damping), bounds.low, bounds.high)
            there = residuals(trial)
            reached = _loss(there, scale)
            if reached < cost:
                here, residual, cost = trial, there, reached
                damping = max(damping * _LESS, _LEAST_DAMPING)
                break
            damping *= _MORE
        if before - cost <= _SMALL_DECREASE * before:
            break
    return Found(here, cost)


def _loss(residual: Array, scale: Array) -> float:
    """Return the sum of the losses, inf where a residual is not finite; exact for tiny residuals and infinite scales."""
    if not np.isfinite(residual).all():
        return float("inf")
    return float(np.sum(2 * residual**2 / (1 + np.sqrt(1 + (residual / scale) ** 2))))


def _jacobian(residuals: Callable[[Array], Array], at: Array, there: Array) -> Array:
    """Differentiate by small steps from where the residuals are known: (M, K)."""
    return np.stack([(residuals(at + step) - there) / _STEP for step in _STEP * np.eye(len(at))], axis=1)


def _step(normal: Array, downhill: Array, free: NDArray[np.bool_], damping: float) -> Array:
    """Solve the damped normal equations for the free unknowns; what the residuals do not depend on stays."""
    free = free & (np.diag(normal) > 0)
    step = np.zeros(len(downhill))
    matrix = normal[np.ix_(free, free)]
    if matrix.size:
        scale = 1 / np.sqrt(np.diag(matrix))
        scaled = matrix * np.outer(scale, scale) + damping * np.eye(len(matrix))
        step[free] = scale * np.linalg.solve(scaled, scale * downhill[free])
    return step
