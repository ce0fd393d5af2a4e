"""Calibration from ROS: two `set_camera_info` calls, left and right, become what the camera keeps."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Literal

from prismstereo_calibration import flash
from prismstereo_calibration.convert import ros
from prismstereo_calibration.convert.pair import calibration_of
from prismstereo_calibration.model import Calibration
from prismstereo_hw.errors import UsageError

__all__ = ["CameraInfoIntake", "camera_info_yaml"]

Side = Literal["left", "right"]
_SHAPES = {"camera_matrix": ("k", 3), "rectification_matrix": ("r", 3), "projection_matrix": ("p", 3)}


class CameraInfoIntake:
    """Keeps one side's camera_info until the other's is there."""

    def __init__(self) -> None:
        self._held: dict[Side, bytes] = {}

    def take(self, side: Side, info: Any, present: Calibration) -> bytes | None:
        """Take one side; give flash bytes once both are there, None before.

        Where the views lie in the frame, and the range, are those of the `present` calibration. CalibrationError names what
        is wrong with the numbers; then both sides are asked for anew.
        """
        view = present.views[0 if side == "left" else 1]
        due = view.upright_size(present.frame_width, present.frame_height)
        if (info.width, info.height) != due:
            raise UsageError(
                f"{side} camera_info is for {info.width}x{info.height}, but that view has {due[0]}x{due[1]} pixels: calibrate "
                "with pictures of image_raw"
            )
        self._held[side] = camera_info_yaml(side, info)
        if len(self._held) < len(ros.NAMES):
            return None
        held, self._held = self._held, {}
        with tempfile.TemporaryDirectory() as folder:  # read as files of ROS are, with the same checks
            paths = [Path(folder) / name for name in ros.NAMES]
            for path, content in zip(paths, (held["left"], held["right"]), strict=True):
                path.write_bytes(content)
            pair = ros.read(paths)
        frame = present.frame_width, present.frame_height
        return flash.pack(calibration_of(pair, present.views, frame, present.range, present.rig))


def camera_info_yaml(side: Side, info: Any) -> bytes:
    """Write a sensor_msgs/CameraInfo as camera_info_manager does."""
    lines = [f"image_width: {info.width}", f"image_height: {info.height}", f"camera_name: {side}"]
    lines.append(f"distortion_model: {info.distortion_model or 'plumb_bob'}")
    lines += _matrix("distortion_coefficients", 1, list(info.d))
    for key, (field, rows) in _SHAPES.items():
        lines += _matrix(key, rows, list(getattr(info, field)))
    return ("\n".join(lines) + "\n").encode()


def _matrix(key: str, rows: int, values: list[float]) -> list[str]:
    numbers = ", ".join(repr(float(value)) for value in values)
    return [f"{key}:", f"  rows: {rows}", f"  cols: {len(values) // rows}", f"  data: [{numbers}]"]
