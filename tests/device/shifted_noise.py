"""Cloudy pictures, and the same moved by any fraction of a pixel: pairs whose disparity is known exactly."""

from __future__ import annotations

import cv2
import numpy as np

__all__ = ["grey", "noise", "shifted"]


def noise(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A cloudy picture with detail of a few pixels, as a lens makes it."""
    white = rng.normal(0, 1, (height, width)).astype(np.float32)
    grey = cv2.GaussianBlur(white, (0, 0), 1.2)
    return 120 + 35 * grey / grey.std()


def shifted(picture: np.ndarray, shift_px: float) -> np.ndarray:
    """The picture moved to the left by a fraction of a pixel, exactly: it has no detail finer than a pixel."""
    cycles = np.fft.rfftfreq(picture.shape[1])
    return np.fft.irfft(np.fft.rfft(picture, axis=1) * np.exp(2j * np.pi * cycles * shift_px), picture.shape[1], axis=1)


def grey(picture: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
