"""`prismstereo depth`: raw frames to disparity, depth, cloud and picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
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
@click.option("--matcher", default="sgbm", show_default=True, help="How to match.")
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP)
@click.option("--max-disparity", "labels", type=click.IntRange(16, 1024), help="Search labels 0..N-1 with --range-mm.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for the results.")
@json_option
def command(
    raw: tuple[Path, ...], left: str | None, right: str | None, calibration: Path | None, matcher: str,
    range_mm: str | None, labels: int | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Turn RAW frames, or the video of a session folder, into depth.

    Each frame gives NAME_disparity.pfm, NAME_depth.pfm, NAME_depth.png (the picture) and NAME.ply.
    """
    from prismstereo_calibration.store import read
    from prismstereo_device.match import create
    from prismstereo_device.pipeline import Pipeline

    frames, own_calibration = _inputs(raw, left, right)
    path = calibration or own_calibration
    if path is None:
        raise UsageError("depth needs to know the unit: give its calibration with --calibration FILE")
    wish = parse_range(range_mm, labels or 128)
    if labels is not None and wish is None:
        raise UsageError("--max-disparity goes with --range-mm: the two decide the depths together")
    pipeline = Pipeline(read(path), create(matcher), wish=wish, labels=labels)
    results = [_one(pipeline, name, frame, out) for name, frame in with_progress(frames, None, "depth")]
    window, unit = pipeline.rectifier.rectification.window, pipeline.calibration.unit
    say(
        {
            "frames": results,
            "out": out,
            "unit": unit,
            "matcher": matcher,
            "labels": window.labels,
            f"range_min_{_suffix(unit)}": window.nearest,
            f"range_max_{_suffix(unit)}": window.farthest,
            f"baseline_{_suffix(unit)}": pipeline.calibration.baseline,
        },
        [
            *(
                f"{frame['file']}: {100 * float(str(frame['density'])):.1f} % matched, median depth "
                f"{frame[f'median_depth_{_suffix(unit)}']:.4g} {unit}, {float(str(frame['milliseconds'])):.0f} ms"
                for frame in results
            ),
            f"wrote disparity, depth, picture and cloud of {len(results)} frames to {out}",
        ],
        as_json=as_json,
    )


def _suffix(unit: str) -> str:
    return "mm" if unit == "mm" else "squares"


def _inputs(
    raw: tuple[Path, ...], left: str | None, right: str | None
) -> tuple[Iterator[tuple[str, RawFrame]], Path | None]:
    from prismstereo.frames import named_frames, paired_frames
    from prismstereo_hw.session import Session

    if left or right:
        if raw or not (left and right):
            raise UsageError("give RAW frames, or both --left and --right, not a mixture")
        return paired_frames(left, right), None
    if not raw:
        raise UsageError("give RAW frames or a session folder: prismstereo depth FRAME.png --calibration C.json -o out")
    if len(raw) == 1 and (raw[0] / "session.toml").is_file():
        session = Session.open(raw[0])
        return named_frames(session.paths("video")), session.calibration_path
    return named_frames(list(raw)), None


def _one(pipeline: Pipeline, name: str, frame: RawFrame, out: Path) -> dict[str, object]:
    """Do one frame: all four files of it, then its line of figures."""
    import time

    import numpy as np

    from prismstereo.cloud import point_cloud
    from prismstereo.picture import depth_picture
    from prismstereo_hw import pfm
    from prismstereo_hw.files import write_picture

    begin = time.perf_counter()
    pair = pipeline.split(frame)
    disparity = pipeline.disparity(pair)
    milliseconds = 1e3 * (time.perf_counter() - begin)
    unit, rectification = pipeline.calibration.unit, pipeline.rectifier.rectification
    depth = disparity.depth()
    cloud = point_cloud(disparity, rectification, pipeline.rectifier.left_picture(pair))
    pfm.write_disparity(out / f"{name}_disparity.pfm", disparity.disparity_px)
    pfm.write(out / f"{name}_depth.pfm", depth)
    write_picture(out / f"{name}_depth.png", depth_picture(disparity, unit))
    cloud.write(out / f"{name}.ply")
    known = depth[np.isfinite(depth)]
    return {
        "file": name,
        "milliseconds": milliseconds,
        "density": disparity.density,
        "valid_pixels": int(np.count_nonzero(disparity.valid)),
        "points": len(cloud.points),
        f"median_depth_{_suffix(unit)}": float(np.median(known)) if known.size else float("nan"),
    }
