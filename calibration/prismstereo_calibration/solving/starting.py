"""Where a solve begins: what is asked of the model, and what a rig or the views themselves say of it beforehand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration, Model
from prismstereo_calibration.nominal import nominal_plate
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving import one_lens, two_camera
from prismstereo_calibration.solving.fit import Start, require_frames
from prismstereo_calibration.solving.poses import Pose
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import Rig

__all__ = ["Options", "default_model", "start_of"]


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of the model beside its name; None leaves it to the rig and to the frames.

    `glass`: the rig's plate stands before the lens; by default where the rig has one and lengths are in mm. `full`: p1, p2, k3
    too; by default for two cameras, as far as the frames determine them. `warped`: the board may bend; by default where the
    frames show it beyond doubt.
    """

    glass: bool | None = None
    full: bool | None = None
    warped: bool | None = None


def default_model(rig: Rig | None) -> Model:
    """One lens behind a rig, unless its glass distorts each view in its own way; two cameras without one."""
    return "two-camera" if rig is None or rig.own_lens_per_view else "one-lens"


def start_of(detection: Detection, board: Board, rig: Rig | None, name: Model, options: Options) -> Start:
    """Return the lens model and where it starts; `UsageError` and `CalibrationError` where rig, frames and wish disagree."""
    views, width, height = detection.views, detection.frame_width, detection.frame_height
    plate = _plate(board, rig, name, options)
    if name == "one-lens":
        model = one_lens.model(views, width, height, plate=plate, full=bool(options.full))
    else:
        model = two_camera.model(len(views), full=options.full is not False)
    require_frames(len(detection.sightings), model, detection.rejected)
    if rig is not None:
        lenses, pose = _promise(rig, detection, glass=plate is not None)
        return Start(model, (model.own(*lenses),), (pose,) if board.unit == "mm" else None)
    points, pixels = board.points(), detection.pixels()
    if name == "one-lens":
        own = one_lens.seed(points, pixels, views, width, height)
        return Start(model, (np.append(own, np.zeros(model.matrices[0].shape[1] - own.size)),), None)
    return Start(model, two_camera.seeds(model, points, pixels, views, width, height), None)


def _plate(board: Board, rig: Rig | None, name: Model, options: Options) -> Plate | None:
    """Return the rig's glass where it is to be a part of the model; `UsageError` where it cannot be."""
    plate = None if rig is None else nominal_plate(rig)
    possible = plate is not None and name == "one-lens" and board.unit == "mm"
    if options.glass and not possible:
        raise UsageError(
            "glass can be considered for a rig with a prism or a plate, the one-lens model and a board in mm: "
            "give --rig and --square-mm, or leave --glass out"
        )
    return plate if possible and options.glass is not False else None


def _promise(rig: Rig, detection: Detection, *, glass: bool) -> tuple[tuple[Lens, Lens], Pose]:
    """Return the lenses of the rig's views on frames of this size and the pose it promises; refuse other frames."""
    if detection.views[:2] != rig.views:
        raise UsageError(f"the views are not those of rig {rig.name!r}: leave --layout out where a rig is given")
    size = detection.frame_width, detection.frame_height
    nominal = Calibration.nominal(rig) if glass else Calibration.nominal(rig).pinholes()
    pose = Pose(nominal.right.R_camera_from_left, nominal.right.t_camera_from_left)
    video, still = rig.camera.video, rig.camera.still
    left, right = nominal.left.lens, nominal.right.lens
    if size == (video.width, video.height):
        return (left, right), pose
    if size == (still.width, still.height):  # as wide a field on another grid, and taller
        left, right = (
            replace(lens.scaled(still.width / video.width), cy_px=rig.lens(still).cy_px) for lens in (left, right)
        )
        return (left, right), pose
    raise CalibrationError(
        f"the frames are {size[0]}x{size[1]}, but rig {rig.name!r} takes {video.width}x{video.height} (video) and "
        f"{still.width}x{still.height} (stills): give frames as the camera delivers them, or another rig"
    )
