"""What surfaces look like: band-limited noise that has detail at every distance, and board squares.

A texture is a value for a point of a surface *and* the size of the pixel that looks at it: what is finer than the pixel
is averaged away, as a sensor does, so nothing aliases and both views see the same thing at sub-pixel shifts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Checkered", "Noise", "Plain", "Texture"]

Array = NDArray[np.float64]
_TILE = 1024
_LEVELS = 8
_TEXELS_PER_PIXEL = 1.4  # detail ends at 0.35 cycles per pixel, as it does behind a real lens and pixel aperture
_REMAP_COLUMNS = 4096  # cv2.remap takes no side above 32767


@dataclass(frozen=True, slots=True)
class Plain:
    """One grey level everywhere."""

    grey: float = 128.0

    def shade(self, u_mm: Array, v_mm: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at surface coordinates (N,), seen by pixels of a size in mm."""
        del v_mm, pixel_mm
        return np.full(u_mm.shape, self.grey)


@dataclass(frozen=True, slots=True)
class Noise:
    """Cloudy noise with equal contrast per octave, periodic after 1024 texels; the seed makes it."""

    seed: int
    texel_mm: float
    mean: float = 120.0
    contrast: float = 42.0

    def shade(self, u_mm: Array, v_mm: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at surface coordinates (N,), seen by pixels of a size in mm."""
        level = np.clip(np.log2(np.maximum(pixel_mm, 1e-9) / (_TEXELS_PER_PIXEL * self.texel_mm)), 0, _LEVELS - 1)
        low = np.minimum(level.astype(np.int64), _LEVELS - 2)
        blend = level - low
        grey = np.zeros(u_mm.shape)
        for k in np.unique(low):
            here = low == k
            fine = self._sample(int(k), u_mm[here], v_mm[here])
            coarse = self._sample(int(k) + 1, u_mm[here], v_mm[here])
            grey[here] = fine + blend[here] * (coarse - fine)
        return np.clip(self.mean + self.contrast * grey, 4, 251)

    def _sample(self, level: int, u_mm: Array, v_mm: Array) -> Array:
        tile = _noise_pyramid(self.seed)[level]
        texel = self.texel_mm * 2**level
        rows = -(-u_mm.size // _REMAP_COLUMNS)
        where = np.zeros((2, rows * _REMAP_COLUMNS), np.float32)
        # a sample belongs to its cell's centre: level k's first texel spans 2^k of level 0
        where[0, : u_mm.size] = np.mod(u_mm / texel - 0.5, tile.shape[1])
        where[1, : v_mm.size] = np.mod(v_mm / texel - 0.5, tile.shape[0])
        maps = where.reshape(2, rows, _REMAP_COLUMNS)
        grey = cv2.remap(tile, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(grey, np.float64).ravel()[: u_mm.size]


@lru_cache(maxsize=16)
def _noise_pyramid(seed: int) -> tuple[NDArray[np.float32], ...]:
    """Make the tile and its halvings; each is limited to a quarter cycle per texel, where linear interpolation is true."""
    rng = np.random.default_rng(seed)
    white = np.fft.fft2(rng.standard_normal((_TILE, _TILE)))
    frequency = np.hypot(np.fft.fftfreq(_TILE)[:, None], np.fft.fftfreq(_TILE)[None, :])
    spectrum = white * np.where(frequency > 2 / _TILE, 1 / np.maximum(frequency, 1 / _TILE), 0)
    band = spectrum * (frequency < 0.25)
    unit = 1 / np.std(np.fft.ifft2(band).real)
    levels = []
    for k in range(_LEVELS):
        size = _TILE >> k
        kept = np.fft.fftshift(spectrum * (frequency < 0.25 / 2**k))
        begin = (_TILE - size) // 2
        small = np.fft.ifftshift(kept[begin : begin + size, begin : begin + size])
        # texel centres of a halved tile lie half a fine texel further in: shift, so that levels register
        ramp = np.fft.fftfreq(size) * (1 - 2.0**-k) / 2
        shift = np.exp(2j * np.pi * (ramp[:, None] + ramp[None, :]))
        levels.append((np.fft.ifft2(small * shift).real * unit / 4**k).astype(np.float32))
    return tuple(levels)


@dataclass(frozen=True, slots=True)
class Checkered:
    """A chessboard of (columns + 1) x (rows + 1) squares with a white margin; origin at its first inner corner.

    Inner corners lie at (i square_mm, j square_mm), i < columns, j < rows.
    """

    columns: int
    rows: int
    square_mm: float
    black: float = 25.0
    white: float = 220.0
    margin_squares: float = 1.0

    def shade(self, u_mm: Array, v_mm: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at board coordinates (N,), averaged over pixels of a size in mm."""
        u, v, w = u_mm / self.square_mm, v_mm / self.square_mm, np.maximum(pixel_mm / self.square_mm, 1e-6)
        pattern = _square_wave(u, w) * _square_wave(v, w)  # +1 and -1 alternate
        middle, reach = (self.white + self.black) / 2, (self.white - self.black) / 2
        inside = (u > -1) & (u < self.columns) & (v > -1) & (v < self.rows)
        return np.where(inside, middle + reach * pattern, self.white)


def _square_wave(x: Array, width: Array) -> Array:
    """Average a square wave of period 2 (+1 on 0..1) over `width` around x: its integral is a triangle wave."""

    def integral(t: Array) -> Array:
        return np.asarray(1 - np.abs(np.mod(t, 2) - 1))

    return np.asarray((integral(x + width / 2) - integral(x - width / 2)) / width)


Texture = Plain | Noise | Checkered
