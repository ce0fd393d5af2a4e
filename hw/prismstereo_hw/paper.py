"""Section 3.2 of the paper (Somanath, Rohith, Kambhamettu 2010) by name: its formulas, its variants, its numbers.

What the paper says. Behind an equilateral prism with its base to the lens, a ray that meets the reflecting face at the
incidence phi leaves the mirror at theta = 150 - phi - 2 beta; phi is 60 at the seam of the two half pictures and
60 - alpha/2 at the outer edge. The mirrors' tilt beta lies between alpha/4 and 45 + alpha/4, and the baseline is

    B = 2 [x tan(2 beta - alpha/2) - m f(beta) - (x + m cos beta) tan(2 beta)] / [tan(2 beta - alpha/2) - tan(2 beta)]

for mirrors of length m whose near edges stand x from the axis: twice the abscissa at which the outermost and the seam
ray of one view meet. With alpha = 17, beta = 49.3, m = 76.2 and x = 25.4 it gives 49.62 mm, and calibration found 48.15.

Where this does not fit an equilateral prism. The product therefore designs with exact rays (`optics`, `designer`) and
keeps this module as the record of what was published; nothing else imports it.

1. Two conventions. The formula of theta is exact for the equilateral prism when theta is taken from the x axis and beta
   from the prism's reflecting face, beta = 60 - mirror angle. The bounds and the baseline take 2 beta and
   2 beta - alpha/2 as slopes from the x axis, which an equilateral prism does not give: it sends the middle ray out 30
   degrees above that axis, so that the scene ray stands at twice the mirror angle less 30. In the first convention both
   views overlap to infinity only for 0 < beta < alpha/4, and 49.3 is impossible.
2. The letter f. The text that can be read today has the cosine; deriving the formula gives the sine. No variant gives
   49.62 at 49.3 exactly; all whose second term is subtracted do within the rounding of beta, because B falls by 19 mm
   for each degree.
3. The number proves nothing. At beta = 45 + alpha/4 = 49.25, the upper bound, the first tangent is infinite and B = 2 x
   = 50.8 in every variant. The published 49.3 lies past that bound by 0.05 degrees.
4. The field of view. A 35 mm lens on a sensor 22.3 mm wide sees alpha = 35.3 degrees; 17.7 is the field of one half
   picture. Read like that, beta = 45 + 17/4 is the setting with parallel views. With a full field of 17 degrees the same
   mirrors have no common field.
5. The parts. m is 3 inches in the formula, the mirrors of section 3.1 are 2 inches square; and with x = 25.4 as the near
   edge at the height of the base, 49.62 mm keeps less than half of the columns. The near edge of the built-in rig for
   that camera is 12.9 mm from the axis, which puts the middle of a 2-inch mirror at 26.9: x may have meant the middle.

Angles in degrees, lengths in millimetres.
"""

from __future__ import annotations

import math
from enum import Enum

from prismstereo_hw.errors import UsageError

__all__ = [
    "CALIBRATED_BASELINE_MM", "FIELD_DEG", "MIRROR_LENGTH_MM", "MIRROR_TILT_DEG", "NEAR_EDGE_MM", "PUBLISHED_BASELINE_MM",
    "SEAM_INCIDENCE_DEG", "MirrorTerm", "baseline_mm", "edge_incidence_deg", "mirror_tilt_bounds_deg", "ray_angle_deg",
]  # fmt: skip

FIELD_DEG = 17.0  # section 3.2: alpha, said to be the camera's field of view
MIRROR_TILT_DEG = 49.3  # section 3.2: beta
MIRROR_LENGTH_MM = 76.2  # section 3.2: m, three inches
NEAR_EDGE_MM = 25.4  # section 3.2: x, one inch
PUBLISHED_BASELINE_MM = 49.62  # section 3.2: what the formula is said to give
CALIBRATED_BASELINE_MM = 48.15  # section 4, table 1: what calibrating the built rig gave
SEAM_INCIDENCE_DEG = 60.0  # of the ray along the optical axis, on a face of an equilateral prism


class MirrorTerm(Enum):
    """The second summand of the baseline's numerator: what becomes of the mirror's length m."""

    MINUS_SINE = "- m sin(beta)"  # what the derivation gives
    MINUS_COSINE = "- m cos(beta)"  # what the printed text reads
    PLUS_SINE = "+ m sin(beta)"  # the derivation with the mirror's far end above its near one
    PLUS_COSINE = "+ m cos(beta)"
    ABSENT = "0"

    def at(self, mirror_length_mm: float, mirror_tilt_deg: float) -> float:
        """Return this summand in mm."""
        beta = math.radians(mirror_tilt_deg)
        return {
            MirrorTerm.MINUS_SINE: -mirror_length_mm * math.sin(beta),
            MirrorTerm.MINUS_COSINE: -mirror_length_mm * math.cos(beta),
            MirrorTerm.PLUS_SINE: mirror_length_mm * math.sin(beta),
            MirrorTerm.PLUS_COSINE: mirror_length_mm * math.cos(beta),
            MirrorTerm.ABSENT: 0.0,
        }[self]


def edge_incidence_deg(field_deg: float) -> float:
    """Return phi of the outermost ray, 60 - alpha/2: its incidence on the reflecting face, refraction left out."""
    if not 0 < field_deg < 60:
        raise UsageError(f"a field of {field_deg:g} degrees: the paper's formulas need one between 0 and 60")
    return SEAM_INCIDENCE_DEG - field_deg / 2


def ray_angle_deg(incidence_deg: float, mirror_tilt_deg: float) -> float:
    """Return theta = 150 - phi - 2 beta, the direction of a ray that leaves the mirror.

    >>> ray_angle_deg(60.0, 0.0)
    90.0
    """
    return 150.0 - incidence_deg - 2 * mirror_tilt_deg


def mirror_tilt_bounds_deg(field_deg: float) -> tuple[float, float]:
    """Return the bounds of beta, alpha/4 and 45 + alpha/4: where theta of the outermost ray is 90 and 0.

    >>> mirror_tilt_bounds_deg(17.0)
    (4.25, 49.25)
    """
    edge_incidence_deg(field_deg)  # refuses the fields for which section 3.2 does not hold
    return field_deg / 4, 45 + field_deg / 4


def baseline_mm(
    mirror_tilt_deg: float,
    term: MirrorTerm = MirrorTerm.MINUS_SINE,
    *,
    field_deg: float = FIELD_DEG,
    near_edge_mm: float = NEAR_EDGE_MM,
    mirror_length_mm: float = MIRROR_LENGTH_MM,
    far_end_sign: int = -1,
    denominator_sign: int = -1,
) -> float:
    """Return the paper's baseline; both signs are -1 in the formula that derivation gives, +1 tries the other reading.

    `far_end_sign` stands before (x + m cos beta) tan(2 beta), `denominator_sign` before the denominator's tan(2 beta).
    Numerator and denominator are divided by tan(2 beta - alpha/2), so the upper bound of beta, where that is infinite,
    is an ordinary point. `UsageError` where the two rays are parallel and there is no baseline.
    """
    cotangent = math.tan(math.radians(90 - (2 * mirror_tilt_deg - field_deg / 2)))
    tangent = math.tan(math.radians(2 * mirror_tilt_deg))
    far_end_mm = near_edge_mm + mirror_length_mm * math.cos(math.radians(mirror_tilt_deg))
    numerator = (
        near_edge_mm + (term.at(mirror_length_mm, mirror_tilt_deg) + far_end_sign * far_end_mm * tangent) * cotangent
    )
    denominator = 1 + denominator_sign * tangent * cotangent
    if abs(denominator) < 1e-12:
        raise UsageError(
            f"mirror tilt {mirror_tilt_deg:g} and field {field_deg:g} degrees make the seam and the edge ray parallel: "
            "give a field larger than 0"
        )
    return 2 * numerator / denominator
