"""What the optics and the scene say of a calibration: fine, refine, or recalibrate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from prismstereo_calibration.model import Calibration
from prismstereo_hw.frame import RawFrame

__all__ = ["by_optics", "by_scenes"]

_REFINE = ("vertical_px", "vertical_slope_px")  # findings that say: the views no longer stand as they were calibrated
_RECALIBRATE = ("seam_px",)  # ... the prism itself has moved before the lens


def by_optics(report: Mapping[str, object]) -> dict[str, object]:
    """Judge by the camera's own findings: quick, and with nothing but what streams anyway."""
    findings = report.get("findings")
    found = [one for one in findings if isinstance(one, dict)] if isinstance(findings, list) else []
    warned = {str(one.get("name")): str(one.get("mend", "")) for one in found if one.get("state") == "warn"}
    known = {str(one.get("name")) for one in found if one.get("state") != "unknown"}
    for advice, names in (("recalibrate", _RECALIBRATE), ("refine", _REFINE)):
        for name in names:
            if name in warned:
                return {"advice": advice, "why": warned[name], "by": "optics"}
    if not known & {*_REFINE, *_RECALIBRATE}:
        return {"advice": "unknown", "why": "too few looks at the optics so far", "by": "optics"}
    return {"advice": "fine", "why": "", "by": "optics"}


def by_scenes(calibration: Calibration, frames: Sequence[RawFrame]) -> dict[str, object]:
    """Judge by what both views show of a few scenes, as `prismstereo check` does; `CalibrationError` for too little."""
    from prismstereo_calibration.upkeep.check import check
    from prismstereo_calibration.upkeep.matcher import SceneMatcher
    from prismstereo_calibration.upkeep.mount import mount_for

    matcher = SceneMatcher(calibration)
    scenes = [matcher.match(f"frame {frame.index}", frame) for frame in frames]
    found = check(calibration, scenes, mount_for(calibration, None))
    findings = [
        {
            "name": finding.name,
            "value": round(finding.value, 4),
            "fine_up_to": finding.fine,
            "unit": finding.unit,
            "advice": finding.advice,
        }
        for finding in found.findings
    ]
    return {
        "advice": found.advice,
        "why": found.cause,
        "by": f"{found.matches} points of the scene",
        "findings": findings,
        "unseen_percent": round(200 * found.depth_sigma, 2),
    }
