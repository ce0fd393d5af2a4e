"""`prismstereo match`: one rectified pair."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_device.disparity import DisparityMap


@click.command("match", epilog="Example:  prismstereo match im2.png im6.png --max-disparity 64 -o teddy.pfm --json")
@click.argument("left", type=click.Path(path_type=Path))
@click.argument("right", type=click.Path(path_type=Path))
@matching_options
@click.option("--max-disparity", "labels", default=128, show_default=True, help="Search labels 0..N-1.")
@click.option(
    "--confidence", type=click.Path(path_type=Path), help="PNG of how clear each match is: 0 unmatched to 255."
)
@click.option(
    "--reasons", type=click.Path(path_type=Path), help="PNG of why each pixel is unmatched: 0 matched, else a code."
)
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Disparity file: .pfm, .png or .npy.")
@json_option
def command(
    left: Path, right: Path, matching: Matching, labels: int, confidence: Path | None, reasons: Path | None, out: Path,
    as_json: bool,
) -> None:  # fmt: skip
    """Match the rectified pictures LEFT and RIGHT: disparity of the left one, unmatched where nothing is sure."""
    from prismstereo_hw import pfm

    pfm.require_format(out)
    for option, path in (("--confidence", confidence), ("--reasons", reasons)):
        if path is not None and path.suffix.lower() != ".png":
            raise UsageError(f"{option} {path}: this picture is a PNG, give a name that ends in .png")
    found = _found(left, right, matching, labels, explain=reasons is not None)
    _write_pictures(found.disparity, confidence, reasons, matching.name)
    pfm.write_disparity(out, found.disparity.disparity_px)
    result = {
        "out": out,
        "matcher": matching.name,
        "labels": labels,
        "min_disparity": matching.first_px,
        **_figures(found),
        "filters": matching.filters,
        "confidence": confidence,
        "reasons": reasons,
        "unmatched_pixels": None if reasons is None else _counted(found.disparity),
    }
    share, pixels = 100 * found.disparity.density, found.disparity.valid.size
    say(result, [f"{out}: {share:.1f} % of {pixels} pixels matched in {found.milliseconds:.0f} ms"], as_json=as_json)


@dataclass(frozen=True, slots=True)
class _Found:
    """The map of a pair, and how long matching and filtering took."""

    disparity: DisparityMap
    milliseconds: float
    filter_milliseconds: float | None


def _found(left: Path, right: Path, matching: Matching, labels: int, *, explain: bool) -> _Found:
    from prismstereo_calibration.window import DisparityWindow
    from prismstereo_device.rectify import RectifiedPair
    from prismstereo_hw.files import read_picture

    matcher, chain = matching.create(), matching.chain()
    pair = RectifiedPair(read_picture(left, grey=True), read_picture(right, grey=True), DisparityWindow(labels))
    begin = time.perf_counter()
    disparity = matcher.match(pair)
    milliseconds = _milliseconds_since(begin)
    if explain:
        from prismstereo_device.filters import explained

        disparity = explained(disparity, pair.left, pair.right)
    if chain is None:
        return _Found(disparity, milliseconds, None)
    begin = time.perf_counter()
    disparity = chain.apply(disparity, pair.left)
    return _Found(disparity, milliseconds, _milliseconds_since(begin))


def _figures(found: _Found) -> dict[str, object]:
    height, width = found.disparity.disparity_px.shape
    return {
        "milliseconds": found.milliseconds,
        "density": found.disparity.density,
        "valid_pixels": int(found.disparity.valid.sum()),
        "width": width,
        "height": height,
        "filter_milliseconds": found.filter_milliseconds,
    }


def _milliseconds_since(begin_s: float) -> float:
    return 1e3 * (time.perf_counter() - begin_s)


def _write_pictures(disparity: DisparityMap, confidence: Path | None, reasons: Path | None, matcher: str) -> None:
    from prismstereo_hw.files import write_picture

    if confidence is not None:
        if disparity.confidence is None:
            raise UsageError(f"--confidence {confidence}: {matcher} does not tell how sure it is, leave it out")
        write_picture(confidence, disparity.confidence)
    if reasons is not None and disparity.reasons is not None:
        write_picture(reasons, disparity.reasons)


def _counted(disparity: DisparityMap) -> dict[str, object]:
    """Count the unmatched pixels of each reason that there is."""
    import numpy as np

    from prismstereo_device.reasons import Reason

    if disparity.reasons is None:
        return {}
    codes, pixels = np.unique(disparity.reasons[~disparity.valid], return_counts=True)
    return {Reason(int(code)).name.lower(): int(count) for code, count in zip(codes, pixels, strict=True)}
