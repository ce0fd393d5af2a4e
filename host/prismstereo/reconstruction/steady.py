"""Steady surfaces: every pixel of a sequence remembers what it was, as far as nothing there has moved.

A Kalman filter a pixel, on the disparity. Noise of a match differs from one pixel to the next, motion does not: where the
innovations of a neighbourhood lean to one side by more than their noise leaves, the memory there is given up, by as much.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.reconstruction.surface import Surface
from prismstereo_hw.errors import UsageError

__all__ = ["Steady"]

Float = NDArray[np.float32]

_WINDOW = 7
_INDEPENDENT = 9.0  # of the 49 pixels of a window: neighbours share their noise
_LEANS = 2.0  # sigmas of a neighbourhood's mean, from which on it is motion
_LEAPS = 4.0  # sigmas of a single pixel
_MEMORY = 8.0  # frames: the share of a new one never falls below its inverse


class Steady:
    """Smooths the surfaces of one sequence in time; give it every frame in its order."""

    def __init__(self, memory: float = _MEMORY) -> None:
        """Remember about `memory` frames, 1 or more; 1 remembers nothing."""
        if not memory >= 1:
            raise UsageError(f"a memory of {memory:g} frames: give 1 or more")
        self._least = np.float32(1 / memory)
        self._last: Surface | None = None
        self._share: Float = np.zeros((0, 0), np.float32)

    def next(self, surface: Surface) -> Surface:
        """Return the surface of this instant: its own pixels, each with what is remembered of it. Nothing is filled in."""
        last, self._last = self._last, surface
        if last is None or last.geometry != surface.geometry or last.inverse_px.shape != surface.inverse_px.shape:
            self._share = np.ones(surface.inverse_px.shape, np.float32)
            return surface
        innovation = surface.inverse_px - last.inverse_px
        both = np.isfinite(innovation)
        innovation = np.where(both, innovation, np.float32(0))
        moved = _moved(innovation, both, np.where(both, surface.sigma_px, np.float32(0)), self._share)
        usual = np.maximum(self._share / (1 + self._share), self._least)
        share = np.where(both, usual + (1 - usual) * moved, np.float32(1))
        self._share = share
        inverse = np.where(both, last.inverse_px + share * innovation, surface.inverse_px)
        self._last = replace(surface, inverse_px=inverse.astype(np.float32))
        return self._last


def _moved(innovation: Float, both: NDArray[np.bool_], sigma: Float, share: Float) -> Float:
    """Return how surely each pixel moved (height, width), 0 to 1, from what it and its neighbourhood are off."""
    count = np.maximum(_box(both.astype(np.float32)), 1)
    mean = _box(innovation) / count
    noise = np.sqrt(_box(sigma * sigma) / count * (1 + share))
    leans = np.abs(mean) / np.maximum(noise / np.sqrt(np.minimum(count, _INDEPENDENT)), np.float32(1e-6))
    leaps = np.abs(innovation) / np.maximum(sigma * np.sqrt(1 + share), np.float32(1e-6))
    return np.maximum(_ramp(leans, _LEANS), _ramp(leaps, _LEAPS))


def _ramp(sigmas: NDArray[np.floating], first: float) -> Float:
    """Return 0 up to `first`, 1 from twice as many on."""
    return np.asarray(np.clip(sigmas / np.float32(first) - 1, 0, 1), np.float32)


def _box(values: Float) -> Float:
    return np.asarray(
        cv2.boxFilter(values, -1, (_WINDOW, _WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT), np.float32
    )
