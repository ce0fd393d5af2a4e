"""The light of one picture against another's: one factor per channel, from the pixels that show the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.picture import channels

__all__ = ["Gain"]

Float = NDArray[np.float32]
_DARKEST, _BRIGHTEST = 12.0, 246.0
_FEWEST = 64
_ENOUGH = 40_000  # pixels looked at
_NEAR = 0.15  # of the factor: pixels that may still show the same
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class Gain:
    """Factors, one per channel, that take a picture's grey levels to those of the picture it is compared with."""

    factors: tuple[float, ...]

    @classmethod
    def between(cls, picture: NDArray[np.uint8] | Float, reference: NDArray[np.uint8] | Float) -> Gain:
        """Find the gain that takes `picture` to the light of `reference`, both (height, width[, c]) and registered.

        Objects and shadows may cover near half of the picture: only pixels near the commonest ratio count in the end.
        """
        step = max(1, round((picture.shape[0] * picture.shape[1] / _ENOUGH) ** 0.5))
        ours, theirs = (channels(each[::step, ::step]) for each in (picture, reference))
        return cls(tuple(_factor(ours[..., c], theirs[..., c]) for c in range(ours.shape[2])))

    def applied(self, picture: NDArray[np.uint8] | Float) -> Float:
        """Return the picture (height, width[, c]) in the other one's light, float32."""
        scaled = channels(picture) * np.asarray(self.factors, np.float32)
        return scaled.reshape(picture.shape)

    def applied_to_bytes(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the picture in the other one's light, rounded to uint8."""
        scaled = np.rint(self.applied(picture))
        return np.clip(scaled, 0, 255, out=scaled).astype(np.uint8)


def _factor(ours: Float, theirs: Float) -> float:
    told = (ours > _DARKEST) & (ours < _BRIGHTEST) & (theirs > _DARKEST) & (theirs < _BRIGHTEST)
    ratio = theirs[told] / ours[told]
    if ratio.size < _FEWEST:
        return 1.0
    factor = float(np.median(ratio))
    for _ in range(_ROUNDS):
        near = ratio[np.abs(ratio - factor) < _NEAR * factor]
        if near.size < _FEWEST:
            break
        factor = float(np.median(near))
    return factor
