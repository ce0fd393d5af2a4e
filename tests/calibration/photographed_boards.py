"""Photographs of printed boards: flat prints before a pinhole, averaged over the pixels, blurred and noisy, corners known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.target.ink import Raster
from prismstereo_calibration.target.pattern import raster

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

PRINT_PX = 64  # per square
OVER = 3  # samples per pixel, each way
FOCAL_PX = 700.0


@cache
def print_of(board: Board) -> Raster:
    """The board's print with one square of margin."""
    return raster(board, PRINT_PX / board.square)


@dataclass(frozen=True)
class Photograph:
    """How a print is photographed: pose of its middle, light, and what the camera does to it."""

    board: Board
    square_px: float = 30.0
    tilt_deg: float = 0.0
    axis_deg: float = 90.0  # about which axis of the picture it is tilted: 90 is the vertical one
    spin_deg: float = 0.0
    middle_px: tuple[float, float] = (0.0, 0.0)  # from the middle of the picture
    size: tuple[int, int] = (640, 480)
    blur_px: float = 0.6
    noise: float = 2.0
    dark: float = 25.0
    bright: float = 215.0
    seed: int = 0
    print: Raster | None = field(default=None, compare=False)

    @property
    def H(self) -> Array:
        """From the board's plane, in squares, to pixels."""
        corners = self.board.points()[:, :2] / self.board.square
        tilt, axis, spin = (math.radians(angle) for angle in (self.tilt_deg, self.axis_deg, self.spin_deg))
        R, _ = cv2.Rodrigues(tilt * np.array([math.cos(axis), math.sin(axis), 0.0]))
        S, _ = cv2.Rodrigues(np.array([0.0, 0.0, spin]))
        z = FOCAL_PX / self.square_px
        middle = np.array([*self.middle_px, FOCAL_PX]) / FOCAL_PX * z
        P = np.column_stack([(R @ S)[:, :2], middle])
        K = np.array([[FOCAL_PX, 0, (self.size[0] - 1) / 2], [0, FOCAL_PX, (self.size[1] - 1) / 2], [0, 0, 1.0]])
        return np.asarray(K @ P @ np.array([[1, 0, -corners[:, 0].mean()], [0, 1, -corners[:, 1].mean()], [0, 0, 1.0]]))

    @property
    def truth_px(self) -> Array:
        """Where the corners (N, 2) are in the picture."""
        flat = self.board.points()[:, :2] / self.board.square
        return np.asarray(cv2.perspectiveTransform(flat.reshape(-1, 1, 2), self.H).reshape(-1, 2))

    @property
    def pixels(self) -> Grey:
        """The picture, (height, width) uint8."""
        print_ = self.print or print_of(self.board)
        square = self.board.square
        from_print = self.H @ np.diag([1 / square, 1 / square, 1.0]) @ np.linalg.inv(print_.pixel_from_plane)
        shift = (OVER - 1) / 2
        fine = np.array([[OVER, 0, shift], [0, OVER, shift], [0, 0, 1.0]]) @ from_print
        size = self.size[0] * OVER, self.size[1] * OVER
        large = cv2.warpPerspective(
            print_.pixels, fine, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT, borderValue=140
        )
        grey = cv2.resize(large, self.size, interpolation=cv2.INTER_AREA).astype(np.float64)
        if self.blur_px:
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.blur_px), np.float64)
        grey = self.dark + (self.bright - self.dark) / 255 * grey
        grey += np.random.default_rng(self.seed).normal(0, self.noise, grey.shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
