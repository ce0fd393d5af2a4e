"""The two capture modes of a camera: how their pixels correspond, and when stills are taken.

Video reads a 16:9 window of the sensor, binned or scaled down; a still reads all of it. Both share the lens and the whole
width of the sensor, so one scale and a vertical offset tie them together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.rig import Mode, Rig

__all__ = ["STILL_PAUSE_US", "from_video", "still_from_video", "still_instants_us", "still_pixels"]

STILL_PAUSE_US = 1_000_000  # a still is read out, and perhaps written to a card: at most one a second
_MEAN_EXTRA_US = 600_000


def still_from_video(rig: Rig) -> tuple[float, float, float]:
    """Return (scale, dx_px, dy_px): a video pixel x lies at scale (x + 0.5) - 0.5 + dx of the still, y likewise with dy."""
    return from_video(rig, rig.camera.still)


def from_video(rig: Rig, mode: Mode) -> tuple[float, float, float]:
    """Return (scale, dx_px, dy_px) from video pixels to those of any mode of the same sensor."""
    video, own = rig.lens(), rig.lens(mode)
    scale = own.fx_px / video.fx_px
    return scale, own.cx_px + 0.5 - scale * (video.cx_px + 0.5), own.cy_px + 0.5 - scale * (video.cy_px + 0.5)


def still_pixels(rig: Rig, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take raw video pixels (..., 2) to raw pixels of the still (..., 2)."""
    scale, dx, dy = still_from_video(rig)
    return np.asarray(scale * (pixels + 0.5) - 0.5 + np.array([dx, dy]))


def still_instants_us(count: int, seed: int) -> list[int]:
    """Return seeded irregular times in microseconds, rising, none nearer than a second to the one before.

    A person presses the button: a pause, then a wait without memory.
    """
    rng = np.random.default_rng([seed, STILL_PAUSE_US])
    waits = np.ceil(rng.exponential(_MEAN_EXTRA_US, count)).astype(np.int64)
    return [int(instant) for instant in np.cumsum(waits) + STILL_PAUSE_US * np.arange(count)]
