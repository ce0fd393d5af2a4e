"""The parts of a calibration file: views, lenses, glass, other outputs of the camera, and what is known of their errors.

Every part is strict: a wrong type, a number out of its bounds, a missing and an unknown key are refused by name.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from prismstereo_calibration.outputs import Output
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = [
    "CovariancePart",
    "LensPart",
    "OutputPart",
    "PlatePart",
    "ViewPart",
    "covariance_part",
    "lens_of",
    "lens_part",
    "output_of",
    "output_part",
    "plate_of",
    "plate_part",
    "uncertainty_of",
    "view_of",
    "view_part",
]

_Pixels = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Focal = Annotated[float, Meta(gt=0, le=1e6)]
_Coefficient = Annotated[float, Meta(ge=-1e9, le=1e9)]  # k3 of a narrow lens is large and harmless
_Fraction = Annotated[float, Meta(ge=0, le=1)]
_Small = Annotated[int, Meta(ge=0, le=8)]
_Side = Annotated[int, Meta(ge=1, le=65536)]
_TRIANGLE = len(NUMBERS) * (len(NUMBERS) + 1) // 2
CovariancePart = Annotated[
    tuple[Annotated[float, Meta(ge=-1e18, le=1e18)], ...], Meta(min_length=_TRIANGLE, max_length=_TRIANGLE)
]
"""The lower triangle of the covariance of the 24 numbers (see `uncertainty`), row after row."""


class ViewPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """One view's rectangle, as fractions of the frame, and how it stands there (see `prismstereo_hw.view`).

    Rows, exposures and the polygon are left out where the view is all of its rectangle.
    """

    left_fraction: _Fraction
    top_fraction: _Fraction
    width_fraction: _Fraction
    height_fraction: _Fraction
    mirrored: bool
    turn_deg: Literal[0, 90, 180, 270]
    row_start: _Small = 0
    row_step: _Small = 1
    exposure: _Small = 0
    exposures: _Small = 1
    polygon_fraction: Annotated[tuple[tuple[_Fraction, _Fraction], ...], Meta(max_length=64)] = ()


class LensPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One camera's lens in upright full-frame pixels (see `prismstereo_hw.lens`); k1 .. k3 have no unit."""

    fx_px: _Focal
    fy_px: _Focal
    cx_px: _Pixels
    cy_px: _Pixels
    k1: _Coefficient
    k2: _Coefficient
    p1: _Coefficient
    p2: _Coefficient
    k3: _Coefficient


class PlatePart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The glass before both views."""

    thickness_mm: Annotated[float, Meta(gt=0, le=1000)]
    index: Annotated[float, Meta(gt=1, le=4)]


class OutputPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Another output of the camera: x_output = scale * x + shift of the calibrated frame's pixels."""

    name: Annotated[str, Meta(min_length=1, max_length=100)]
    width_px: _Side
    height_px: _Side
    scale: Annotated[float, Meta(ge=0.01, le=100)]
    shift_x_px: _Pixels
    shift_y_px: _Pixels
    rms_px: Annotated[float, Meta(ge=0, le=1e6)] | None = None


def view_part(view: View) -> ViewPart:
    """Return a view as it stands in a file."""
    return ViewPart(
        left_fraction=view.left,
        top_fraction=view.top,
        width_fraction=view.width,
        height_fraction=view.height,
        mirrored=view.mirrored,
        turn_deg=view.turn_deg,
        row_start=view.row_start,
        row_step=view.row_step,
        exposure=view.exposure,
        exposures=view.exposures,
        polygon_fraction=view.polygon,
    )


def view_of(part: ViewPart) -> View:
    """Make the view that a file describes; `RigError` for one that leaves the frame."""
    return View(
        left=part.left_fraction,
        top=part.top_fraction,
        width=part.width_fraction,
        height=part.height_fraction,
        mirrored=part.mirrored,
        turn_deg=part.turn_deg,
        row_start=part.row_start,
        row_step=part.row_step,
        exposure=part.exposure,
        exposures=part.exposures,
        polygon=part.polygon_fraction,
    )


def lens_part(lens: Lens) -> LensPart:
    """Return a lens as it stands in a file."""
    k1, k2, p1, p2, k3 = (float(value) for value in lens.distortion)
    return LensPart(
        fx_px=float(lens.fx_px),
        fy_px=float(lens.fy_px),
        cx_px=float(lens.cx_px),
        cy_px=float(lens.cy_px),
        k1=k1,
        k2=k2,
        p1=p1,
        p2=p2,
        k3=k3,
    )


def lens_of(part: LensPart) -> Lens:
    """Make the lens that a file describes."""
    distortion = (part.k1, part.k2, part.p1, part.p2, part.k3)
    return Lens(part.fx_px, part.fy_px, part.cx_px, part.cy_px, distortion)


def plate_part(plate: Plate) -> PlatePart:
    """Return glass as it stands in a file."""
    return PlatePart(thickness_mm=float(plate.thickness_mm), index=float(plate.index))


def plate_of(part: PlatePart) -> Plate:
    """Make the glass that a file describes."""
    return Plate(part.thickness_mm, part.index)


def output_part(output: Output) -> OutputPart:
    """Return an output of the camera as it stands in a file."""
    return OutputPart(
        name=output.name,
        width_px=output.width,
        height_px=output.height,
        scale=float(output.scale),
        shift_x_px=float(output.shift_x_px),
        shift_y_px=float(output.shift_y_px),
        rms_px=None if output.rms_px is None else float(output.rms_px),
    )


def output_of(part: OutputPart) -> Output:
    """Make the output that a file describes."""
    shift = part.shift_x_px, part.shift_y_px
    return Output(part.name, part.width_px, part.height_px, part.scale, *shift, part.rms_px)


def covariance_part(uncertainty: Uncertainty) -> tuple[float, ...]:
    """Return a covariance as it stands in a file."""
    return tuple(uncertainty.covariance[np.tril_indices(len(NUMBERS))].tolist())


def uncertainty_of(part: tuple[float, ...]) -> Uncertainty:
    """Make the uncertainty that a file describes; `CalibrationError` for what is no covariance."""
    covariance = np.zeros((len(NUMBERS), len(NUMBERS)))
    covariance[np.tril_indices(len(NUMBERS))] = part
    return Uncertainty(covariance + np.tril(covariance, -1).T)
