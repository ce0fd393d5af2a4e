"""The state of the optics: the last looks together, held against what this unit was like when it was calibrated."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.optics_health.dust import DustMap, DustSpot
from prismstereo_device.optics_health.finding import Finding
from prismstereo_device.optics_health.look import Look
from prismstereo_device.rectify import RectifiedPair

__all__ = ["OpticsHealth", "OpticsReport"]

_LOOKS = 9
_LEAST_LOOKS = 3
_VERTICAL_PX = 0.6
_VERTICAL_SLOPE_PX = 1.0
_BRIGHTNESS = 0.15  # of the ratio at calibration
_SHARPNESS = 0.25
_SEAM_SHARE = 0.004  # of the frame's width
_COVERED = 0.7  # of its light or its texture missing
_REFERENCE = ("brightness_ratio", "sharpness_ratio", "grey_ratio", "texture_ratio", "seam_px")

Reference = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class OpticsReport:
    """All findings after `looks` looks, and the dust of the left and the right view."""

    looks: int
    findings: tuple[Finding, ...]
    dust: tuple[tuple[DustSpot, ...], tuple[DustSpot, ...]]

    @property
    def ok(self) -> bool:
        """Whether nothing warns."""
        return all(finding.state != "warn" for finding in self.findings)

    def finding(self, name: str) -> Finding:
        """Give a finding by its name; KeyError where there is none."""
        return {finding.name: finding for finding in self.findings}[name]

    def as_json(self) -> dict[str, object]:
        """Give plain values for the OPTICS object."""
        places = {
            side: [
                {"x_share": round(s.x_share, 3), "y_share": round(s.y_share, 3), "dark": round(s.dark, 3)}
                for s in spots
            ]
            for side, spots in zip(("left", "right"), self.dust, strict=True)
        }
        found = [finding.as_json() for finding in self.findings]
        return {"ok": self.ok, "looks": self.looks, "findings": found, "dust": places}


class OpticsHealth:
    """Gathers looks at a unit with rectified pictures of `width` x `height` and raw frames `frame_width` wide.

    `reference` is what `OpticsHealth.reference` gave when the calibration was new; without one, the first looks become it.
    For one thread at a time.
    """

    def __init__(self, width: int, height: int, frame_width: int, reference: Reference | None = None) -> None:
        self._frame_width = frame_width
        self._dust = DustMap(width, height)
        self._looks: deque[Look] = deque(maxlen=_LOOKS)
        self._count = 0
        known = dict(reference or {})
        self._reference = {name: float(known.get(name, math.nan)) for name in _REFERENCE}

    @property
    def reference(self) -> dict[str, float]:
        """What was learned of the unit as it was calibrated; empty before a few looks. Finite numbers only, for a JSON file."""
        return {name: value for name, value in self._reference.items() if math.isfinite(value)}

    def add(self, look: Look, pair: RectifiedPair, disparity: DisparityMap | None) -> None:
        """Take one more look; the map may have been decimated, then it tells nothing of dust."""
        self._looks.append(look)
        self._count += 1
        if disparity is not None and disparity.disparity_px.shape == pair.left.shape:
            self._dust.add(pair, disparity)
        if len(self._looks) >= _LEAST_LOOKS:
            for name, value in self._figures().items():
                if name in self._reference and math.isnan(self._reference[name]):
                    self._reference[name] = value

    def report(self) -> OpticsReport:
        """Judge the last looks."""
        now = self._figures()
        dust = self._dust.spots()
        return OpticsReport(self._count, (*self._pose(now), *self._light(now), *_dust_findings(dust)), dust)

    def _figures(self) -> dict[str, float]:
        """Return the medians of the last looks by name; NaN where fewer than three could tell."""
        columns = {field.name: [float(getattr(look, field.name)) for look in self._looks] for field in fields(Look)}
        columns["grey_ratio"] = [_ratio(look.left_grey, look.right_grey) for look in self._looks]
        columns["texture_ratio"] = [_ratio(look.left_texture, look.right_texture) for look in self._looks]
        return {name: _median(values) for name, values in columns.items()}

    def _pose(self, now: Mapping[str, float]) -> tuple[Finding, ...]:
        again = "the views no longer stand as they were calibrated: run `prismstereo refine`, or calibrate again"
        moved = "the prism has moved before the lens: tighten its mount, then calibrate again"
        limit_px = _SEAM_SHARE * self._frame_width
        return (
            Finding("vertical_px", now["vertical_px"], 0.0, _VERTICAL_PX, again),
            Finding("vertical_slope_px", now["vertical_slope_px"], 0.0, _VERTICAL_SLOPE_PX, again),
            Finding("seam_px", now["seam_px"], self._reference["seam_px"], limit_px, moved),
        )

    def _light(self, now: Mapping[str, float]) -> tuple[Finding, ...]:
        was = self._reference
        covered = tuple(
            Finding(
                f"covered_{side}", _share(now, was, side), 1.0, _COVERED,
                f"the {side} view shows next to nothing: look for what covers its mirror or its half of the prism",
            )
            for side in ("left", "right")
        )  # fmt: skip
        darker = _worse(now["brightness_ratio"], was["brightness_ratio"])
        softer = _worse(now["sharpness_ratio"], was["sharpness_ratio"])
        return (
            *covered,
            Finding(
                "brightness_ratio", now["brightness_ratio"], was["brightness_ratio"],
                _BRIGHTNESS * abs(was["brightness_ratio"]),
                f"the {darker} view has become darker: clean its mirror and its half of the prism, look for a shade",
            ),
            Finding(
                "sharpness_ratio", now["sharpness_ratio"], was["sharpness_ratio"],
                _SHARPNESS * abs(was["sharpness_ratio"]),
                f"the {softer} view has become blurred: clean grease or drops off its mirror, check that it is held flat",
            ),
        )  # fmt: skip


def _dust_findings(dust: tuple[tuple[DustSpot, ...], tuple[DustSpot, ...]]) -> tuple[Finding, ...]:
    return tuple(
        Finding(
            f"dust_{side}",
            float(len(spots)),
            0.0,
            0.5,
            f"the {side} view has dark spots: blow dust off its mirror and prism",
        )
        for side, spots in zip(("left", "right"), dust, strict=True)
    )


def _share(now: Mapping[str, float], was: Reference, side: str) -> float:
    """Return what a view has kept of its light or its texture against the other view, at most 1; the smaller of both."""
    kept = [now[name] / was[name] for name in ("grey_ratio", "texture_ratio")]
    if side == "right":
        kept = [1 / share if share > 0 else math.inf for share in kept]
    return math.nan if any(math.isnan(share) for share in kept) else min(1.0, *kept)


def _worse(now: float, was: float) -> str:
    return "left" if now < was else "right"


def _ratio(left: float, right: float) -> float:
    return left / right if right > 0 else math.nan


def _median(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if len(known) >= _LEAST_LOOKS else math.nan
