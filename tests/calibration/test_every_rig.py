"""Every planar rig, the whole way: rendered boards -> calibration -> split, rectify, match -> depth against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.solving.solve import Solution, solve
from prismstereo_calibration.truth import true_disparity
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import LITERATURE, Mode, Rig
from prismstereo_hw.scene import Scene, board, board_poses, facing_plane, named
from prismstereo_hw.twin import Twin

COLUMNS, ROWS = 9, 7


@dataclass(frozen=True)
class _Allowed:
    """Bounds, each about twice what was measured: reprojection RMS, median depth error in the rig's range."""

    rms_px: float = 0.15
    depth: float = 0.01


# Glass that bends is not two pinholes, and its distortion depends on depth; interlaced rows are sampled half as finely.
ALLOWED = {"biprism": _Allowed(0.4, 0.02), "plate": _Allowed(0.8, 0.04), "field-sequential": _Allowed(0.4, 0.01)}


def half_size(name: str) -> Rig:
    """Read a rig with a quarter of its pixels: the same optics, and a fourth of the time."""
    rig = Rig.read(name)
    video = Mode(width=rig.camera.video.width // 2, height=rig.camera.video.height // 2, rate_hz=30.0)
    return msgspec.structs.replace(
        rig,
        camera=msgspec.structs.replace(rig.camera, video=video),
        range=msgspec.structs.replace(rig.range, labels=rig.range.labels // 2),
    )


def calibrated(rig: Rig, views: int) -> Solution:
    wall = facing_plane(rig, 3 * rig.range.near_mm).surfaces
    frames = []
    for number, (square_mm, R, t) in enumerate(board_poses(rig, views, 3, columns=COLUMNS, rows=ROWS)):
        scene = Scene("board", (board(COLUMNS, ROWS, square_mm, R, t), *wall))
        frames.append(NamedFrame(f"{number}.png", Twin(rig, scene, seed=number).frame().pixels))
    target = Board(COLUMNS, ROWS, square_mm)
    return solve(detect(frames, rig.views, target), target, rig=rig)


_SLOW = {
    "biprism",
    "plate",
    "three-mirrors",
    "field-sequential",
}  # their optics are traced, or they have several exposures


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.soak) if name in _SLOW else name for name in LITERATURE]
)
def test_a_rig_of_the_literature_calibrates_and_gives_depth(name: str) -> None:
    rig, allowed = half_size(name), ALLOWED.get(name, _Allowed())
    twin = Twin(rig, named(rig, "desk"), noise=1.0)

    solution = calibrated(rig, 7)
    pipeline = Pipeline(solution.calibration)
    found = pipeline.process(twin.frame(1))

    assert solution.rms_px < allowed.rms_px
    truth = true_disparity(twin.truth(1), rectification(solution.calibration))
    error = np.abs(found.depth() - found.window.depth_map(truth)) / found.window.depth_map(truth)
    print(
        f"{name}: rms {solution.rms_px:.3f} px, depth error {np.nanmedian(error):.4f}, {np.isfinite(error).mean():.2f} of it"
    )
    assert np.isfinite(error).mean() > 0.25
    assert np.nanmedian(error) < allowed.depth
