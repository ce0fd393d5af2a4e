"""What `prismstereo design` says to people."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prismstereo_calibration.window import DisparityWindow
    from prismstereo_hw.design.designer import Design
    from prismstereo_hw.optics.figures import RigFigures
    from prismstereo_hw.rig import Rig

__all__ = ["design_lines", "figure_lines"]


def figure_lines(rig: Rig, found: RigFigures, window: DisparityWindow) -> list[str]:
    """Return the figures that every rig has, a line each."""
    return [
        f"{found.rig}: {rig.camera.name}",
        f"  baseline            {found.baseline_mm:.2f} mm (on the axis {found.baseline_paraxial_mm:.2f})",
        f"  vergence            {found.vergence_deg:.1f} deg, each view sees {found.half_field_deg[0]:.1f} to "
        f"{found.half_field_deg[1]:.1f} deg towards the axis",
        f"  focal length        {found.focal_px:.0f} px at {rig.camera.video.width}x{rig.camera.video.height}",
        f"  columns kept        {100 * found.columns_kept:.1f} %"
        + "".join(f" ({100 * share:.1f} % {why})" for why, share in found.lost.items()),
        f"  ghosted at the seam {found.seam_px:.0f} columns",
        f"  viewpoint residual  {found.viewpoint_residual_mm:.3f} mm",
        f"  overlap             half of a view or more from {found.overlap_from_mm:.0f} to {found.overlap_to_mm:.0f} mm; "
        f"common width {_by_distance(found.common_width_mm, 0)}",
        f"  range               {window.nearest:.0f} to {window.farthest:.0f} mm with {window.labels} disparities",
        f"  depth of 0.25 px    {_by_distance(found.depth_step_mm, 1)}",
    ]


def design_lines(design: Design) -> list[str]:
    """Return the dimensions of a prism rig, what it cannot give, and what assembly does to it."""
    prism, mirrors, changes, built = design.rig.prism, design.rig.mirrors, design.sensitivities, design.assembly
    return [
        f"  prism               {prism.glass}, side {prism.side_mm:g} mm, {prism.length_mm:g} mm long, "
        f"{prism.pupil_to_prism_mm:g} mm in front of the pupil",
        f"  mirrors             {mirrors.length_mm:g} x {mirrors.height_mm:g} mm at {mirrors.angle_deg:.2f} deg, near edge "
        f"{mirrors.near_edge_mm:.2f} mm from the axis, {mirrors.offset_mm:.2f} mm above the prism's base",
        f"  field of view       {design.box.field_of_view_deg[0]:.1f} x {design.box.field_of_view_deg[1]:.1f} deg in common",
        f"  the baseline        changes by {changes.mirror_angle_mm_per_deg:.2f} mm per degree of the mirrors, "
        f"{changes.near_edge_mm_per_mm:.2f} and {changes.offset_mm_per_mm:.2f} mm per mm of their distance and height, "
        f"{changes.prism_side_mm_per_mm:.2f} per mm of the prism's side",
        f"  from the drawing    {_by_distance(built.error_from_drawing_mm, 0)} typical depth error, uncalibrated "
        f"({built.units} units drawn, seed {built.seed})",
        f"  after calibration   {_by_distance(built.error_calibrated_mm, 2)}: what no pinhole follows (without the glass)",
        f"  after a creep       of {built.creep_deg:g} deg {_by_distance(built.error_after_creep_mm, 1)}: check again",
        *(f"  limit               {limit.says}" for limit in design.limits),
    ]


def _by_distance(values: dict[str, float], digits: int) -> str:
    return ", ".join(f"{mm:.{digits}f} mm at {float(z) / 1000:g} m" for z, mm in values.items())
