"""Matchers by name: each finds a disparity map for a rectified pair."""

from __future__ import annotations

from prismstereo_device.match.base import Matcher
from prismstereo_device.match.settings import MatchSettings
from prismstereo_hw.errors import UsageError

__all__ = ["DEFAULT", "MATCHERS", "MatchSettings", "Matcher", "create"]

MATCHERS = {
    "sgbm": "OpenCV's semi-global matcher, three-way form, checked from the right view as well",
    "sgbm-3way": "OpenCV's semi-global matcher, three-way form, one pass",
    "bm": "OpenCV's block matcher, one pass",
    "growing": "Growing Correspondence Seeds as published: sparse, sure, slow",
    "growing-dense": "the same with weaker thresholds (tau 0.4, mu 0.05, beta 0.05)",
}
DEFAULT = "sgbm"


def create(name: str = DEFAULT, settings: MatchSettings | None = None) -> Matcher:
    """Make a matcher by name; `UsageError` lists the names there are."""
    settings = settings or MatchSettings()
    if name == "sgbm":
        from prismstereo_device.match.opencv import SgbmMatcher

        return SgbmMatcher(settings)
    if name == "sgbm-3way":
        from prismstereo_device.match.opencv import ThreeWayMatcher

        return ThreeWayMatcher(settings)
    if name == "bm":
        from prismstereo_device.match.opencv import BlockMatcher

        return BlockMatcher(settings)
    if name.startswith("onnx:"):
        from prismstereo_device.match.learned.onnx import OnnxMatcher

        return OnnxMatcher.named(name, settings)
    if name in ("growing", "growing-dense"):
        from prismstereo_device.match.growing.matcher import GrowingMatcher
        from prismstereo_device.match.growing.settings import PRESETS

        return GrowingMatcher(settings, PRESETS["dense" if name == "growing-dense" else "published"])
    raise UsageError(
        f"there is no matcher {name!r}: choose one of {', '.join(MATCHERS)}, or onnx:MODEL.onnx for a learned one"
    )
