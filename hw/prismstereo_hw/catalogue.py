"""Common cameras by name: what the designer must know of each, and where every number is from (`cameras.toml`).

Numbers of public data sheets are cited as such, assumptions are marked as assumptions: where the entrance pupil lies in a
lens is told by no data sheet, so measure it on yours if the seam's width matters.
"""

from __future__ import annotations

from importlib import resources

import msgspec

from prismstereo_hw.errors import RigError, UsageError
from prismstereo_hw.rig import Camera, Mode

__all__ = ["CatalogueCamera", "camera", "cameras"]

_FILE = "cameras.toml"


class CatalogueCamera(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One camera with its lens: lengths in mm, the field of view that of the whole width of the video mode."""

    title: str
    sensor: str
    sensor_width_mm: float
    focal_mm: float
    f_number: float
    hfov_deg: float
    pupil_to_prism_mm: float  # the least distance from the entrance pupil at which a prism can stand
    video: Mode
    still: Mode
    sources: dict[str, str]  # field -> where its number is from; begins with "assumed" where nobody says

    @property
    def pupil_diameter_mm(self) -> float:
        """Diameter of the entrance pupil: focal length over f-number."""
        return self.focal_mm / self.f_number

    @property
    def camera(self) -> Camera:
        """The camera section of a rig file."""
        return Camera(
            name=self.title,
            hfov_deg=self.hfov_deg,
            pupil_diameter_mm=round(self.pupil_diameter_mm, 3),
            video=self.video,
            still=self.still,
        )


def cameras() -> dict[str, CatalogueCamera]:
    """Return every camera of the catalogue by name, in the order of the file."""
    text = resources.files("prismstereo_hw").joinpath(_FILE).read_text("utf-8")
    try:
        return msgspec.toml.decode(text, type=dict[str, CatalogueCamera])
    except msgspec.DecodeError as error:
        raise RigError(f"the catalogue {_FILE} is damaged ({error}): install prismstereo again") from error


def camera(name: str) -> CatalogueCamera:
    """Return a camera by name; `UsageError` lists the names.

    >>> camera("pi-camera-v2").sensor
    'Sony IMX219'
    """
    known = cameras()
    if name not in known:
        raise UsageError(
            f"there is no camera {name!r} in the catalogue: choose one of {', '.join(known)}, "
            "or give a rig file that describes your camera"
        )
    return known[name]
