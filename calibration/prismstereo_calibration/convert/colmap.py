"""COLMAP: cameras.txt, images.txt with the pose of the right camera, and rig_config.json; lengths in MM, as we say.

COLMAP has a pixel's centre at 0.5: principal points are half a pixel larger there. A lens with k3 is FULL_OPENCV,
others OPENCV. World frame: that of the left camera.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field, read_table, resolve
from prismstereo_calibration.convert.export import Export, number, require_metric
from prismstereo_calibration.convert.geometry import distortion_of, lens_of_numbers, require_right_of_left
from prismstereo_calibration.convert.pair import PairCamera, StereoPairModel
from prismstereo_hw.lens import Lens

__all__ = ["NAMES", "read", "write"]

Array = NDArray[np.float64]
NAMES = ("cameras.txt", "images.txt")
_CENTRE = 0.5
_COUNTS = {"OPENCV": 8, "FULL_OPENCV": 12}
_BEFORE = 4  # words of a camera's line before its parameters
_IMAGE = 10  # words of an image's line
_UNIT_LENGTH = 1e-3


def write(pair: StereoPairModel) -> Export:
    """Return a text model of two cameras and no points, and the rig for `colmap rig_configurator`."""
    require_metric(pair, "a COLMAP model (mm)")
    pose = _quaternion(pair.R_right_from_left), pair.t_right_from_left
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ (mm), CAMERA_ID, NAME"]
    rig: list[dict[str, object]] = []
    for index, (side, camera) in enumerate(zip(("left", "right"), pair.cameras, strict=True), start=1):
        assert camera.size is not None  # a pair that was made of a calibration knows its pictures
        model, parameters = _parameters(camera.lens)
        cameras.append(f"{index} {model} {camera.size[0]} {camera.size[1]} {' '.join(map(number, parameters))}")
        q, t = pose if index > 1 else (np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
        images += [f"{index} {' '.join(map(number, (*q, *t)))} {index} {side}/000000.png", ""]
        part: dict[str, object] = {"image_prefix": f"{side}/", "camera_model_name": model, "camera_params": parameters}
        if index == 1:
            part["ref_sensor"] = True
        else:
            part["cam_from_rig_rotation"], part["cam_from_rig_translation"] = q.tolist(), t.tolist()
        rig.append(part)
    files = {
        "cameras.txt": "\n".join(cameras) + "\n",
        "images.txt": "\n".join(images) + "\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z (mm), R, G, B, ERROR, TRACK[]\n",
        "rig_config.json": json.dumps([{"cameras": rig}], indent=2) + "\n",
    }
    return Export({name: text.encode() for name, text in files.items()})


def _parameters(lens: Lens) -> tuple[str, list[float]]:
    k1, k2, p1, p2, k3 = (float(value) for value in lens.distortion)
    plain = [
        float(lens.fx_px),
        float(lens.fy_px),
        float(lens.cx_px) + _CENTRE,
        float(lens.cy_px) + _CENTRE,
        k1,
        k2,
        p1,
        p2,
    ]
    return ("FULL_OPENCV", [*plain, k3, 0.0, 0.0, 0.0]) if k3 else ("OPENCV", plain)


def _quaternion(R: Array) -> Array:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a rotation: the eigenvector of its largest eigenvalue."""
    a, b, c = R
    symmetric = np.array(
        [
            [a[0] + b[1] + c[2], c[1] - b[2], a[2] - c[0], b[0] - a[1]],
            [c[1] - b[2], a[0] - b[1] - c[2], a[1] + b[0], a[2] + c[0]],
            [a[2] - c[0], a[1] + b[0], b[1] - a[0] - c[2], b[2] + c[1]],
            [b[0] - a[1], a[2] + c[0], b[2] + c[1], c[2] - a[0] - b[1]],
        ]
    )
    q = np.linalg.eigh(symmetric)[1][:, -1]
    return np.asarray(q if q[0] >= 0 else -q) + 0.0


def _rotation(q: Array) -> Array:
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def read(paths: Sequence[Path]) -> StereoPairModel:
    """Read cameras.txt and images.txt of two images, left and right; `CalibrationError` names file and line."""
    files = resolve(paths, NAMES, "a COLMAP model")
    cameras = {line[0].whole(): line for line in read_table(files[0])}
    images = [line for line in read_table(files[1]) if len(line) == _IMAGE]  # lines of points have three words a point
    found = [[line for line in images if line[_IMAGE - 1].text().startswith(side)] for side in ("left", "right")]
    if [len(lines) for lines in found] != [1, 1]:
        raise Field(None, str(files[1])).refuse(
            f"has {len(found[0])} images whose names begin with left and {len(found[1])} with right: keep one of each"
        )
    left, right = found[0][0], found[1][0]
    (R_left, t_left), (R_right, t_right) = _pose(left), _pose(right)
    R = R_right @ R_left.T
    t = t_right - R @ t_left
    require_right_of_left(R, t, right)
    one, other = (_camera(cameras, line[_IMAGE - 2]) for line in (left, right))
    return StereoPairModel(one, other, R_right_from_left=R, t_right_from_left=t)


def _pose(image: Field) -> tuple[Array, Array]:
    q, t = (np.array([image[index].number() for index in range(*ends)]) for ends in ((1, 5), (5, 8)))
    if abs(np.linalg.norm(q) - 1) > _UNIT_LENGTH:
        raise image.refuse(f"has a quaternion of length {np.linalg.norm(q):.4g}: it is no rotation unless that is 1")
    return _rotation(q), t


def _camera(cameras: dict[int, Field], key: Field) -> PairCamera:
    if key.whole() not in cameras:
        raise key.refuse(f"is {key.whole()}, but cameras.txt has no camera of that number")
    line = cameras[key.whole()]
    model = line[1]
    if model.text() not in _COUNTS:
        raise model.refuse(f"is {model.shown}: only {' and '.join(_COUNTS)} can be read")
    count = len(line) - _BEFORE
    if count != _COUNTS[model.text()]:
        raise line.refuse(f"has {count} parameters: {model.text()} has {_COUNTS[model.text()]}")
    fx, fy, cx, cy, *bends = (line[index].number() for index in range(_BEFORE, len(line)))
    lens = lens_of_numbers(fx, fy, cx - _CENTRE, cy - _CENTRE, distortion_of(np.array(bends), line), line)
    return PairCamera(lens, (line[2].pixels(), line[3].pixels()))
