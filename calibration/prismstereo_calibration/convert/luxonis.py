"""Luxonis: the EEPROM JSON that `depthai.CalibrationHandler` loads, version 7; lengths in CENTIMETRES.

The two views are two virtual cameras, CAM_B left and CAM_C right, on one sensor. depthai keeps 32-bit numbers: seven
digits come back from it, all of them from the file itself.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field, read_json, resolve
from prismstereo_calibration.convert.export import Export, require_metric
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
NAMES = ("eeprom.json",)
_LEFT, _RIGHT, _NOWHERE = 1, 2, -1  # depthai's CAM_B and CAM_C
_MM_PER_UNIT = {0: 1000.0, 1: 10.0, 2: 1.0, 3: 25.4, 4: 304.8}  # depthai's LengthUnit; older files mean cm
_CENTIMETRE = 1
_COEFFICIENTS = 14
_LAST_LENS_POSITION = 255
_VERSION = 7


def write(pair: StereoPairModel) -> Export:
    """Return one file; `UsageError` for lengths in squares."""
    require_metric(pair, "Luxonis")
    rectified = pair.rectified
    if rectified is None:
        raise UsageError("a pair without rectification has no Luxonis form: convert a whole calibration")
    position = pair.lens_position if pair.lens_position is not None else 0
    kept = position if 0 <= position <= _LAST_LENS_POSITION else 0
    pose = _extrinsics(pair.R_right_from_left, pair.t_right_from_left / _MM_PER_UNIT[_CENTIMETRE], _RIGHT)
    content = {
        **dict.fromkeys(("batchName", "boardConf", "boardCustom", "boardRev", "deviceName", "hardwareConf"), ""),
        "batchTime": 0,
        "boardName": "prismstereo",
        "boardOptions": 0,
        "cameraData": [
            [_LEFT, _camera_part(pair.left, pose, kept)],
            [_RIGHT, _camera_part(pair.right, _nothing(), kept)],
        ],
        "housingExtrinsics": _nothing(),
        "imuExtrinsics": _nothing(),
        "miscellaneousData": [],
        "productName": "prismstereo",
        "stereoEnableDistortionCorrection": True,
        "stereoRectificationData": {
            "leftCameraSocket": _LEFT,
            "rectifiedRotationLeft": rectified.R_left.tolist(),
            "rectifiedRotationRight": rectified.R_right.tolist(),
            "rightCameraSocket": _RIGHT,
        },
        "stereoUseSpecTranslation": False,
        "version": _VERSION,
        "verticalCameraSocket": _NOWHERE,
    }
    lost = kept != position
    notes = (f"lens position {position} has no place in one byte of the file: left out",) if lost else ()
    return Export({NAMES[0]: json.dumps(content, indent=4, sort_keys=True).encode() + b"\n"}, notes)


def _vector(values: Array) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))


def _extrinsics(R: Array, t_cm: Array, socket: int) -> dict[str, Any]:
    """Return a pose; the translation by design is the measured one, so that nobody takes another."""
    return {
        "lengthUnit": _CENTIMETRE,
        "rotationMatrix": R.tolist(),
        "specTranslation": _vector(t_cm),
        "toCameraSocket": socket,
        "toDeviceId": "",
        "translation": _vector(t_cm),
    }


def _nothing() -> dict[str, Any]:
    return {**_extrinsics(np.eye(3), np.zeros(3), _NOWHERE), "rotationMatrix": []}


def _camera_part(camera: PairCamera, pose: dict[str, Any], lens_position: int) -> dict[str, Any]:
    assert camera.size is not None  # a pair that was made of a calibration knows its pictures
    coefficients = [*camera.lens.distortion, *[0.0] * (_COEFFICIENTS - len(camera.lens.distortion))]
    return {
        "cameraType": 0,
        "distortionCoeff": coefficients,
        "extrinsics": pose,
        "height": camera.size[1],
        "intrinsicMatrix": camera.lens.K.tolist(),
        "lensPosition": lens_position,
        "specHfovDeg": float(2 * np.degrees(np.arctan(camera.size[0] / 2 / camera.lens.fx_px))),
        "width": camera.size[0],
    }


def read(paths: Sequence[Path]) -> StereoPairModel:
    """Read the stereo pair of an EEPROM's JSON; `CalibrationError` names file and field."""
    eeprom = read_json(resolve(paths, NAMES, "a Luxonis EEPROM")[0])
    stereo = eeprom["stereoRectificationData"]
    sockets = stereo["leftCameraSocket"].whole(), stereo["rightCameraSocket"].whole()
    entries = {entry[0].whole(): entry[1] for entry in _entries(eeprom["cameraData"])}
    for socket, key in zip(sockets, ("leftCameraSocket", "rightCameraSocket"), strict=True):
        if socket not in entries:
            raise stereo[key].refuse(f"is {socket}, but cameraData has no camera at that socket")
    left, right = (entries[socket] for socket in sockets)
    R, t, field = _pose(left, right, sockets)
    require_right_of_left(R, t, field)
    position = left["lensPosition"].whole() if "lensPosition" in left else 0
    cameras = _camera(left), _camera(right)
    return StereoPairModel(*cameras, R_right_from_left=R, t_right_from_left=t, lens_position=position or None)


def _entries(cameras: Field) -> list[Field]:
    return [cameras[index] for index in range(len(cameras))]


def _pose(left: Field, right: Field, sockets: tuple[int, int]) -> tuple[Array, Array, Field]:
    """Return R, t in mm from left to right, whichever of the two cameras has it, and the field that it is in."""
    for camera, other, turned in ((left, sockets[1], False), (right, sockets[0], True)):
        field = camera["extrinsics"]
        if field["toCameraSocket"].whole() != other:
            continue
        unit = field["lengthUnit"].whole() if "lengthUnit" in field else _CENTIMETRE
        if unit not in _MM_PER_UNIT:
            raise field["lengthUnit"].refuse(f"is {unit}: 0 to 4 are m, cm, mm, inch, foot")
        R = rotation_of(field["rotationMatrix"].numbers(3, 3), field["rotationMatrix"])
        t = np.array([field["translation"][axis].number() for axis in "xyz"]) * _MM_PER_UNIT[unit]
        return (R.T, -R.T @ t, field["translation"]) if turned else (R, t, field["translation"])
    raise left["extrinsics"].refuse(
        f"does not lead to the other camera of the pair, socket {sockets[1]}: give the pose between the two directly"
    )


def _camera(camera: Field) -> PairCamera:
    if camera["cameraType"].whole() != 0:
        raise camera["cameraType"].refuse(f"is {camera['cameraType'].whole()}: only 0, perspective, can be read")
    field = camera["distortionCoeff"]
    distortion = distortion_of(field.row(), field)
    lens = lens_of_matrix(camera["intrinsicMatrix"].numbers(3, 3), distortion, camera["intrinsicMatrix"])
    return PairCamera(lens, (camera["width"].pixels(), camera["height"].pixels()))
