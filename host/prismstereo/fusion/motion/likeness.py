"""How well one picture explains another, pixel by pixel, when the light may have changed: shadow-safe and without a halo.

In every window the better-suited gain is taken (within limits: a shadow darkens, it does not turn black), and what is left over
is compared with noise and with a small error of registration. A pixel is as unlike as the best window that holds it, so that a
pixel beside an object is still explained by windows that do not reach the object.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.picture import channels, grey

__all__ = ["SHADED", "TURNED", "LightRange", "noise_level", "unlikeness"]

Float = NDArray[np.float32]
_NOISE = (1.0, 12.0)  # grey levels, least and most


@dataclass(frozen=True, slots=True)
class LightRange:
    """The factors of brightness that still count as the same thing in another light."""

    darkest: float
    brightest: float


SHADED = LightRange(0.35, 1.2)  # a thing at rest: in shadow, or a little brighter
TURNED = LightRange(0.6, 1.6)  # a thing that moved, and turned to the light or away from it


def unlikeness(
    picture: Float, model: Float, light: LightRange, *, noise: float, window: int = 5, slack_px: float = 0.3
) -> Float:
    """Return how many times more than noise is left of `picture` when `model` explains it, (height, width) float32.

    Both are (height, width[, c]) and registered; `noise` is in grey levels, `slack_px` an error of registration that is
    forgiven. About 1 where they agree; above 4 hardly by chance.
    """
    ours, theirs = channels(picture), channels(model)
    size = (window, window)
    oo, tt, ot = (cv2.boxFilter(_summed(a, b), -1, size) for a, b in ((ours, ours), (theirs, theirs), (ours, theirs)))
    factor = np.clip(ot / np.maximum(tt, np.float32(1e-3)), light.darkest, light.brightest)
    left = np.maximum(oo - 2 * factor * ot + factor * factor * tt, 0) / ours.shape[2]
    rough = cv2.boxFilter(_steepness(theirs), -1, size) * factor * factor
    score = left / (np.float32(noise * noise) + np.float32(slack_px**2) * rough)
    return np.asarray(cv2.erode(score, np.ones(size, np.uint8)), np.float32)


def noise_level(picture: Float, model: Float) -> float:
    """Return the noise, in grey levels, of the difference of two registered pictures of which most shows the same.

    Taken where the model is smooth, from differences of neighbouring pixels: a shadow or another gain do not count. At most
    12: what differs more is another scene.
    """
    difference = grey(picture) - grey(model)
    ripple = difference[:, 1:] - difference[:, :-1]
    steep = np.abs(np.diff(grey(model), axis=1))
    calm = ripple[steep <= np.percentile(steep, 40)]
    channel_count = 1 if picture.ndim == 2 else picture.shape[2]
    sigma = 1.4826 * float(np.median(np.abs(calm))) / np.sqrt(2) * np.sqrt(channel_count)
    return min(max(_NOISE[0], float(sigma)), _NOISE[1])


def _summed(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("ijk,ijk->ij", a, b), np.float32)


def _steepness(picture: Float) -> Float:
    """Return the squared gradient, the mean of the channels, (height, width)."""
    dx = cv2.Sobel(picture, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(picture, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    square = dx * dx + dy * dy
    return np.asarray(square if square.ndim == 2 else square.mean(axis=2), np.float32)
