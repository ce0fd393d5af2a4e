"""What a board says about a calibrated unit: whether lengths are right, and whether the focus ring was moved.

A focus ring changes the scale of both pictures alike. The focal length is therefore solved for alone, with everything else as
it was calibrated, and so is the mount; whichever explains the corners better is the likelier cause.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Sighting
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.quality import triangulate
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.upkeep.board_fit import fit_boards
from prismstereo_calibration.upkeep.mount import Mount
from prismstereo_hw.errors import UsageError

__all__ = ["BoardFindings", "board_findings"]

Array = NDArray[np.float64]
_MOST_SIGHTINGS = 8
_FEWEST_CORNERS = 8
_EXPLAINS = 0.9  # of the remaining error: an explanation that leaves more explains nothing
_MOUNT_NUMBERS_MORE = 5
_FOCAL_SIZE = 0.01  # a prior of one per cent of the focal length


@dataclass(frozen=True, slots=True)
class BoardFindings:
    """What boards before a calibrated unit tell.

    `measured` counts the pixel coordinates. `rms_px` is per two-dimensional point with every board where it fits best,
    `rms_focal_px` with one more unknown, the focal length, and `rms_mount_px` with the moves of the mount instead.
    `focal_change` is a share of the focal length and `focal_sigma` its standard deviation; `scale_error` measured over true
    length, less one.
    """

    boards: int
    measured: int
    rms_px: float
    rms_focal_px: float
    rms_mount_px: float
    focal_change: float
    focal_sigma: float
    scale_error: float
    scale_sigma: float

    @property
    def focus_evidence(self) -> float:
        """How much likelier a moved focus ring is than a moved mount, as a difference of Akaike's criterion; 0: as likely.

        The mount has five numbers more to explain the corners with.
        """
        return _MOUNT_NUMBERS_MORE * 2.0 - 2 * self.measured * math.log(self.rms_focal_px / self.rms_mount_px)

    @property
    def focus_moved(self) -> bool:
        """Whether another focal length explains the corners, and better than a mount that moved."""
        return self.rms_focal_px < _EXPLAINS * self.rms_px and self.focus_evidence > 0


def board_findings(
    calibration: Calibration, sightings: tuple[Sighting, ...], board: Board, mount: Mount
) -> BoardFindings:
    """Hold a calibration against boards that both views see, the first eight of them.

    `CalibrationError` where none shows eight corners in both views, `UsageError` for a board in another unit.
    """
    seen = _usable(calibration, sightings, board)

    def longer(amount: Array) -> tuple[Camera, Camera]:
        left, right = (_longer(camera, float(amount[0])) for camera in (calibration.left, calibration.right))
        return left, right

    def moved(amounts: Array) -> tuple[Camera, Camera]:
        R, t = mount.moved(calibration.right, amounts)
        return calibration.left, replace(calibration.right, R_camera_from_left=R, t_camera_from_left=t)

    points = board.points()
    same = fit_boards(seen, points, lambda _: (calibration.left, calibration.right), 0)
    focal = fit_boards(seen, points, longer, 1)
    other = fit_boards(seen, points, moved, len(mount.ways))
    scales = np.array([_scale(calibration, one, board) for one in seen])
    return BoardFindings(
        boards=len(seen),
        measured=4 * sum(int(np.count_nonzero(one.shared)) for one in seen),
        rms_px=same.rms_px,
        rms_focal_px=focal.rms_px,
        rms_mount_px=other.rms_px,
        focal_change=float(focal.amounts[0]) * _FOCAL_SIZE,
        focal_sigma=float(focal.sigmas[0]) * _FOCAL_SIZE,
        scale_error=float(scales[:, 0].mean()),
        scale_sigma=float(np.sqrt(np.mean(scales[:, 1] ** 2) / len(scales))),
    )


def _usable(calibration: Calibration, sightings: tuple[Sighting, ...], board: Board) -> list[Sighting]:
    if board.unit != calibration.unit:
        raise UsageError(
            f"the board is given in {board.unit}, but the calibration is in {calibration.unit}: give --square-mm to both or "
            "to none"
        )
    seen = [one for one in sightings if np.count_nonzero(one.shared) >= _FEWEST_CORNERS][:_MOST_SIGHTINGS]
    if not seen:
        raise CalibrationError(
            f"no frame shows {_FEWEST_CORNERS} corners of the board in both views: hold it into the common field"
        )
    return seen


def _longer(camera: Camera, amount: float) -> Camera:
    lens, factor = camera.lens, 1 + _FOCAL_SIZE * amount
    return replace(camera, lens=replace(lens, fx_px=lens.fx_px * factor, fy_px=lens.fy_px * factor))


def _scale(calibration: Calibration, one: Sighting, board: Board) -> tuple[float, float]:
    """Return how much longer the triangulated board is than the real one, as a share, and a standard deviation of that."""
    shared = one.shared
    true = board.points()[shared]
    found, _ = triangulate(calibration, one.left[shared], one.right[shared])
    true, found = true - true.mean(axis=0), found - found.mean(axis=0)
    U, S, V = np.linalg.svd(found.T @ true)
    S[2] *= np.sign(np.linalg.det(U @ V))
    power = float(np.sum(true**2))
    scale = float(S.sum()) / power
    turned = true @ (U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V).T
    left_over = found - scale * turned
    return scale - 1, float(np.sqrt(np.mean(left_over**2) / power))
