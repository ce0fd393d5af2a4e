"""How exactly the twin's pictures lie where the tracer says: to a fiftieth of a pixel, all over both views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import Rectangle, Scene
from prismstereo_hw.twin import Twin

X, Y, _ = np.eye(3)
Z_MM = 700.0


@dataclass(frozen=True)
class Waves:
    """A sinusoid along u, or along v."""

    period_mm: float
    down: bool

    def shade(self, u_mm: np.ndarray, v_mm: np.ndarray, pixel_mm: np.ndarray) -> np.ndarray:
        return 120 + 90 * np.sin(2 * np.pi * (v_mm if self.down else u_mm) / self.period_mm)


@pytest.mark.parametrize("down", [False, True])
def test_a_sinusoid_on_a_plane_has_the_traced_phase_everywhere(rig: Rig, down: bool) -> None:
    period_mm = 11 * Z_MM / rig.lens().fx_px
    wall = Rectangle("waves", np.array([0.0, 0.0, Z_MM]), X, Y, np.inf, np.inf, Waves(period_mm, down))  # type: ignore[arg-type]
    frame = Twin(rig, Scene("waves", (wall,))).frame()
    height, width = frame.pixels.shape
    misses = []
    for side, (first, last) in (("left", (0.56, 0.85)), ("right", (0.15, 0.44))):
        for left in np.linspace(first * width, last * width - 32, 8).astype(int):
            for top in np.linspace(40, height - 72, 6).astype(int):
                pixels = np.stack(np.meshgrid(np.arange(left, left + 32), np.arange(top, top + 32)), axis=-1)
                rays = view_fates(rig, side, rig.lens().slopes(pixels.astype(float)))
                if rays.fate.any():
                    continue
                met = rays.point_mm + (Z_MM - rays.point_mm[..., 2:]) / rays.direction[..., 2:] * rays.direction
                phase = 2 * np.pi * met[..., int(down)].ravel() / period_mm
                terms = np.stack([np.ones_like(phase), np.sin(phase), np.cos(phase)], axis=-1)
                grey = frame.pixels[top : top + 32, left : left + 32].ravel().astype(float)
                _, in_phase, ahead = np.linalg.lstsq(terms, grey, rcond=None)[0]
                misses.append(np.arctan2(ahead, in_phase) / (2 * np.pi) * period_mm * rig.lens().fx_px / Z_MM)
    assert len(misses) > 60
    assert np.mean(np.abs(misses)) < 0.02
    assert np.max(np.abs(misses)) < 0.02
