"""The rig: one camera and the optics that give it two views, read from a TOML file.

Rig frame: origin in the lens' entrance pupil, z along the optical axis, x right, y down, millimetres. All edges of prisms
and mirrors are parallel to y. What stands before the lens, and its numbers, is the rig's kind: see `kinds`.
"""

from __future__ import annotations

import math
import os
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import tomli_w

from prismstereo_hw.errors import RigError
from prismstereo_hw.lens import Lens
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.optics.unfold import FoldedView, unfold_mirrors
from prismstereo_hw.view import LAYOUTS, Side, View

if TYPE_CHECKING:
    from prismstereo_hw.kinds import AnyRig

__all__ = ["BUILT_IN", "LITERATURE", "Camera", "Mode", "RangeWish", "Rig", "require"]

BUILT_IN = ("dslr-35mm", "oak-1", "pi-camera-v2")  # the prism rigs this product is made for
LITERATURE = (  # the other planar rigs of the paper's figure 2 and of the products it names
    "biprism",
    "field-sequential",
    "four-mirrors",
    "plate",
    "single-mirror",
    "three-mirrors",
    "two-mirrors",
    "wedge",
)
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


class Rig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """What all rigs are: a camera, the depths it is meant for, and whatever stands in front of it (see `kinds`)."""

    name: str
    camera: Camera
    range: RangeWish

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        _check_camera(self.camera)
        self._check_distortion()

    @classmethod
    def read(cls, source: str | Path) -> AnyRig:
        """Read a rig: the name of a built-in one (`dslr-35mm`, `oak-1`, `pi-camera-v2`) or the path of a TOML file."""
        if str(source) in BUILT_IN + LITERATURE:
            text = resources.files("prismstereo_hw").joinpath(_DIRECTORY, f"{source}.toml").read_text("utf-8")
            return cls.parse(text, str(source))
        path = Path(source)
        if not os.path.isfile(path):  # unlike Path.is_file, says no to a name that no file can have
            raise RigError(
                f"there is no rig {str(source)!r}: give one of {', '.join(BUILT_IN + LITERATURE)}, or the path of a rig "
                "file (TOML)"
            )
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise RigError(f"{path} has {path.stat().st_size} bytes: a rig file has at most {_MAX_FILE_BYTES}")
        try:
            return cls.parse(path.read_text("utf-8-sig"), str(path))  # editors put a byte order mark there
        except (OSError, UnicodeDecodeError) as error:
            raise RigError(f"{path} cannot be read as UTF-8 text: {error}") from error

    @classmethod
    def parse(cls, text: str, origin: str) -> AnyRig:
        """Make a rig of TOML text; `origin` is named in every complaint."""
        from prismstereo_hw.kinds import AnyRig

        try:
            found: AnyRig = msgspec.toml.decode(text, type=AnyRig)
        except msgspec.ValidationError as error:
            raise RigError(
                f"{origin}: {error}: compare with the built-in rigs (`prismstereo design oak-1 --toml`)"
            ) from error
        except RigError as error:
            raise RigError(f"{origin}: {error}") from error
        except (msgspec.DecodeError, RecursionError) as error:
            raise RigError(f"{origin} is not TOML: {error}") from error
        return found

    def toml(self) -> str:
        """Return this rig as the text of a rig file."""
        return tomli_w.dumps(msgspec.to_builtins(self))

    def _check_distortion(self) -> None:
        for label, mode in (("video", self.camera.video), ("still", self.camera.still)):
            right, bottom = mode.width - 1.0, mode.height - 1.0
            corners = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
            require(
                bool(np.isfinite(self.lens(mode).slopes(corners)).all()),
                f"camera.distortion {self.camera.distortion} folds the {label} picture before its corners: "
                "give the k1 and k2 of a lens that is one-to-one over the whole frame",
            )

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right view of the raw frame."""
        return LAYOUTS["side-by-side"]

    @property
    def split_edge_mm(self) -> float | None:
        """Distance from the pupil to the edge that divides the views, reduced by glass before it; None: no such edge."""
        return None

    @property
    def own_lens_per_view(self) -> bool:
        """Whether the optics bend directions, so that each view needs a distortion of its own."""
        return False

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return what a viewpoint's rays meet, in their order from the lens to the scene; nothing: a direct view."""
        del side
        return ()

    def obstacles(self, side: Side) -> tuple[Surface, ...]:
        """Return what a viewpoint's rays may run into after the last of their surfaces; the name says what happens."""
        del side
        return ()

    def folded(self, side: Side) -> FoldedView | None:
        """Return the exact closed form of a view, None where its glass has none."""
        return unfold_mirrors(side, self.surfaces(side))

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


def require(holds: bool, complaint: str) -> None:
    """Raise `RigError` with the complaint unless the rule holds."""
    if not holds:
        raise RigError(complaint)


def _check_camera(camera: Camera) -> None:
    require(
        5 <= camera.hfov_deg <= 120,
        f"camera.hfov_deg is {camera.hfov_deg:g}, but one lens for two views sees between 5 and 120 degrees: "
        "give the full horizontal field of the video mode",
    )
    require(
        0 < camera.pupil_diameter_mm <= 60,
        f"camera.pupil_diameter_mm is {camera.pupil_diameter_mm:g}: give focal length over f-number, 0 to 60",
    )
    for label, mode in (("video", camera.video), ("still", camera.still)):
        require(
            64 <= mode.width <= 16384 and 48 <= mode.height <= 16384 and mode.width % 2 == 0,
            f"camera.{label} is {mode.width}x{mode.height}: give an even width from 64 and a height from 48 to 16384",
        )
    dx, dy = camera.principal_offset_px
    require(
        abs(dx) < camera.video.width / 4 and abs(dy) < camera.video.height / 4,
        f"camera.principal_offset_px is {camera.principal_offset_px}: the optical axis meets the sensor within a quarter "
        "of the frame around its middle, or one view is lost",
    )
    require(
        all(abs(value) <= 10 for value in camera.distortion),
        f"camera.distortion is {camera.distortion}: give k1 and k2 between -10 and 10",
    )
    require(
        0 < camera.video.rate_hz <= 100_000,
        f"camera.video.rate_hz is {camera.video.rate_hz:g}: give frames per second, more than 0 and at most 100000",
    )
