"""How each camera meets the mount. Every number is the maker's, or an assumption that says so; measure your own unit.

`face_mm`: how far the camera's face (lens rim, housing front, lens tip) lies in front of the entrance pupil. It decides
nothing but where the camera stands; the rear of the mount's wall is 4 mm before the prism's base, and what is missing
between the two is filled by the bracket or by shims. A millimetre of error moves the baseline by a quarter of one
(dB/dd = -0.24) and is absorbed by calibration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["FOR_RIG", "INTERFACES", "Interface"]


@dataclass(frozen=True, slots=True)
class Interface:
    """One way to hold a camera."""

    name: str
    kind: Literal["thread", "housing", "board"]
    face_mm: float
    thread_major_mm: float = 0.0
    thread_pitch_mm: float = 0.75
    housing_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # width (x), height (y), depth (z)
    hole_span_mm: tuple[float, float] = (0.0, 0.0)
    hole_diameter_mm: float = 0.0
    lens_above_board_mm: float = 0.0
    lens_box_mm: float = 0.0
    source: str = ""


_LENS = "ISO filter thread. Assumed: the entrance pupil of a 35 mm lens lies 18 mm behind its rim; shims between ring and wall"
INTERFACES = {
    one.name: one
    for one in (
        Interface("lens-M49", "thread", 18.0, 49.0, source=_LENS),
        Interface("lens-M52", "thread", 18.0, 52.0, source=_LENS),
        Interface("lens-M58", "thread", 18.0, 58.0, source=_LENS),
        Interface(
            "c-mount",
            "thread",
            18.0,
            25.4,
            25.4 / 32,
            source="1-32 UN 2A, for a C-mount camera body whose M12 lens sits in a flat adapter inside the thread",
        ),
        Interface(
            "oak-1",
            "housing",
            2.0,
            housing_mm=(36.0, 54.5, 27.8),
            source="Housing 36 x 54.5 x 27.8 by the maker; it has no holes in its face, so it is held by its sides and back, "
            "and slides up and down until the lens is central. Assumed: pupil 2 mm behind the housing's face",
        ),
        Interface(
            "pi-camera-v2",
            "board",
            1.0,
            hole_span_mm=(21.0, 12.5),
            hole_diameter_mm=2.2,
            lens_above_board_mm=5.9,
            lens_box_mm=8.6,
            source="Holes 21 x 12.5, 2.2 wide, by the maker's drawing. Assumed: lens on the line of the lower "
            "two holes (ribbon down), its tip 5.9 above the board and 1 mm in front of the pupil",
        ),
    )
}
FOR_RIG = {"dslr-35mm": "lens-M52", "oak-1": "oak-1", "pi-camera-v2": "pi-camera-v2"}
