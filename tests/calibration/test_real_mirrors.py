"""One lens and two planar mirrors, photographed: three views solved as one camera. And two cameras that saw parts of a board.

The views meet along the foot of the mirror, a line askew, so they are polygons of one frame.
PRISMSTEREO_DATA names the folder.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.test_real_markers import BOARD as CHARUCO
from calibration.test_real_markers import seen as charuco_seen
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import Detection, NamedFrame, Sighting
from prismstereo_calibration.solving.solve import Options, solve
from prismstereo_hw.view import View

BOARD = Board(7, 6)
_WIDE, _HIGH = 952.0, 429.0  # of the picture in which the corners below were read


def polygon(*corners: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    return tuple((x / _WIDE, y / _HIGH) for x, y in corners)


FOOT = ((473, 205), (425, 272), (310, 375))  # of the left mirror, from the hinge down
MIRRORED = View(
    left=0.0,
    top=0.0,
    width=0.5,
    height=1.0,
    mirrored=True,
    polygon=polygon((250, 120), (473, 120), *FOOT, (250, 330)),
)
RIGHT = View(
    left=0.45,
    top=0.0,
    width=0.55,
    height=1.0,
    mirrored=True,
    polygon=polygon((480, 120), (700, 120), (700, 340), (600, 290), (480, 245)),
)
DIRECT = View(
    left=0.25,
    top=0.4,
    width=0.5,
    height=0.6,
    polygon=polygon((470, 188), *FOOT, (330, 429), (640, 429), (640, 330), (610, 262), (610, 238), (507, 186)),
)


@cache
def frames(folder: Path) -> tuple[NamedFrame, ...]:
    return tuple(
        NamedFrame(path.name, np.asarray(cv2.imread(str(path)), np.uint8))
        for path in sorted((folder / "mirror-two-planar" / "calib").glob("*.jpg"))
    )


@cache
def mirrors(folder: Path) -> Detection:
    return detect(frames(folder), (MIRRORED, DIRECT, RIGHT), BOARD)


def test_every_mirror_that_shows_the_board_is_looked_into(data: Path) -> None:
    seen = np.isfinite(mirrors(data).pixels()[..., 0]).sum(axis=2)
    assert seen.tolist() == [[42, 42, 42], [42, 42, 0], [42, 42, 0]]


def test_one_lens_explains_the_direct_and_both_mirrored_views(data: Path) -> None:
    """The joint optimum has 0.35 px; intrinsics fixed beforehand leave 0.59 px at 35.3 squares (34.7 over all eight images)."""
    solution = solve(mirrors(data), BOARD, model="one-lens", options=Options(full=True, warped=False))
    found = solution.calibration
    assert solution.rms_px <= 0.40
    assert found.baseline == pytest.approx(34.7, abs=0.5)  # squares
    turn = np.degrees(np.arccos((np.trace(found.right.R_camera_from_left) - 1) / 2))
    assert turn == pytest.approx(74.8, abs=1.0)
    assert found.left.lens.fx_px == pytest.approx(1490, rel=0.04)
    assert len(solution.others) == 1  # the right mirror, seen in one frame


@pytest.mark.soak
def test_an_inverted_board_of_which_each_camera_sees_parts_calibrates_two_lenses(data: Path) -> None:
    seen = charuco_seen(data)  # the second camera stands to the left
    exchanged = tuple(Sighting(one.name, one.pixels[::-1]) for one in seen.sightings)
    detection = replace(seen, sightings=exchanged, views=seen.views[::-1])
    solution = solve(detection, CHARUCO, model="two-camera")
    found = solution.calibration
    assert len(solution.used) >= 24
    assert solution.rms_px <= 1.1
    assert found.right.lens.fx_px == pytest.approx(915, rel=0.05)
    assert found.left.lens.fx_px == pytest.approx(780, rel=0.06)
    assert found.baseline == pytest.approx(1160, rel=0.04)
