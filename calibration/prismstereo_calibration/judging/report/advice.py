"""What to do with a calibrated unit: the view to add, the parts to align, and what the report was made with."""

from __future__ import annotations

import platform
from html import escape
from importlib.metadata import PackageNotFoundError, version

from prismstereo_calibration.judging.quality import Quality
from prismstereo_calibration.judging.report.table import table, unit_name
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.schema import to_file

__all__ = ["assembly", "next_views", "versions"]

_PACKAGES = ("prismstereo", "numpy", "opencv-python-headless")


def next_views(quality: Quality) -> str:
    """Return the views to add, and what each is expected to bring."""
    if not quality.next_views:
        return "<p>No further view would make depth noticeably more certain.</p>"
    unit = unit_name(quality.unit)
    rows = (
        (
            view.sentence,
            f"{view.sigma_before:.3g} to {view.sigma_after:.3g}",
            f"{100 * view.share_before:.3f} to {100 * view.share_after:.3f}",
        )
        for view in quality.next_views
    )
    depth = quality.next_views[0].depth_of_sigma
    head = ("view", f"depth uncertainty at {depth:.4g} {unit}, {unit}", "mean over the maps, %")
    note = (
        '<p class="note">Expected, one standard deviation, each view on top of those above it. Left and upper are those of '
        "the upright picture.</p>"
    )
    return table(head, rows) + "\n" + note


def assembly(quality: Quality) -> str:
    """Return how the pose between the views differs from that of an ideal rig."""
    built, unit = quality.assembly, unit_name(quality.unit)
    rows = [("turn of the right camera against the left one", f"{built.turn_deg:.3f}", "deg", "by design")]
    if built.axis_off_columns_deg is None or built.shift_along_axis is None or built.shift_share is None:
        rows.append(("axis of that turn", "-", "", "parallel cameras have none"))
    else:
        rows += [
            (
                "its axis off the image columns",
                f"{built.axis_off_columns_deg:.3f}",
                "deg",
                "0: camera square to the rig",
            ),
            (
                "shift along that axis",
                f"{built.shift_along_axis:+.4f}",
                f"{unit} ({100 * built.shift_share:+.2f} % of the baseline)",
                "0: prism edges and mirrors parallel",
            ),
        ]
    rows += [
        ("pitch between the views", f"{built.pitch_deg:+.3f}", "deg", "0: no mirror tipped"),
        ("roll between the views", f"{built.roll_deg:+.3f}", "deg", "0: no mirror tipped"),
        ("asymmetry", f"{built.asymmetry_deg:+.3f}", "deg", "0: both mirrors at one angle"),
    ]
    note = (
        '<p class="note">The calibration measures the pose as it is, so none of this harms depth; it costs rows and columns '
        "that both views could show.</p>"
    )
    return table(("figure", "value", "unit", "ideal"), rows) + "\n" + note


def versions(calibration: Calibration) -> str:
    """Return what the report was made with, and the fingerprint of the calibration it is about."""
    rows = [("Python", platform.python_version()), *((name, _version(name)) for name in _PACKAGES)]
    text = f"<p>Calibration file: sha256 {escape(str(to_file(calibration).sha256))}.</p>"
    return table(("part", "version"), rows) + "\n" + text


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"
