"""Where everything stands: positions derived from a rig and its rays, before any solid is cut.

Frame: the rig's (pupil at the origin, z along the axis, x right, y down), millimetres. The base plate lies below, at
positive y. A mirror seat has its own axes: u along the mirror from its near edge, v down, w backwards from the reflecting
surface (w = 0) through glass, carrier, spring gap and back plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prism_mount.bundles import Bundle, bundle
from prism_mount.interface import Interface
from prism_mount.stock import STOCK
from prismstereo_hw.errors import RigError
from prismstereo_hw.kinds import PrismRig

__all__ = ["DEPTHS", "Depths", "Layout", "SeatFrame"]

Array = NDArray[np.float64]
_COLUMN_X_MM, _COLUMN_HALF_MM = 26.0, 4.0
_ADJUSTER_INSET_MM = 7.0
_COARSE_MM = 0.4  # the openings' outlines are simplified by as much, and widened by it


@dataclass(frozen=True, slots=True)
class SeatFrame:
    """Axes of one mirror seat: `origin` on the near edge in the reflecting surface, unit vectors u, v, w (3,)."""

    side: float  # +1 right, -1 left
    origin: Array
    u: Array
    v: Array
    w: Array

    def point(self, u_mm: float, v_mm: float, w_mm: float) -> Array:
        """Take seat coordinates to the rig frame."""
        return np.asarray(self.origin + u_mm * self.u + v_mm * self.v + w_mm * self.w)


@dataclass(frozen=True, slots=True)
class Depths:
    """Layers of a mirror seat behind the reflecting surface, along w."""

    glass: float = STOCK.mirror_thickness_mm
    carrier_front: float = STOCK.mirror_thickness_mm + STOCK.pad_height_mm
    carrier_back: float = 10.0
    plate_front: float = 14.0
    plate_back: float = 20.5
    foot: float = 32.0  # how far the base plate and the gusset reach back


DEPTHS = Depths()


@dataclass(frozen=True, slots=True)
class Layout:
    """All positions of one mount."""

    rig: PrismRig
    interface: Interface
    bundles: tuple[Bundle, Bundle]

    @classmethod
    def of(cls, rig: PrismRig, interface: Interface) -> Layout:
        """Lay a rig out for a camera interface; `RigError` when prism and columns do not fit."""
        if rig.prism.side_mm / 2 + 6 > _COLUMN_X_MM - _COLUMN_HALF_MM:
            raise RigError(
                f"prism.side_mm is {rig.prism.side_mm:g}, but this mount has room for "
                f"{2 * (_COLUMN_X_MM - _COLUMN_HALF_MM - 6):g}: widen the columns in hw/mount/prism_mount/layout.py"
            )
        return cls(rig, interface, (bundle(rig, "left"), bundle(rig, "right")))

    @property
    def base_mm(self) -> float:
        """Z of the prism's base."""
        return self.rig.prism.pupil_to_prism_mm

    @property
    def apex_mm(self) -> float:
        """Z of the prism's apex."""
        return self.base_mm + self.rig.prism.height_mm

    @property
    def wall_rear_mm(self) -> float:
        """Z of the rear of the wall, where camera and brackets meet the mount."""
        return self.base_mm - 4.0

    @property
    def floor_mm(self) -> float:
        """Y of the base plate's upper side: below prism and mirrors."""
        return max(self.rig.prism.length_mm, self.rig.mirrors.height_mm) / 2 + 3.1

    @property
    def underside_mm(self) -> float:
        """Y of the base plate's lower side."""
        return self.floor_mm + STOCK.plate_mm

    @property
    def top_mm(self) -> float:
        """Y of the columns' upper ends, on which the prism's clamp is screwed."""
        return -self.rig.prism.length_mm / 2 - 7.6

    @property
    def columns(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """X and z of the middles of the two columns beside the prism."""
        return (-_COLUMN_X_MM, self.base_mm), (_COLUMN_X_MM, self.base_mm)

    @property
    def bracket_holes(self) -> tuple[tuple[float, float], ...]:
        """X and y of the four threaded inserts in the wall's rear that every bracket is screwed to."""
        return tuple((x, y) for x in (-_COLUMN_X_MM, _COLUMN_X_MM) for y in (-20.0, 20.0))

    def seat(self, side: float) -> SeatFrame:
        """Return the axes of the right (+1) or the left (-1) mirror's seat."""
        mirrors = self.rig.mirrors
        mu = math.radians(mirrors.angle_deg)
        return SeatFrame(
            side,
            np.array([side * mirrors.near_edge_mm, 0.0, self.base_mm + mirrors.offset_mm]),
            np.array([side * math.cos(mu), 0.0, math.sin(mu)]),
            np.array([0.0, 1.0, 0.0]),
            np.array([side * math.sin(mu), 0.0, -math.cos(mu)]),
        )

    @property
    def adjusters(self) -> dict[str, tuple[float, float]]:
        """U and v of the three screws: pivot and tip on the hinge line near the prism, vergence at the far end."""
        far, low = self.rig.mirrors.length_mm - _ADJUSTER_INSET_MM, self.rig.mirrors.height_mm / 2 - _ADJUSTER_INSET_MM
        return {"pivot": (_ADJUSTER_INSET_MM, low), "tip": (_ADJUSTER_INSET_MM, -low), "vergence": (far, low)}

    @property
    def travel_deg(self) -> dict[str, float]:
        """How far each adjuster turns the mirror, either way from the middle."""
        (u0, v0), (_, v1), (u2, _) = (self.adjusters[name] for name in ("pivot", "tip", "vergence"))
        travel = STOCK.adjuster_travel_mm
        return {
            "tip": math.degrees(math.atan2(travel, abs(v1 - v0))),
            "vergence": math.degrees(math.atan2(travel, u2 - u0)),
        }

    def bore_mm(self, *z_mm: float) -> float:
        """Return the radius that clears the light between pupil and prism at these z."""
        return max(one.radius_at(z) for one in self.bundles for z in z_mm) + STOCK.ray_clearance_mm

    @property
    def baffle_mm(self) -> tuple[float, float]:
        """Z at which the wall between the two bundles begins and ends."""
        crossing = min(one.meets_symmetry_plane_mm() for one in self.bundles)
        far = self.seat(1.0).point(self.rig.mirrors.length_mm, 0.0, 0.0)[2]
        return self.apex_mm + 3.0, float(min(crossing - 10.0, far))

    def outline(self) -> Array:
        """Return the base plate's outline before the openings: (N, 2) of x and z, convex."""
        points = [(x, self.wall_rear_mm) for x in (-40.0, 40.0)]
        points += [(x, self.baffle_mm[1] + 1.0) for x in (-7.0, 7.0)]
        length = self.rig.mirrors.length_mm
        for side in (-1.0, 1.0):
            corners = [(-0.5, DEPTHS.foot - 2), (length + 1.5, 3.0), (length + 1.5, DEPTHS.foot)]
            corners += [(length / 2 + along, DEPTHS.foot + 0.5) for along in (-3.0, 3.0)]  # under the gusset
            corners += [(14.0, DEPTHS.foot + 2.0)]  # material around the foot's screws
            points += [tuple(self.seat(side).point(u, 0.0, w)[[0, 2]]) for u, w in corners]
        kept = np.array(points)
        kept[:, 1] = np.maximum(kept[:, 1], self.wall_rear_mm)  # nothing reaches back into the camera
        return _hull(kept)

    def openings(self) -> tuple[Array, ...]:
        """Return what each view's light needs cut from the base plate: convex outlines (N, 2) of x and z."""
        turn = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        rim = (STOCK.ray_clearance_mm + _COARSE_MM) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        found = []
        for one in self.bundles:
            levels = np.linspace(self.floor_mm, self.underside_mm, 4)
            points = np.concatenate([one.at_height(float(y), 160.0) for y in levels])
            if len(points):
                coarse = cv2.approxPolyDP(_hull(points).astype(np.float32), _COARSE_MM, closed=True).reshape(-1, 1, 2)
                found.append(_hull((coarse + rim).reshape(-1, 2)))
        return tuple(found)


def _hull(points: Array) -> Array:
    return np.asarray(cv2.convexHull(points.astype(np.float32)).reshape(-1, 2), np.float64)
