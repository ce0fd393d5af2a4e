"""Fit a small net of dense layers to samples: plain numpy, Adam with decoupled decay, one seed, the same numbers every time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.training.cell_samples import Samples

__all__ = ["Course", "fit"]

Float = NDArray[np.float32]
_LABELS = 16
_MEMORY, _LONG_MEMORY = 0.9, 0.999
_SHAPES = 8  # a square goes into itself eight ways


@dataclass(frozen=True, slots=True)
class Course:
    """How long, how fast and in what portions a net learns."""

    epochs: int = 30
    rate: float = 3e-3
    portion: int = 1024
    decay: float = 1e-3
    seed: int = 1


def fit(samples: Samples, hidden: tuple[int, ...], course: Course) -> tuple[list[Float], list[Float]]:
    """Return weights (fan, width) and biases (width,) of each layer that tell near (+) from far (-)."""
    rng = np.random.default_rng(course.seed)
    widths = (samples.inputs.shape[1], *hidden, samples.near.shape[1])
    numbers = [rng.normal(0, np.sqrt(2 / fan), (fan, width)) for fan, width in pairwise(widths)]
    numbers[-1] *= 0.1
    weights = [number.astype(np.float32) for number in numbers]
    biases = [np.zeros(width, np.float32) for width in widths[1:]]
    descent = _Descent(course, [*weights, *biases], len(samples.near) // course.portion)
    turns = _turns(samples.near.shape[1])
    for _ in range(course.epochs):
        order = rng.permutation(len(samples.near))
        for portion in range(len(order) // course.portion):
            drawn = order[portion * course.portion : (portion + 1) * course.portion]
            turn, sign = turns[rng.integers(_SHAPES)], (1 if rng.random() < 0.5 else -1)
            inputs = samples.inputs[drawn][:, turn[0]] * np.float32(sign)  # near and far may change places
            near = samples.near[drawn][:, turn[1]]
            descent.step(_gradients(inputs, near if sign > 0 else 1 - near, samples.weights[drawn], weights, biases))
    return weights, biases


def _gradients(inputs: Float, near: Float, told: Float, weights: list[Float], biases: list[Float]) -> list[Float]:
    """Return the gradients of the weighted cross entropy, of all weights and then all biases."""
    values = [inputs]
    for layer, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        value = values[-1] @ weight + bias
        values.append(np.maximum(value, 0) if layer + 1 < len(weights) else value)
    pull = (1 / (1 + np.exp(-values[-1])) - near) * told / told.sum()
    of_weights: list[Float] = []
    of_biases: list[Float] = []
    for layer in range(len(weights) - 1, -1, -1):
        of_weights.insert(0, values[layer].T @ pull)
        of_biases.insert(0, pull.sum(axis=0))
        pull = (pull @ weights[layer].T) * (values[layer] > 0)
    return of_weights + of_biases


class _Descent:
    """Adam: the rate rises over the first 15 percent of the way and falls off as a cosine."""

    def __init__(self, course: Course, numbers: list[Float], portions: int) -> None:
        self._course, self._numbers, self._all_steps = course, numbers, course.epochs * max(portions, 1)
        self._mean, self._square = [np.zeros_like(n) for n in numbers], [np.zeros_like(n) for n in numbers]
        self._steps = 0

    def step(self, gradients: list[Float]) -> None:
        self._steps += 1
        way = self._steps / self._all_steps
        rate = self._course.rate * min(way / 0.15, 1.0) * (0.5 + 0.5 * np.cos(np.pi * max(0.0, way - 0.15) / 0.85))
        even, square_even = 1 - _MEMORY**self._steps, 1 - _LONG_MEMORY**self._steps
        for number, gradient, mean, square in zip(self._numbers, gradients, self._mean, self._square, strict=True):
            mean += (1 - _MEMORY) * (gradient - mean)
            square += (1 - _LONG_MEMORY) * (gradient * gradient - square)
            decay = self._course.decay if number.ndim > 1 else 0.0
            number -= (rate * (mean / even / (np.sqrt(square / square_even) + 1e-8) + decay * number)).astype(
                np.float32
            )


def _turns(places: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return for each of the eight turns of a square the order of the inputs and of the places."""
    side = round(places**0.5)
    grids = [np.arange(places).reshape(side, side), np.arange(places, 2 * places).reshape(side, side)]
    grids.append(np.arange(2 * places, 2 * places + _LABELS).reshape(4, 4))
    turns = []
    for shape in range(_SHAPES):
        turned = [_turned(grid, shape).ravel() for grid in grids]
        turns.append((np.concatenate(turned), turned[0]))
    return turns


def _turned(grid: NDArray[np.intp], shape: int) -> NDArray[np.intp]:
    grid = grid.T if shape & 1 else grid
    grid = grid[::-1] if shape & 2 else grid
    return grid[:, ::-1] if shape & 4 else grid
