"""The rig: one camera, one prism with its base to the lens, two first-surface mirrors; read from a TOML file.

Rig frame: origin in the lens' entrance pupil, z along the optical axis, x right, y down, millimetres. The prism's and the
mirrors' edges are parallel to y. The right mirror begins at (x, z) = (near_edge_mm, pupil_to_prism_mm + offset_mm)
and rises at `angle_deg` from the x axis; the left one is its mirror image. See `optics` for what follows from it.
"""

from __future__ import annotations

import math
import os
from importlib import resources
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import tomli_w

from prismstereo_hw.errors import RigError
from prismstereo_hw.glass import refractive_index
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import LAYOUTS, View

__all__ = ["BUILT_IN", "Camera", "Mirrors", "Mode", "Prism", "RangeWish", "Rig"]

BUILT_IN = ("dslr-35mm", "oak-1", "pi-camera-v2")
_MAX_FILE_BYTES = 256 * 1024
_DIRECTORY = "rigs"


class Mode(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One way to read the sensor out: a picture size and, for video, its rate."""

    width: int
    height: int
    rate_hz: float = 0.0


class Camera(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The real camera: its field of view across the whole frame, its pupil, its modes, its lens' flaws."""

    name: str
    hfov_deg: float  # full horizontal field of the video mode, both views together
    pupil_diameter_mm: float
    video: Mode
    still: Mode
    principal_offset_px: tuple[float, float] = (0.0, 0.0)  # of the video mode, from the frame's centre
    distortion: tuple[float, float] = (0.0, 0.0)  # k1, k2


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


class RangeWish(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The depths a rig is meant for, and the number of disparity labels searched: 0 .. labels - 1."""

    near_mm: float
    far_mm: float  # may be inf
    labels: int

    def __post_init__(self) -> None:
        """Refuse an empty window and an unlikely number of labels."""
        if not 0 < self.near_mm < self.far_mm:
            raise RigError(f"range {self.near_mm:g}:{self.far_mm:g} mm is empty: give near < far, both positive")
        if not 16 <= self.labels <= 1024 or self.labels % 16:
            raise RigError(f"{self.labels} disparity labels: give a multiple of 16 between 16 and 1024")


class Rig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A prism rig that can be built; every value was checked when it was made."""

    name: str
    camera: Camera
    prism: Prism
    mirrors: Mirrors
    range: RangeWish
    kind: Literal["prism_tir"] = "prism_tir"

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        _check_camera(self.camera)
        _check_prism(self.prism, self.camera)
        _check_mirrors(self.mirrors, self.prism)
        self._check_distortion()

    @classmethod
    def read(cls, source: str | Path) -> Rig:
        """Read a rig: the name of a built-in one (`dslr-35mm`, `oak-1`, `pi-camera-v2`) or the path of a TOML file."""
        if str(source) in BUILT_IN:
            text = resources.files("prismstereo_hw").joinpath(_DIRECTORY, f"{source}.toml").read_text("utf-8")
            return cls.parse(text, str(source))
        path = Path(source)
        if not os.path.isfile(path):  # unlike Path.is_file, says no to a name that no file can have
            raise RigError(
                f"there is no rig {str(source)!r}: give one of {', '.join(BUILT_IN)}, or the path of a rig file (TOML)"
            )
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise RigError(f"{path} has {path.stat().st_size} bytes: a rig file has at most {_MAX_FILE_BYTES}")
        try:
            return cls.parse(path.read_text("utf-8-sig"), str(path))  # editors put a byte order mark there
        except (OSError, UnicodeDecodeError) as error:
            raise RigError(f"{path} cannot be read as UTF-8 text: {error}") from error

    @classmethod
    def parse(cls, text: str, origin: str) -> Rig:
        """Make a rig of TOML text; `origin` is named in every complaint."""
        try:
            return msgspec.toml.decode(text, type=cls)
        except msgspec.ValidationError as error:
            raise RigError(
                f"{origin}: {error}: compare with the built-in rigs (`prismstereo design oak-1 --toml`)"
            ) from error
        except RigError as error:
            raise RigError(f"{origin}: {error}") from error
        except (msgspec.DecodeError, RecursionError) as error:
            raise RigError(f"{origin} is not TOML: {error}") from error

    def toml(self) -> str:
        """Return this rig as the text of a rig file."""
        return tomli_w.dumps(msgspec.to_builtins(self))

    def _check_distortion(self) -> None:
        for label, mode in (("video", self.camera.video), ("still", self.camera.still)):
            right, bottom = mode.width - 1.0, mode.height - 1.0
            corners = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
            _require(
                bool(np.isfinite(self.lens(mode).slopes(corners)).all()),
                f"camera.distortion {self.camera.distortion} folds the {label} picture before its corners: "
                "give the k1 and k2 of a lens that is one-to-one over the whole frame",
            )

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right view. Base to the lens crosses them: the right half of the frame is the left view."""
        return LAYOUTS["swapped"]

    def lens(self, mode: Mode | None = None) -> Lens:
        """Return the true lens in raw-frame pixels of a mode (default: video).

        Both modes read the whole width of the sensor; the still is taller.
        """
        mode = self.camera.video if mode is None else mode
        scale = mode.width / self.camera.video.width
        focal_px = mode.width / 2 / math.tan(math.radians(self.camera.hfov_deg / 2))
        dx, dy = self.camera.principal_offset_px
        k1, k2 = self.camera.distortion
        return Lens(
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(mode.width - 1) / 2 + scale * dx,
            cy_px=(mode.height - 1) / 2 + scale * dy,
            distortion=(k1, k2, 0.0, 0.0, 0.0),
        )


def _require(holds: bool, complaint: str) -> None:
    if not holds:
        raise RigError(complaint)


def _check_camera(camera: Camera) -> None:
    _require(
        5 <= camera.hfov_deg <= 120,
        f"camera.hfov_deg is {camera.hfov_deg:g}, but one lens for two views sees between 5 and 120 degrees: "
        "give the full horizontal field of the video mode",
    )
    _require(
        0 < camera.pupil_diameter_mm <= 60,
        f"camera.pupil_diameter_mm is {camera.pupil_diameter_mm:g}: give focal length over f-number, 0 to 60",
    )
    for label, mode in (("video", camera.video), ("still", camera.still)):
        _require(
            64 <= mode.width <= 16384 and 48 <= mode.height <= 16384 and mode.width % 2 == 0,
            f"camera.{label} is {mode.width}x{mode.height}: give an even width from 64 and a height from 48 to 16384",
        )
    dx, dy = camera.principal_offset_px
    _require(
        abs(dx) < camera.video.width / 4 and abs(dy) < camera.video.height / 4,
        f"camera.principal_offset_px is {camera.principal_offset_px}: the optical axis meets the sensor within a quarter "
        "of the frame around its middle, or one view is lost",
    )
    _require(
        all(abs(value) <= 10 for value in camera.distortion),
        f"camera.distortion is {camera.distortion}: give k1 and k2 between -10 and 10",
    )
    _require(
        0 < camera.video.rate_hz <= 100_000,
        f"camera.video.rate_hz is {camera.video.rate_hz:g}: give frames per second, more than 0 and at most 100000",
    )


def _check_prism(prism: Prism, camera: Camera) -> None:
    for label, value in (("side_mm", prism.side_mm), ("length_mm", prism.length_mm)):
        _require(1 <= value <= 1000, f"prism.{label} is {value:g}: give millimetres between 1 and 1000")
    _require(
        0 < prism.pupil_to_prism_mm <= 500,
        f"prism.pupil_to_prism_mm is {prism.pupil_to_prism_mm:g}: the prism stands in front of the lens, 0 to 500",
    )
    half_beam = prism.pupil_to_prism_mm * math.tan(math.radians(camera.hfov_deg / 2))
    _require(
        half_beam < prism.side_mm / 2,
        f"the field is {2 * half_beam:.1f} mm wide where it meets the prism's base of {prism.side_mm:g} mm: "
        f"bring the prism nearer than {prism.side_mm / 2 / math.tan(math.radians(camera.hfov_deg / 2)):.1f} mm, or "
        "take a larger one",
    )
    _require(
        prism.index > 1.155,  # below, nothing is totally reflected at 60 degrees
        f"prism.glass {prism.glass!r} has index {prism.index:.4f}: below 1.155 an equilateral prism reflects nothing",
    )


def _check_mirrors(mirrors: Mirrors, prism: Prism) -> None:
    _require(
        45 < mirrors.angle_deg < 75,
        f"mirrors.angle_deg is {mirrors.angle_deg:g}: behind an equilateral prism both views look forward only between "
        "45 and 75 degrees; 60 - hfov/8 makes them parallel",
    )
    for label, value in (("length_mm", mirrors.length_mm), ("height_mm", mirrors.height_mm)):
        _require(1 <= value <= 2000, f"mirrors.{label} is {value:g}: give millimetres between 1 and 2000")
    for label, value in (("near_edge_mm", mirrors.near_edge_mm), ("offset_mm", mirrors.offset_mm)):
        _require(abs(value) <= 2000, f"mirrors.{label} is {value:g}: give at most 2000 millimetres")
    for label, value in (("left_tip_deg", mirrors.left_tip_deg), ("right_tip_deg", mirrors.right_tip_deg)):
        _require(abs(value) <= 5, f"mirrors.{label} is {value:g}: a mount that is off by more than 5 degrees is broken")
    reach = prism.side_mm / 2 * min(1.0, 1 - mirrors.offset_mm / prism.height_mm)  # half width of the prism up there
    _require(
        mirrors.near_edge_mm > max(reach, 0.0),
        f"mirrors.near_edge_mm is {mirrors.near_edge_mm:g}, inside the prism, which reaches {max(reach, 0):.1f} mm from the "
        f"axis {mirrors.offset_mm:g} mm above its base: move the mirrors out or up",
    )
