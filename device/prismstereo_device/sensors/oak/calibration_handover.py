"""Our calibration in depthai's words, for one run: handed to the pipeline, never flashed.

The stereo engine looks a pair up by the sockets of its two inputs. Ours are virtual: CAM_B the left and CAM_C the right
rectified pinhole, as the mesh before the engine makes them. They have one focal length, no distortion, no turn, and stand a
baseline apart. So whatever part of this the camera's firmware uses, it agrees with the frames that it gets.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification
from prismstereo_hw.errors import UsageError

__all__ = ["LEFT_SOCKET", "RIGHT_SOCKET", "calibration_handler"]

Array = NDArray[np.float64]

LEFT_SOCKET, RIGHT_SOCKET = 1, 2  # CAM_B and CAM_C, also the instance numbers of their frames
_MM_PER_CM = 10.0
_COEFFICIENTS = 14


def calibration_handler(dai: ModuleType, calibration: Calibration, made: Rectification, *, socket: int = 0) -> Any:
    """Return a `dai.CalibrationHandler` of the virtual pair and of the real lens at `socket`, checked by depthai itself.

    `UsageError` for a calibration in board squares, and where depthai finds a fault in it.
    """
    if calibration.unit != "mm":
        raise UsageError(
            "this calibration has lengths in board squares: calibrate with --square-mm to match on the camera"
        )
    if socket in (LEFT_SOCKET, RIGHT_SOCKET):
        raise UsageError(
            "the camera behind the prism is at CAM_B or CAM_C, which the virtual pair needs: use mode=capture"
        )
    sockets = [dai.CameraBoardSocket(number) for number in (socket, LEFT_SOCKET, RIGHT_SOCKET)]
    real, left, right = sockets
    handler = dai.CalibrationHandler()
    handler.setBoardInfo("prismstereo", "")
    try:
        _put_lens(dai, handler, real, _raw_camera_matrix(calibration), calibration)
        for side, cx_px in ((left, made.left.cx_px), (right, made.right.cx_px)):
            K = [[made.focal_px, 0.0, cx_px], [0.0, made.focal_px, made.cy_px], [0.0, 0.0, 1.0]]
            handler.setCameraIntrinsics(side, K, dai.Size2f(made.width, made.height))
            handler.setDistortionCoefficients(side, [0.0] * _COEFFICIENTS)
        same = np.eye(3).tolist()
        across_cm = [-made.window.scale_px / made.focal_px / _MM_PER_CM, 0.0, 0.0]
        handler.setCameraExtrinsics(left, right, same, across_cm, across_cm)
        # the chain has to reach the real lens, which has no place among virtual cameras: nothing here asks for its pose
        handler.setCameraExtrinsics(right, real, same, [-x for x in across_cm], [-x for x in across_cm])
        handler.setStereoLeft(left, same)
        handler.setStereoRight(right, same)
        handler.validateCalibrationHandler()
    except RuntimeError as error:
        raise UsageError(f"depthai refuses the calibration of {calibration.rig!r}: {error}: calibrate again") from error
    return handler


def _put_lens(dai: ModuleType, handler: Any, socket: Any, K: Array, calibration: Calibration) -> None:
    distortion = [*calibration.left.lens.distortion]
    handler.setCameraIntrinsics(socket, K.tolist(), dai.Size2f(calibration.frame_width, calibration.frame_height))
    handler.setDistortionCoefficients(socket, distortion + [0.0] * (_COEFFICIENTS - len(distortion)))
    if calibration.lens_position is not None and 0 <= calibration.lens_position <= 255:
        handler.setLensPosition(socket, calibration.lens_position)


def _raw_camera_matrix(calibration: Calibration) -> Array:
    """Return the left view's lens, (3, 3), in pixels of the raw frame."""
    lens, view = calibration.left.lens, calibration.left_view
    frame = calibration.frame_width, calibration.frame_height
    cx, cy = view.raw_from_upright(np.array([lens.cx_px, lens.cy_px]), *frame)
    fx, fy = (lens.fy_px, lens.fx_px) if view.turn_deg in (90, 270) else (lens.fx_px, lens.fy_px)
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
