"""OpenCV: one FileStorage YAML with M1 D1 M2 D2 R T R1 R2 P1 P2 Q, as stereoCalibrate and stereoRectify name them.

OpenCV's files have no unit; ours say `unit: mm` or `unit: square`, and lengths without that word are taken for mm.
The stereo_calib sample's two files, intrinsics.yml and extrinsics.yml, are read together.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field, read_yaml, resolve
from prismstereo_calibration.convert.export import Export, row
from prismstereo_calibration.convert.geometry import (
    distortion_of,
    lens_of_matrix,
    require_right_of_left,
    rotation_of,
)
from prismstereo_calibration.convert.pair import PairCamera, StereoPairModel
from prismstereo_calibration.model import Unit
from prismstereo_hw.errors import UsageError

__all__ = ["NAMES", "read", "write"]

Array = NDArray[np.float64]
NAMES = ("stereo.yml",)


def write(pair: StereoPairModel) -> Export:
    """Return one file; `Q` is for cv2.reprojectImageTo3D and knows the offset of the range window."""
    rectified = pair.rectified
    if rectified is None:
        raise UsageError("a pair without rectification has no OpenCV form: convert a whole calibration")
    lines = ["%YAML:1.0", "---", f"unit: {pair.unit}"]
    for side, camera in zip(("left", "right"), pair.cameras, strict=True):
        assert camera.size is not None  # a pair that was made of a calibration knows its pictures
        lines += [f"{side}_width: {camera.size[0]}", f"{side}_height: {camera.size[1]}"]
    lines += [f"rectified_width: {rectified.size[0]}", f"rectified_height: {rectified.size[1]}"]
    for name, values in {
        "M1": pair.left.lens.K,
        "D1": np.array([pair.left.lens.distortion]),
        "M2": pair.right.lens.K,
        "D2": np.array([pair.right.lens.distortion]),
        "R": pair.R_right_from_left,
        "T": pair.t_right_from_left[:, None],
        "R1": rectified.R_left,
        "R2": rectified.R_right,
        "P1": rectified.P_left,
        "P2": rectified.P_right,
        "Q": rectified.Q,
    }.items():
        rows, columns = values.shape
        lines += [
            f"{name}: !!opencv-matrix",
            f"   rows: {rows}",
            f"   cols: {columns}",
            "   dt: d",
            f"   data: {row(values)}",
        ]
    return Export({NAMES[0]: ("\n".join(lines) + "\n").encode()})


def read(paths: Sequence[Path]) -> StereoPairModel:
    """Read one file, its folder, or intrinsics and extrinsics; `CalibrationError` names file and field."""
    paths = resolve(paths, NAMES, "an OpenCV pair") if len(paths) == 1 else paths
    if not 1 <= len(paths) <= 2:
        raise UsageError(f"{len(paths)} files given: an OpenCV pair is one file, or intrinsics.yml and extrinsics.yml")
    files = [read_yaml(path) for path in paths]
    left, right = (_camera(files, *names) for names in (("M1", "D1", "left"), ("M2", "D2", "right")))
    turn = _find(files, "R")
    R = rotation_of(_matrix(turn, (3, 3)), turn)
    shift = _find(files, "T")
    t = _matrix(shift, (3, 1), (1, 3)).ravel()
    require_right_of_left(R, t, shift)
    unit = _unit(files)
    assumed = () if unit else ("T has no unit in this file: taken as mm",)
    return StereoPairModel(left, right, R_right_from_left=R, t_right_from_left=t, unit=unit or "mm", assumed=assumed)


def _find(files: list[Field], name: str) -> Field:
    """Return a field of whichever file has it; the complaint is about the last."""
    return next((file for file in files if name in file), files[-1])[name]


def _matrix(field: Field, *shapes: tuple[int, int]) -> Array:
    rows, columns = field["rows"].whole(), field["cols"].whole()
    if shapes and (rows, columns) not in shapes:
        allowed = " or ".join(f"{a} x {b}" for a, b in shapes)
        raise field.refuse(f"has {rows} rows and {columns} columns: it must be {allowed}")
    return field["data"].numbers(rows * columns).reshape(rows, columns)


def _camera(files: list[Field], matrix: str, coefficients: str, side: str) -> PairCamera:
    bends, K = _find(files, coefficients), _find(files, matrix)
    lens = lens_of_matrix(_matrix(K, (3, 3)), distortion_of(_matrix(bends).ravel(), bends), K)
    for width, height in ((f"{side}_width", f"{side}_height"), ("image_width", "image_height")):
        if any(width in file and height in file for file in files):
            return PairCamera(lens, (_find(files, width).pixels(), _find(files, height).pixels()))
    return PairCamera(lens, None)


def _unit(files: list[Field]) -> Unit | None:
    if not any("unit" in file for file in files):
        return None
    field = _find(files, "unit")
    unit = field.text()
    if unit == "mm":
        return "mm"
    if unit == "square":
        return "square"
    raise field.refuse(f"is {unit!r}: lengths are in mm or square")
