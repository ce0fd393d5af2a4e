"""Matchers by name: each finds a disparity map for a rectified pair."""

from __future__ import annotations

from threading import Thread

from prismstereo_device.match.base import Matcher
from prismstereo_device.match.settings import MatchSettings
from prismstereo_hw.errors import UsageError

__all__ = ["DEFAULT", "MATCHERS", "MatchSettings", "Matcher", "create", "warm_up"]

MATCHERS = {
    "tiles": "semi-global over a short list of labels per tile: fast, dense, sub-pixel",
    "semiglobal": "the same with all labels in every tile",
    "sgbm": "OpenCV's semi-global matcher, three-way form, checked from the right view as well",
    "sgbm-3way": "OpenCV's semi-global matcher, three-way form, one pass",
    "bm": "OpenCV's block matcher, one pass",
    "growing": "Growing Correspondence Seeds as published: sparse, sure, slow",
    "growing-dense": "the same with weaker thresholds (tau 0.4, mu 0.05, beta 0.05)",
}
DEFAULT = "tiles"


def create(name: str = DEFAULT, settings: MatchSettings | None = None) -> Matcher:
    """Make a matcher by name; `UsageError` lists the names there are."""
    settings = settings or MatchSettings()
    if name in ("tiles", "semiglobal"):
        return _swept(name, settings)
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


def warm_up(name: str, labels: int) -> Thread | None:
    """Begin to compile a matcher's kernels in the background; None where there is nothing to compile."""
    if name in ("tiles", "semiglobal"):
        from prismstereo_device.match.tiles.warm_up import warm_up as compile_sweeps

        return compile_sweeps(labels)
    if name in ("growing", "growing-dense"):
        from prismstereo_device.match.growing.matcher import warm_up as compile_growing

        return compile_growing()
    return None


def _swept(name: str, settings: MatchSettings) -> Matcher:
    """Make a matcher of our own engine, with sub-pixels by gradient least squares."""
    from prismstereo_device.match.subpixel import refine_steps

    if name == "tiles":
        from prismstereo_device.match.tiles.tiles import TilesMatcher

        return TilesMatcher(settings, refine=refine_steps)
    from prismstereo_device.match.tiles.semiglobal import SemiglobalMatcher

    return SemiglobalMatcher(settings, refine=refine_steps)
