"""`prismstereo depth`: raw frames to disparity, depth, cloud and picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_calibration.model import Calibration
    from prismstereo_device.disparity import DisparityMap
    from prismstereo_device.filters import FilterChain
    from prismstereo_device.pipeline import Pipeline
    from prismstereo_hw.frame import RawFrame


@click.command(
    "depth", epilog="Example:  prismstereo depth desk/video/000000.png --calibration desk/calibration.json -o out"
)
@click.argument("raw", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--left", "left", metavar="PATTERN", help="Left pictures of two cameras, instead of RAW (quoted pattern)."
)
@click.option("--right", "right", metavar="PATTERN", help="Right pictures of two cameras, paired by number.")
@click.option("--calibration", type=click.Path(path_type=Path), help="Calibration file; a session folder has its own.")
@matching_options
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP)
@click.option("--max-disparity", "labels", type=click.IntRange(16, 1024), help="Search labels 0..N-1 with --range-mm.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for the results.")
@json_option
def command(
    raw: tuple[Path, ...], left: str | None, right: str | None, calibration: Path | None, matching: Matching,
    range_mm: str | None, labels: int | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Turn RAW frames, or the video of a session folder, into depth.

    Each frame gives NAME_disparity.pfm, NAME_depth.pfm, NAME_depth.png (the picture) and NAME.ply. By a rectification from
    a scene (`calibrate --from-scene`), which has no scale, only NAME_disparity.pfm and its picture NAME_disparity.png.
    """
    from prismstereo.depth import depth_of
    from prismstereo_calibration.uncalibrated.store import is_scene_rectification
    from prismstereo_device.pipeline import Pipeline

    matcher, chain = matching.create(), _chain(matching)
    inputs = _inputs(raw, left, right)
    wish = parse_range(range_mm, labels or 128)
    if labels is not None and wish is None:
        raise UsageError("--max-disparity goes with --range-mm: the two decide the depths together")
    if calibration is not None and is_scene_rectification(calibration):
        _without_scale(calibration, inputs, matching, out, wished=wish is not None, as_json=as_json)
        return
    pipeline = Pipeline(_calibration(calibration, inputs), matcher, wish=wish, labels=labels, filters=chain)
    suffix = "mm" if pipeline.calibration.unit == "mm" else "squares"
    results: list[dict[str, object]] = []
    lines: list[str] = []
    for name, frame in with_progress(inputs.frames, inputs.count, "depth"):
        found = depth_of(pipeline, frame)
        found.write(out, name)
        own = {"points": len(found.cloud.points), f"median_depth_{suffix}": found.median_depth}
        results.append({**_matched(name, found.disparity, found.milliseconds), **own})
        share = 100 * found.disparity.density
        lines.append(f"{name}: {share:.1f} % matched, median depth {found.median_depth:.4g} {found.unit}, "
                     f"{found.milliseconds:.0f} ms")  # fmt: skip
    lines.append(f"wrote disparity, depth, picture and cloud of {len(results)} frames to {out}")
    say({"frames": results, "out": out, "matcher": matching.name, **_window(pipeline, suffix)}, lines, as_json=as_json)


def _chain(matching: Matching) -> FilterChain | None:
    """Read the filters that were asked for; `UsageError` for those that make the map smaller."""
    from prismstereo_device.filters.decimate import Decimate

    chain = matching.chain()
    if chain is not None and any(isinstance(each, Decimate) for each in chain.filters):
        raise UsageError(
            "these filters decimate, but each disparity is to lie on a pixel of the rectified picture: leave decimate out"
        )
    return chain


def _without_scale(path: Path, inputs: _Inputs, matching: Matching, out: Path, *, wished: bool, as_json: bool) -> None:
    """Turn the frames into disparity by a rectification from a scene, and say that there is no depth."""
    from prismstereo.scene_disparity import ScenePipeline
    from prismstereo_calibration.uncalibrated.store import read

    if wished:
        raise UsageError(
            f"--range-mm: {path} is a rectification from a scene and has no scale, so there are no millimetres: calibrate with "
            "a board"
        )
    made = read(path)
    _require_rig(inputs.rig, made.rig or inputs.rig, path)
    pipeline = ScenePipeline(made, matching.create(), _chain(matching))
    results: list[dict[str, object]] = []
    lines: list[str] = []
    for name, frame in with_progress(inputs.frames, inputs.count, "disparity"):
        found = pipeline.process(frame)
        found.write(out, name)
        results.append(_matched(name, found.disparity, found.milliseconds))
        lines.append(f"{name}: {100 * found.disparity.density:.1f} % matched, {found.milliseconds:.0f} ms")
    lines.append(f"wrote disparity and picture of {len(results)} frames to {out}")
    lines.append(
        "no depth and no cloud: a rectification from a scene has no scale, calibrate with a board for millimetres"
    )
    labels = made.window.labels
    result = {
        "frames": results,
        "out": out,
        "matcher": matching.name,
        "unit": None,
        "labels": labels,
        "form": made.form,
    }
    say(result, lines, as_json=as_json)


def _matched(name: str, disparity: DisparityMap, milliseconds: float) -> dict[str, object]:
    valid = int(disparity.valid.sum())
    return {"file": name, "milliseconds": milliseconds, "density": disparity.density, "valid_pixels": valid}


def _window(pipeline: Pipeline, suffix: str) -> dict[str, object]:
    window = pipeline.rectifier.rectification.window
    return {
        "unit": pipeline.calibration.unit,
        "labels": window.labels,
        f"range_min_{suffix}": window.nearest,
        f"range_max_{suffix}": window.farthest,
        f"baseline_{suffix}": pipeline.calibration.baseline,
    }


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Frames by name, how many, and what is known of where they come from."""

    frames: Iterator[tuple[str, RawFrame]]
    count: int
    rig: str | None = None
    calibration: Path | None = None


def _inputs(raw: tuple[Path, ...], left: str | None, right: str | None) -> _Inputs:
    from prismstereo.frames import expand, named_frames, paired_frames, pairs
    from prismstereo_hw.session import Session

    if left or right:
        if raw or not (left and right):
            raise UsageError("give RAW frames, or both --left and --right, not a mixture")
        return _Inputs(paired_frames(left, right), len(pairs(left, right)))
    if not raw:
        raise UsageError("give RAW frames or a session folder: prismstereo depth FRAME.png --calibration C.json -o out")
    if len(raw) == 1 and raw[0].is_dir() and (raw[0] / "session.toml").is_file():
        session = Session.open(raw[0])
        paths = session.paths("video")
        if not paths:
            raise UsageError(f"{raw[0]} holds no video frames: simulate some with --frames, or give RAW frames")
        return _Inputs(named_frames(paths), len(paths), session.info.rig, session.calibration_path)
    files = expand(raw)
    home = files[0].parent.parent  # a frame inside of a session folder belongs to that session
    inside = (home / "session.toml").is_file()
    return _Inputs(named_frames(files), len(files), Session.open(home).info.rig if inside else None)


def _calibration(path: Path | None, inputs: _Inputs) -> Calibration:
    from prismstereo_calibration.store import read

    path = path or inputs.calibration
    if path is None:
        raise UsageError("depth needs to know the unit: give its calibration with --calibration FILE")
    calibration = read(path)
    _require_rig(inputs.rig, calibration.rig, path)
    return calibration


def _require_rig(taken_with: str | None, made_for: str | None, path: Path) -> None:
    from prismstereo_calibration.errors import CalibrationError

    if taken_with is not None and taken_with != made_for:
        raise CalibrationError(
            f"{path} is a calibration of {made_for!r}, but the session was taken with {taken_with!r}: give the calibration of "
            "the same rig"
        )
