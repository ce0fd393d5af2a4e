"""Frames of a face that speaks, from the optical twin, with the truth behind each; and what a reconstruction makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.reconstruction import Steady, Surface
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.truth import true_disparity
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin

MOVED_MM = 0.02  # truth that changes less between two frames is at rest


@dataclass(frozen=True, slots=True, eq=False)
class FaceFrame:
    """A frame, and its true depth (height, width) mm, NaN where there is no match."""

    frame: ExportFrame
    true_mm: NDArray[np.float32]


def face_frames(rig: Rig, count: int, every: int = 1) -> Iterator[FaceFrame]:
    """Render and match so many frames of a face before a rig, one of `every`, with read noise of a grey level."""
    calibration = Calibration.nominal(rig)
    pipeline, twin, geometries = (
        Pipeline(calibration),
        Twin(rig, named(rig, "face"), noise=1.0),
        Geometries(calibration),
    )
    for index in range(0, count * every, every):
        raw = twin.frame(index)
        pair = pipeline.split(raw)
        left = pipeline.rectifier.left_picture(pair)
        frame = ExportFrame.of(index, raw.timestamp_us * 1000, pipeline.disparity(pair), left, geometries)
        made = pipeline.rectifier.rectification
        yield FaceFrame(frame, made.window.depth_map(true_disparity(twin.truth(index), made)))


def of_width(rig: Rig, width: int, height: int) -> Rig:
    """The rig, read out with fewer pixels."""
    video = Mode(width=width, height=height, rate_hz=rig.camera.video.rate_hz)
    return msgspec.structs.replace(rig, camera=msgspec.structs.replace(rig.camera, video=video))


@dataclass(slots=True)
class Tally:
    """What the surfaces of a sequence are off, frame by frame: mean distance (mm) raw and steadied, at rest and moving."""

    raw_mm: list[float]
    steady_mm: list[float]
    moving_raw_mm: list[float]
    moving_steady_mm: list[float]
    flicker_raw_mm: float = 0.0
    flicker_steady_mm: float = 0.0
    told_mm: float = 0.0
    pull: float = 0.0


def tally(frames: Iterator[FaceFrame]) -> Tally:
    """Judge a sequence. Flicker is the median over resting pixels of their standard deviation in time."""
    found, steady = Tally([], [], [], []), Steady()
    depths: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
    truths: list[NDArray[np.float32]] = []
    for one in frames:
        surface = Surface.of(one.frame)
        steadied = steady.next(surface)
        for made, errors in ((surface, found.raw_mm), (steadied, found.steady_mm)):
            errors.append(float(np.nanmean(np.abs(made.depth - one.true_mm))))
        if truths:
            moving = (np.abs(one.true_mm - truths[-1]) > 5 * MOVED_MM) & surface.known
            if moving.any():  # at either end of its way the mouth is at rest
                found.moving_raw_mm.append(float(np.mean(np.abs(surface.depth - one.true_mm)[moving])))
                found.moving_steady_mm.append(float(np.mean(np.abs(steadied.depth - one.true_mm)[moving])))
        depths.append((surface.depth, steadied.depth))
        truths.append(one.true_mm)
        _, sigmas = surface.points(np.flatnonzero(surface.known).astype(np.uint32))
        found.told_mm = float(np.median(sigmas))
        off = np.abs(surface.geometry.window.scale_px * (1 / surface.depth - 1 / one.true_mm)) / surface.sigma_px
        found.pull = float(np.nanpercentile(off, 68.3))
    rest = np.ptp(np.stack(truths), axis=0) < MOVED_MM  # NaN is not
    found.flicker_raw_mm, found.flicker_steady_mm = (
        float(np.nanmedian(np.stack([pair[kind] for pair in depths])[:, rest].std(axis=0))) for kind in (0, 1)
    )
    return found
