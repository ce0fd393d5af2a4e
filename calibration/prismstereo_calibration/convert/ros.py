"""ROS: one camera_info YAML a view, as camera_info_manager and camera_calibration_parsers have them; lengths in METRES.

R and P carry the pose: R_right_from_left = R_right.T R_left, and P[0, 3] of the right camera is -fx * baseline. The two
principal columns differ by the offset of the range window, so a node must take depth = fx * baseline / (d - (cx_left -
cx_right)), as image_geometry's Q and a pre-adjusted stereo_msgs/DisparityImage (d = x_left - x_right - (cx_left -
cx_right), Z = f T / d) do.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field, read_yaml, resolve
from prismstereo_calibration.convert.export import Export, require_metric, row
from prismstereo_calibration.convert.geometry import (
    distortion_of,
    lens_of_matrix,
    require_right_of_left,
    rotation_of,
)
from prismstereo_calibration.convert.pair import PairCamera, StereoPairModel
from prismstereo_hw.errors import UsageError

__all__ = ["NAMES", "read", "write"]

Array = NDArray[np.float64]
NAMES = ("left.yaml", "right.yaml")
_MM_PER_M = 1000.0
_MODELS = ("plumb_bob", "rational_polynomial")
_SAME_ROWS = 1e-4  # relative: what files of six digits keep


def write(pair: StereoPairModel) -> Export:
    """Return left.yaml and right.yaml; `UsageError` for lengths in squares and for interlaced views."""
    require_metric(pair, "ROS")
    rectified = pair.rectified
    if rectified is None:
        raise UsageError("a pair without rectification has no ROS form: convert a whole calibration")
    if any(camera.row_step > 1 for camera in pair.cameras):
        raise UsageError(
            "the views are interlaced, but ROS rectifies a picture into one of the same height: convert to opencv, whose "
            "rectified size is free"
        )
    turns, projections = (rectified.R_left, rectified.R_right), (rectified.P_left, rectified.P_right)
    sides = zip(("left", "right"), pair.cameras, turns, projections, strict=True)
    files = {f"{name}.yaml": _camera_info(name, camera, R, P) for name, camera, R, P in sides}
    notes = ["P is in metres and for this calibration's own range: its two principal columns differ on purpose"]
    if pair.left.size != pair.right.size:
        notes.append(f"the views differ in size, {pair.left.size} and {pair.right.size}: pad the smaller one for ROS")
    return Export(files, tuple(notes))


def _camera_info(name: str, camera: PairCamera, R: Array, P: Array) -> bytes:
    assert camera.size is not None  # a pair that was made of a calibration knows its pictures
    metric = P / np.array([1.0, 1.0, 1.0, _MM_PER_M])
    lines = [f"image_width: {camera.size[0]}", f"image_height: {camera.size[1]}", f"camera_name: {name}"]
    for key, values, shape in (
        ("camera_matrix", camera.lens.K, (3, 3)),
        ("distortion_coefficients", camera.lens.distortion, (1, 5)),
        ("rectification_matrix", R, (3, 3)),
        ("projection_matrix", metric, (3, 4)),
    ):
        if key == "distortion_coefficients":
            lines.append("distortion_model: plumb_bob")
        lines += [f"{key}:", f"  rows: {shape[0]}", f"  cols: {shape[1]}", f"  data: {row(values)}"]
    return ("\n".join(lines) + "\n").encode()


def read(paths: Sequence[Path]) -> StereoPairModel:
    """Read the two files of a stereo pair, left and right, or their folder; `CalibrationError` names a field."""
    left, right = (read_yaml(path) for path in resolve(paths, NAMES, "a ROS stereo pair"))
    R_left, R_right = (
        rotation_of(_matrix(info, "rectification_matrix", 3, 3), info["rectification_matrix"]) for info in (left, right)
    )
    P_left, P_right = (_matrix(info, "projection_matrix", 3, 4) for info in (left, right))
    field = right["projection_matrix"]
    if (
        not np.allclose(P_left[1], P_right[1], rtol=_SAME_ROWS, atol=_SAME_ROWS)
        or not min(P_left[0, 0], P_right[0, 0]) > 0
    ):
        raise field.refuse("does not share its rows with the left one: rectify both cameras as one stereo pair")
    shift = P_right[0, 3] / P_right[0, 0] - P_left[0, 3] / P_left[0, 0]  # minus the baseline, in metres
    if not shift < 0:
        raise field.refuse(
            f"gives a baseline of {-shift:g} m: data[3] of the right camera must be -fx * baseline, below 0; give left "
            "first, then right"
        )
    R = R_right.T @ R_left
    t = R_right.T @ np.array([shift * _MM_PER_M, 0.0, 0.0])
    require_right_of_left(R, t, field)
    return StereoPairModel(_camera(left), _camera(right), R_right_from_left=R, t_right_from_left=t)


def _matrix(info: Field, key: str, rows: int, columns: int) -> Array:
    return info[key]["data"].numbers(rows * columns).reshape(rows, columns)


def _camera(info: Field) -> PairCamera:
    model = info["distortion_model"]
    if model.text() not in _MODELS:
        raise model.refuse(f"is {model.shown}: only {' and '.join(_MODELS)} are read")
    field = info["distortion_coefficients"]["data"]
    distortion = distortion_of(field.row(), field)
    lens = lens_of_matrix(_matrix(info, "camera_matrix", 3, 3), distortion, info["camera_matrix"])
    return PairCamera(lens, (info["image_width"].pixels(), info["image_height"].pixels()))
