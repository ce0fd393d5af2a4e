"""Pictures of a board as the optical twin takes them, and where its corners truly are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import Scene, board_poses
from prismstereo_hw.scene import board as drawn_board
from prismstereo_hw.twin import Twin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DrawnBoards:
    """Frames of a 9x7 board before a rig, and the exact raw pixels of its corners (frames, 2, N, 2), left view first."""

    rig: Rig
    board: Board
    frames: tuple[NamedFrame, ...]
    truth_px: Array


def drawn_boards(rig: Rig, count: int, seed: int = 1) -> DrawnBoards:
    """Let the twin take so many pictures of a board in random poses, in a dark room."""
    poses = board_poses(rig, count, seed)
    board = Board(9, 7, poses[0][0])
    frames, truth = [], []
    for index, (square_mm, R, t_mm) in enumerate(poses):
        scene = Scene("board", (drawn_board(9, 7, square_mm, R, t_mm),))
        frames.append(NamedFrame(f"view{index:02d}.png", Twin(rig, scene).frame().pixels))
        points = board.points() @ R.T + t_mm
        truth.append([rig.lens().project_slopes(fold(rig, side).slopes(points)) for side in ("left", "right")])
    return DrawnBoards(rig, board, tuple(frames), np.array(truth))
