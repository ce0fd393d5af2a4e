"""How the two views of a unit can move against each other: what its mount lets go of, and by how much.

Where the rig is known, it is the last mirror of each view that creeps: it turns about the vertical, it tips, and it lifts off
its seat. A mirror that turns by an angle turns its view by twice that and carries the virtual pinhole along, so the pose
changes in few ways, and what a scene cannot show (the baseline) follows from what it can. Where no rig is known, the right
camera may turn and shift as it likes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.nominal import nominal_plate
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving.poses import rotations
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.rig import BUILT_IN, LITERATURE, Rig
from prismstereo_hw.view import Side

__all__ = ["FreeMount", "MirrorMount", "Mount", "mount_for", "mount_of"]

Array = NDArray[np.float64]
_SIDES: tuple[Side, Side] = ("left", "right")
_MIRROR_TURN = math.radians(0.1)  # one standard deviation of what a mirror does between two calibrations
_MIRROR_LIFT_MM = 0.05  # turning about an edge of the mirror instead of its middle lifts it by 0.02 mm in 0.05 degrees
_FREE_TURN = math.radians(0.2)
_FREE_SHIFT = 0.006  # of the baseline: 0.3 mm of 50


class Mount(Protocol):
    """The ways in which the right camera can move against the left one, by amounts of one standard deviation each."""

    @property
    def ways(self) -> tuple[str, ...]:
        """What each amount is, with the unit of `sizes`."""
        ...

    @property
    def sizes(self) -> Array:
        """One standard deviation (k,) of each way, in its unit."""
        ...

    @property
    def plate(self) -> Plate | None:
        """The glass that the unit is known to have before both views, as thick as the calibration's unit has it."""
        ...

    def moved(self, right: Camera, amounts: Array) -> tuple[Array, Array]:
        """Return R (3, 3) and t (3,) of the right camera after moves of so many standard deviations (k,)."""
        ...


@dataclass(frozen=True, slots=True)
class FreeMount:
    """Any small turn of the right camera and any small shift of its pinhole, `baseline` long from the left one."""

    baseline: float
    unit: str
    plate: Plate | None = None

    @property
    def ways(self) -> tuple[str, ...]:
        """Three turns and three shifts."""
        return (*(f"turn_{axis}_deg" for axis in "xyz"), *(f"shift_{axis}_{self.unit}" for axis in "xyz"))

    @property
    def sizes(self) -> Array:
        """Turns in degrees, shifts in the calibration's unit."""
        return np.array([math.degrees(_FREE_TURN)] * 3 + [_FREE_SHIFT * self.baseline] * 3)

    def moved(self, right: Camera, amounts: Array) -> tuple[Array, Array]:
        """Return R and t of the right camera after these moves."""
        R = rotations(amounts[:3] * _FREE_TURN) @ right.R_camera_from_left
        centre = right.centre + amounts[3:] * _FREE_SHIFT * self.baseline
        return R, -R @ centre


@dataclass(frozen=True, slots=True)
class MirrorMount:
    """The last mirror of each view; `left_from_rig` R (3, 3), t (3,) takes rig points to the left camera's frame."""

    mirrors: tuple[Surface, Surface]
    R_left_from_rig: Array
    t_left_from_rig: Array
    plate: Plate | None = None

    @property
    def ways(self) -> tuple[str, ...]:
        """A turn, a tip and a lift of each mirror."""
        return tuple(f"{side}_mirror_{way}" for side in _SIDES for way in ("turn_deg", "tip_deg", "lift_mm"))

    @property
    def sizes(self) -> Array:
        """Degrees and millimetres."""
        return np.array([math.degrees(_MIRROR_TURN), math.degrees(_MIRROR_TURN), _MIRROR_LIFT_MM] * 2)

    def moved(self, right: Camera, amounts: Array) -> tuple[Array, Array]:
        """Return R and t of the right camera after these moves."""
        (A, a), (B, b) = (
            _world_turned(mirror, part) for mirror, part in zip(self.mirrors, np.split(amounts, 2), strict=True)
        )
        V, v = self.R_left_from_rig, self.t_left_from_rig
        D = B @ A.T  # what the right mirror does to the world, after the undoing of what the left one does
        d = b - D @ a
        D, d = V @ D @ V.T, V @ d + v - V @ D @ V.T @ v
        return right.R_camera_from_left @ D, right.R_camera_from_left @ d + right.t_camera_from_left


def _world_turned(mirror: Surface, amounts: Array) -> tuple[Array, Array]:
    """Return the motion A (3, 3), a (3,) of the world that looks like a mirror's turn, tip and lift: seen before and after."""
    turn = rotations(mirror.across * amounts[0] * _MIRROR_TURN) @ rotations(mirror.along * amounts[1] * _MIRROR_TURN)
    lifted = replace(
        mirror,
        centre_mm=mirror.centre_mm + amounts[2] * _MIRROR_LIFT_MM * mirror.normal,
        along=turn @ mirror.along,
        across=turn @ mirror.across,
    )
    (M, m), (N, n) = mirror.reflection(), lifted.reflection()
    return M @ N, M @ n + m


def mount_of(calibration: Calibration, rig: Rig | None) -> Mount:
    """Return how a unit can move: by its mirrors where its rig has one for each view, freely otherwise."""
    plate = None if rig is None else _plate(calibration, rig)
    free = FreeMount(calibration.baseline, calibration.unit, plate)
    if rig is None or calibration.unit != "mm":
        return free
    last = [rig.surfaces(side)[-1:] for side in _SIDES]
    left = rig.folded("left")
    if left is None or not all(mirror and mirror[0].action == "reflect" for mirror in last):
        return free
    upright = np.diag([-1.0 if rig.views[0].mirrored else 1.0, 1.0, 1.0])
    return MirrorMount((last[0][0], last[1][0]), upright @ left.R, upright @ left.view_from_rig(np.zeros(3)), plate)


def _plate(calibration: Calibration, rig: Rig) -> Plate | None:
    """Return the rig's glass; where nobody said how large a square is, the baseline tells."""
    plate = nominal_plate(rig)
    if plate is None or calibration.unit == "mm":
        return plate
    return replace(plate, thickness_mm=plate.thickness_mm * calibration.baseline / Calibration.nominal(rig).baseline)


def mount_for(calibration: Calibration, rig: str | None) -> Mount:
    """Return how a unit can move by the rig file or name given, else by the rig that its calibration names, if it is known."""
    if rig is not None:
        return mount_of(calibration, Rig.read(rig))
    known = calibration.rig in BUILT_IN + LITERATURE
    return mount_of(calibration, Rig.read(calibration.rig) if known else None)
