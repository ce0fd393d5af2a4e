"""How well a rig was put together, read from the pose between its two views.

Planes that all stand upright on one plane, as prism faces and mirrors are meant to, carry one view into the other by a planar
motion: it turns about the axis a that all of them share, and nothing moves along a (reference: optics, section 4). In an
ideal rig a is the direction of the image columns, and both views look equally far off the baseline's normal.

The rig's frame: x along the baseline from left to right, z halfway between the two optical axes made square to it, y down.
None of these figures harms a calibration, which measures the pose as it is; they say what to align before it is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration, Unit

__all__ = ["Assembly", "assembly"]

Array = NDArray[np.float64]
_SMALLEST_TURN_DEG = (
    2.0  # below it the cameras are as good as parallel: a tilt of 0.03 degrees would turn the axis by one
)
_TIMES_SIGMA = 5.0


@dataclass(frozen=True, slots=True)
class Assembly:
    """The deviation of the right-from-left pose from the planar and symmetric motion of an ideal rig.

    `turn_deg`: by how much the right camera is turned against the left one. `axis_off_columns_deg`: angle between the axis
    of that turn and the image columns; `shift_along_axis`: how far the motion goes along the axis, in `unit`, and
    `shift_share` its share of the baseline. These three are None where the
    cameras are parallel, or nearly so: there is no axis to speak of.
    `pitch_deg` and `roll_deg` are those of the right camera against the left one in the rig's frame: positive where it looks
    farther up, and where it is turned counter-clockwise, seen from behind. `asymmetry_deg`: how much farther the right camera
    looks away from the baseline's normal, outwards, than the left one.
    """

    unit: Unit
    turn_deg: float
    axis_off_columns_deg: float | None
    shift_along_axis: float | None
    shift_share: float | None
    pitch_deg: float
    roll_deg: float
    asymmetry_deg: float


def assembly(calibration: Calibration) -> Assembly:
    """Return the assembly quality of a calibrated rig."""
    R, t = calibration.right.R_camera_from_left, calibration.right.t_camera_from_left
    turn, axis = _turn(R)
    known = axis is not None and math.degrees(turn) > max(
        _SMALLEST_TURN_DEG, _TIMES_SIGMA * _turn_sigma_deg(calibration)
    )
    off_columns = shift = share = None
    if axis is not None and known:
        axis = axis if axis[1] >= 0 else -axis
        off_columns = math.degrees(math.atan2(math.hypot(axis[0], axis[2]), axis[1]))
        shift = float(axis @ t)
        share = shift / calibration.baseline
    pitches, rolls, yaws = _attitudes(calibration)
    return Assembly(
        unit=calibration.unit,
        turn_deg=math.degrees(turn),
        axis_off_columns_deg=off_columns,
        shift_along_axis=shift,
        shift_share=share,
        pitch_deg=pitches[1] - pitches[0],
        roll_deg=rolls[1] - rolls[0],
        asymmetry_deg=yaws[1] + yaws[0],
    )


def _turn(R: Array) -> tuple[float, Array | None]:
    """Return the angle of a rotation in radians and its axis (3,), None where it does not turn at all."""
    twice = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])  # 2 sin(angle) axis
    length = float(np.linalg.norm(twice))
    angle = math.atan2(length, float(np.trace(R)) - 1)
    return angle, (twice / length if length > 0 else None)


def _turn_sigma_deg(calibration: Calibration) -> float:
    known = calibration.uncertainty
    return 0.0 if known is None else math.degrees(max(known.sigma(f"turn_{axis}_rad") for axis in "xyz"))


def _attitudes(calibration: Calibration) -> tuple[list[float], list[float], list[float]]:
    """Return pitch, roll and yaw in degrees of the left and of the right camera in the rig's frame."""
    rows = [
        camera.R_camera_from_left for camera in (calibration.left, calibration.right)
    ]  # its axes, in the left frame
    x = calibration.right.centre / calibration.baseline
    ahead = rows[0][2] + rows[1][2]
    z = ahead - x * (ahead @ x)
    z /= np.linalg.norm(z)
    y = np.cross(z, x)
    pitches = [-math.degrees(math.asin(np.clip(axes[2] @ y, -1, 1))) for axes in rows]
    rolls = [-math.degrees(math.asin(np.clip(axes[0] @ y, -1, 1))) for axes in rows]
    yaws = [math.degrees(math.atan2(axes[2] @ x, axes[2] @ z)) for axes in rows]
    return pitches, rolls, yaws
