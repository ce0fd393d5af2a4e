"""Disparity maps of planes and balls, computed from their equations for the rectified pinhole: the truth to measure."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from prismstereo.export.geometry import FrameGeometry, Geometries
from prismstereo.measuring import Relief
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.rig import Rig


@cache
def unit(baseline_sigma_mm: float | None = None) -> Calibration:
    """The nominal calibration of the camera of the paper; with a baseline that is known so well, and all else exactly."""
    calibration = Calibration.nominal(Rig.read("dslr-35mm"))
    if baseline_sigma_mm is None:
        return calibration
    along = np.zeros(len(NUMBERS))
    along[-3:] = baseline_sigma_mm * calibration.right.t_camera_from_left / calibration.baseline
    return replace(calibration, uncertainty=Uncertainty(np.outer(along, along)))


@cache
def geometry(baseline_sigma_mm: float | None = None) -> FrameGeometry:
    calibration = unit(baseline_sigma_mm)
    made = rectification(calibration)
    nothing = np.full((made.height, made.width), np.nan, np.float32)
    return Geometries(calibration).of(DisparityMap(nothing, made.window))


def rays(seen: FrameGeometry) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(seen.width, dtype=float), np.arange(seen.height, dtype=float))
    x, y = (columns - seen.cx_px) / seen.focal_px, (rows - seen.cy_px) / seen.focal_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def plane_mm(seen: FrameGeometry, normal: np.ndarray, distance_mm: float) -> np.ndarray:
    """Depth (height, width) of the plane n X = h."""
    return np.asarray(distance_mm / (rays(seen) @ normal))


def ball_mm(seen: FrameGeometry, centre: np.ndarray, radius_mm: float) -> np.ndarray:
    """Depth (height, width) of a ball, NaN beside it."""
    ray = rays(seen)
    square, along = np.sum(ray**2, axis=-1), ray @ centre
    root = along**2 - square * (centre @ centre - radius_mm**2)
    return np.where(root > 0, (along - np.sqrt(np.maximum(root, 0))) / square, np.nan)


def relief(seen: FrameGeometry, depth_mm: np.ndarray, noise_px: float = 0.0, seed: int = 1) -> Relief:
    """The relief of depths whose disparities are off by white noise."""
    inverse = seen.window.scale_px / depth_mm
    return Relief(inverse + np.random.default_rng(seed).normal(0, noise_px, inverse.shape), seen)


def middle_ray(seen: FrameGeometry) -> np.ndarray:
    return rays(seen)[seen.height // 2, seen.width // 2]
