"""Kalibr: a camchain YAML, cam0 the left camera and cam1 the right one; lengths in METRES.

T_cn_cnm1 takes a point from cam0 to cam1. `radtan` is k1, k2, p1, p2: a lens with k3 is fitted anew over its own
picture, the error is told, and beyond 0.05 px it is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field, read_yaml, resolve
from prismstereo_calibration.convert.export import Export, number, require_metric, row
from prismstereo_calibration.convert.geometry import (
    distortion_of,
    lens_of_numbers,
    require_right_of_left,
    rotation_of,
)
from prismstereo_calibration.convert.pair import PairCamera, StereoPairModel
from prismstereo_calibration.convert.radtan import without_k3
from prismstereo_hw.errors import UsageError

__all__ = ["NAMES", "WORST_PX", "read", "write"]

Array = NDArray[np.float64]
NAMES = ("camchain.yaml",)
WORST_PX = 0.05
_MM_PER_M = 1000.0


def write(pair: StereoPairModel) -> Export:
    """Return one file; `UsageError` for lengths in squares, and for a lens that needs its k3."""
    require_metric(pair, "Kalibr")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = pair.R_right_from_left, pair.t_right_from_left / _MM_PER_M
    lines: list[str] = []
    worst = 0.0
    for index, (side, camera) in enumerate(zip(("left", "right"), pair.cameras, strict=True)):
        assert camera.size is not None  # a pair that was made of a calibration knows its pictures
        lens, off = without_k3(camera.lens, *camera.size)
        if not off <= WORST_PX:
            raise UsageError(
                f"the {side} lens has k3 = {camera.lens.distortion[4]:g}, which Kalibr's radtan has not: without it the "
                f"picture is off by {off:.3g} px, at most {WORST_PX} px is allowed; convert to opencv or colmap"
            )
        worst = max(worst, off)
        lines.append(f"cam{index}:")
        if index:
            lines += ["  T_cn_cnm1:", *(f"  - {row(line)}" for line in pose)]
        lines += [
            f"  cam_overlaps: [{1 - index}]",
            "  camera_model: pinhole",
            f"  distortion_coeffs: {row(lens.distortion[:4])}",
            "  distortion_model: radtan",
            f"  intrinsics: [{', '.join(map(number, (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px)))}]",
            f"  resolution: [{camera.size[0]}, {camera.size[1]}]",
            f"  rostopic: /{side}/image_raw",
        ]
    notes = (f"k3 was fitted away: pictures are off by {worst:.4f} px at most",) if worst else ()
    return Export({NAMES[0]: ("\n".join(lines) + "\n").encode()}, notes, worst)


def read(paths: Sequence[Path]) -> StereoPairModel:
    """Read a camchain of two cameras; `CalibrationError` names file and field."""
    chain = read_yaml(resolve(paths, NAMES, "a Kalibr chain")[0])
    if "cam2" in chain:
        raise chain["cam2"].refuse("is a third camera: keep cam0, the left one, and cam1, the right one")
    left, right = _camera(chain["cam0"]), _camera(chain["cam1"])
    field = chain["cam1"]["T_cn_cnm1"]
    pose = field.numbers(4, 4)
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise field[3].refuse(f"is {field[3].shown}: the last row of a pose is 0, 0, 0, 1")
    R, t = rotation_of(pose[:3, :3], field), pose[:3, 3] * _MM_PER_M
    require_right_of_left(R, t, field)
    return StereoPairModel(left, right, R_right_from_left=R, t_right_from_left=t)


def _camera(camera: Field) -> PairCamera:
    for key, known in (("camera_model", ("pinhole",)), ("distortion_model", ("radtan", "none"))):
        if camera[key].text() not in known:
            raise camera[key].refuse(f"is {camera[key].shown}: only {' and '.join(known)} can be read")
    coefficients, intrinsics, size = camera["distortion_coeffs"], camera["intrinsics"], camera["resolution"]
    distortion = distortion_of(coefficients.row(), coefficients)
    fx, fy, cx, cy = intrinsics.numbers(4)
    if len(size) != 2:
        raise size.refuse(f"has {len(size)} entries, not width and height")
    return PairCamera(lens_of_numbers(fx, fy, cx, cy, distortion, intrinsics), (size[0].pixels(), size[1].pixels()))
