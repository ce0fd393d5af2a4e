"""The prism rig of the paper: an equilateral prism with its base to the lens, and two first-surface mirrors.

The right mirror begins at (x, z) = (near_edge_mm, pupil_to_prism_mm + offset_mm) and rises at `angle_deg` from the x
axis; the left one is its mirror image. A ray is totally reflected inside the prism and crosses over to the other side.
Its optics unfold to a glass plate: see `optics.unfold`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np

from prismstereo_hw.glass import refractive_index
from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.optics.unfold import FoldedView
from prismstereo_hw.rig import Camera, Rig, require
from prismstereo_hw.view import LAYOUTS, Side, View

__all__ = ["Mirrors", "Prism", "PrismRig"]


class Prism(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Equilateral prism, base to the lens."""

    side_mm: float
    length_mm: float  # along y
    glass: str
    pupil_to_prism_mm: float

    @property
    def height_mm(self) -> float:
        """Base to apex: also the thickness of the glass plate that the prism unfolds to."""
        return self.side_mm * math.sqrt(3) / 2

    @property
    def index(self) -> float:
        """Refractive index at the helium d line."""
        return refractive_index(self.glass)


class Mirrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The pair of first-surface mirrors, symmetric but for the tips that assembly leaves."""

    angle_deg: float  # inclination from the x axis
    near_edge_mm: float  # distance of the near edge from the optical axis
    offset_mm: float  # of the near edge above the prism's base
    length_mm: float  # in the xz plane
    height_mm: float  # along y
    left_tip_deg: float = 0.0  # about the mirror's own line in the xz plane: throws the view up or down
    right_tip_deg: float = 0.0


class PrismRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="prism_tir"):
    """A prism rig that can be built; every value was checked when it was made."""

    prism: Prism
    mirrors: Mirrors

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        _check_prism(self.prism, self.camera)
        _check_mirrors(self.mirrors, self.prism)

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right view. Base to the lens crosses them: the right half of the frame is the left view."""
        return LAYOUTS["swapped"]

    @property
    def split_edge_mm(self) -> float:
        """The prism's apex, seen through the glass."""
        return self.prism.pupil_to_prism_mm + self.prism.height_mm / self.prism.index

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return what a viewpoint's rays meet on their way out: base, reflecting face, exit face, mirror."""
        prism = self.prism
        s = -1.0 if side == "left" else 1.0  # side of the mirror; the reflecting face is the other one, hence crossed
        bottom, n = prism.pupil_to_prism_mm, prism.index
        corner, apex = prism.side_mm / 2, (0.0, bottom + prism.height_mm)
        return (
            strip("prism base", "refract", (-corner, bottom), (corner, bottom), prism.length_mm, 1.0, n),
            strip("reflecting face", "total", (-s * corner, bottom), apex, prism.length_mm, n),
            strip("exit face", "refract", (s * corner, bottom), apex, prism.length_mm, n, 1.0),
            self._mirror(side),
        )

    def obstacles(self, side: Side) -> tuple[Surface, ...]:
        """Return the prism, into which a ray may come back, and the other mirror."""
        own, other = self.surfaces(side), self._mirror("right" if side == "left" else "left")
        prism = tuple(replace(face, name="re-enters the prism") for face in own[:3])
        return (*prism, replace(other, name="strikes the other mirror"))

    def _mirror(self, side: Side) -> Surface:
        mirrors = self.mirrors
        s, tip_deg = (-1.0, mirrors.left_tip_deg) if side == "left" else (1.0, mirrors.right_tip_deg)
        mu, tip = math.radians(mirrors.angle_deg), math.radians(tip_deg)
        along = np.array([s * math.cos(mu), 0.0, math.sin(mu)])
        level = np.array([-s * math.sin(mu), 0.0, math.cos(mu)])  # normal of the mirror as drawn
        normal = math.cos(tip) * level + math.sin(tip) * np.array([0.0, 1.0, 0.0])
        near = np.array([s * mirrors.near_edge_mm, 0.0, self.prism.pupil_to_prism_mm + mirrors.offset_mm])
        return Surface(
            f"{side} mirror",
            "reflect",
            near + along * mirrors.length_mm / 2,
            along,
            np.cross(normal, along),
            mirrors.length_mm / 2,
            mirrors.height_mm / 2,
        )

    def folded(self, side: Side) -> FoldedView:
        """Return the exact closed form: two reflections and a plate (paper 3.2, made exact)."""
        _, face, _, mirror = self.surfaces(side)
        A_mirror, b_mirror = mirror.reflection()
        A_face, b_face = face.reflection()
        return FoldedView(side, A_face @ A_mirror, A_face @ b_mirror + b_face, self.prism.height_mm, self.prism.index)


def _check_prism(prism: Prism, camera: Camera) -> None:
    for label, value in (("side_mm", prism.side_mm), ("length_mm", prism.length_mm)):
        require(1 <= value <= 1000, f"prism.{label} is {value:g}: give millimetres between 1 and 1000")
    require(
        0 < prism.pupil_to_prism_mm <= 500,
        f"prism.pupil_to_prism_mm is {prism.pupil_to_prism_mm:g}: the prism stands in front of the lens, 0 to 500",
    )
    half_beam = prism.pupil_to_prism_mm * math.tan(math.radians(camera.hfov_deg / 2))
    require(
        half_beam < prism.side_mm / 2,
        f"the field is {2 * half_beam:.1f} mm wide where it meets the prism's base of {prism.side_mm:g} mm: "
        f"bring the prism nearer than {prism.side_mm / 2 / math.tan(math.radians(camera.hfov_deg / 2)):.1f} mm, or "
        "take a larger one",
    )
    require(
        prism.index > 1.155,  # below, nothing is totally reflected at 60 degrees
        f"prism.glass {prism.glass!r} has index {prism.index:.4f}: below 1.155 an equilateral prism reflects nothing",
    )


def _check_mirrors(mirrors: Mirrors, prism: Prism) -> None:
    require(
        45 < mirrors.angle_deg < 75,
        f"mirrors.angle_deg is {mirrors.angle_deg:g}: behind an equilateral prism both views look forward only between "
        "45 and 75 degrees; 60 - hfov/8 makes them parallel",
    )
    for label, value in (("length_mm", mirrors.length_mm), ("height_mm", mirrors.height_mm)):
        require(1 <= value <= 2000, f"mirrors.{label} is {value:g}: give millimetres between 1 and 2000")
    for label, value in (("near_edge_mm", mirrors.near_edge_mm), ("offset_mm", mirrors.offset_mm)):
        require(abs(value) <= 2000, f"mirrors.{label} is {value:g}: give at most 2000 millimetres")
    for label, value in (("left_tip_deg", mirrors.left_tip_deg), ("right_tip_deg", mirrors.right_tip_deg)):
        require(abs(value) <= 5, f"mirrors.{label} is {value:g}: a mount that is off by more than 5 degrees is broken")
    reach = prism.side_mm / 2 * min(1.0, 1 - mirrors.offset_mm / prism.height_mm)  # half width of the prism up there
    require(
        mirrors.near_edge_mm > max(reach, 0.0),
        f"mirrors.near_edge_mm is {mirrors.near_edge_mm:g}, inside the prism, which reaches {max(reach, 0):.1f} mm from the "
        f"axis {mirrors.offset_mm:g} mm above its base: move the mirrors out or up",
    )
