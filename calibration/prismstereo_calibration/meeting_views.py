"""Views that meet: two cameras that look past each other are no stereo pair, however sound each of them is.

So stand the views of a file whose rotation was turned over (left from right for right from left), or whose axes changed places:
it is a rotation still, and only what it makes of the pair tells.
"""

from __future__ import annotations

import numpy as np

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration

__all__ = ["require_meeting"]

_PLACES = 15  # each way, at which the left view is tried
_DEPTHS = 24
_NEARER = 0.5  # of the range's near end
_FARTHEST = 1e5  # times the near end stands for infinity


def require_meeting(calibration: Calibration) -> None:
    """Refuse a pair whose right view shows nothing of the left one anywhere in the range; `CalibrationError` names the pose."""
    frame = calibration.frame_width, calibration.frame_height
    x, y, _, _ = calibration.left_view.rectangle(*frame)
    w, h = calibration.left_view.upright_size(*frame)
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _PLACES), np.linspace(y, y + h - 1, _PLACES))
    origin, along = calibration.left.rays(np.stack([columns.ravel(), rows.ravel()], axis=-1))
    near, far = calibration.range.near_mm, calibration.range.far_mm
    reach = np.geomspace(_NEARER * near, min(far, _FARTHEST * near), _DEPTHS)
    points = origin[:, None] + reach[:, None] * along[:, None]
    x, y, _, _ = calibration.right_view.rectangle(*frame)
    w, h = calibration.right_view.upright_size(*frame)
    right = calibration.right
    pixels = right.project(points)
    ahead = (points @ right.R_camera_from_left.T + right.t_camera_from_left)[..., 2] > 0
    inside = np.all((pixels >= [x, y]) & (pixels <= [x + w - 1, y + h - 1]), axis=-1)  # NaN is nowhere
    if not (ahead & inside).any():
        raise CalibrationError(
            f"by R_right_from_left the views look past each other: from {near:g} to {far:g} {calibration.unit} the right one "
            "shows nothing of the left one; the rotation may be turned over, or the range may be wrong"
        )
