"""`prismstereo design`: what the optics of a rig give."""

from __future__ import annotations

from dataclasses import asdict

import click

from prismstereo.cli.output import json_option, say


@click.command("design", epilog="Example:  prismstereo design oak-1 --json")
@click.argument("rig")
@click.option("--toml", "as_toml", is_flag=True, help="Print the rig file itself: a start for your own.")
@json_option
def command(rig: str, as_toml: bool, as_json: bool) -> None:
    """Print the figures of RIG: dslr-35mm, oak-1, pi-camera-v2, or the path of a rig file."""
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.rectification import rectification
    from prismstereo_hw.optics.figures import figures
    from prismstereo_hw.rig import Rig

    built = Rig.read(rig)
    if as_toml:
        click.echo(built.toml(), nl=False)
        return
    found = figures(built)
    window = rectification(Calibration.nominal(built)).window
    result: dict[str, object] = {
        **asdict(found),
        "range_min_mm": window.nearest,
        "range_max_mm": window.farthest,
        "labels": window.labels,
    }
    steps = ", ".join(f"{mm:.1f} mm at {float(z) / 1000:g} m" for z, mm in found.depth_step_mm.items())
    widths = ", ".join(f"{mm:.0f} mm at {float(z) / 1000:g} m" for z, mm in found.common_width_mm.items())
    say(
        result,
        [
            f"{found.rig}: {built.camera.name}",
            f"  baseline            {found.baseline_mm:.2f} mm (on the axis {found.baseline_paraxial_mm:.2f})",
            f"  vergence            {found.vergence_deg:.1f} deg, each view sees {found.half_field_deg[0]:.1f} to "
            f"{found.half_field_deg[1]:.1f} deg towards the axis",
            f"  focal length        {found.focal_px:.0f} px at {built.camera.video.width}x{built.camera.video.height}",
            f"  columns kept        {100 * found.columns_kept:.1f} %"
            + "".join(f" ({100 * share:.1f} % {why})" for why, share in found.lost.items()),
            f"  ghosted at the seam {found.seam_px:.0f} columns",
            f"  viewpoint residual  {found.viewpoint_residual_mm:.3f} mm",
            f"  overlap             half of a view or more from {found.overlap_from_mm:.0f} to {found.overlap_to_mm:.0f} mm; "
            f"common width {widths}",
            f"  range               {window.nearest:.0f} to {window.farthest:.0f} mm with {window.labels} disparities",
            f"  depth of 0.25 px    {steps}",
        ],
        as_json=as_json,
    )
