"""Disparity as 16-bit PNG files, and one JSON file with what makes depth of them: for any language, with no library of ours."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo_device.disparity import FRACTION
from prismstereo_hw.files import write_picture, write_whole

__all__ = ["LIST", "write_png16"]

LIST = "frames.json"
_MOST = 65535
_HOW = "disparity_px = value / 16, 0: unmatched; depth = focal_px * baseline / (disparity_px + offset_px)"


class _Listed(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of the list; lengths in `unit`, the frame's is rectified left: x right, y down, z ahead."""

    index: int
    timestamp_ns: int
    disparity: str
    left: str | None
    width: int
    height: int
    focal_px: float
    baseline: float
    cx_px: float
    cy_px: float
    offset_px: float
    unit: str


def write_png16(folder: Path, frames: Iterable[ExportFrame]) -> list[Path]:
    """Write NNNNNN_disparity.png, NNNNNN_left.png where there is a picture, and frames.json; return all their paths.

    What glass before the lens does to disparity is taken off, so that one formula holds for every pixel. DataError where
    a file cannot be written.
    """
    paths: list[Path] = []
    listed: list[_Listed] = []
    for frame in frames:
        name = f"{frame.index:06d}"
        paths.append(folder / f"{name}_disparity.png")
        write_picture(paths[-1], _steps(frame))
        left = None
        if frame.left is not None:
            left = f"{name}_left.png"
            paths.append(folder / left)
            write_picture(paths[-1], frame.left)
        listed.append(_entry(frame, f"{name}_disparity.png", left))
    content = {"schema": "prismstereo-png16/1", "depth": _HOW, "frames": msgspec.to_builtins(listed)}
    paths.append(folder / LIST)
    write_whole(paths[-1], msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
    return paths


def _steps(frame: ExportFrame) -> NDArray[np.uint16]:
    """Return sixteenths of a pixel, at least one of them where there is a match."""
    disparity = frame.inverse_px - np.float32(frame.geometry.offset_px)
    matched = np.isfinite(disparity)
    return np.where(matched, np.clip(np.rint(np.where(matched, disparity, 0) * FRACTION), 1, _MOST), 0).astype(
        np.uint16
    )


def _entry(frame: ExportFrame, disparity: str, left: str | None) -> _Listed:
    geometry = frame.geometry
    return _Listed(
        index=frame.index,
        timestamp_ns=frame.timestamp_ns,
        disparity=disparity,
        left=left,
        width=geometry.width,
        height=geometry.height,
        focal_px=geometry.focal_px,
        baseline=geometry.baseline,
        cx_px=geometry.cx_px,
        cy_px=geometry.cy_px,
        offset_px=geometry.offset_px,
        unit=geometry.unit,
    )
