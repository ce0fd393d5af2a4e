"""`prismstereo match`: one rectified pair."""

from __future__ import annotations

from pathlib import Path

import click

from prismstereo.cli.output import json_option, say


@click.command("match", epilog="Example:  prismstereo match im2.png im6.png --max-disparity 64 -o teddy.pfm --json")
@click.argument("left", type=click.Path(path_type=Path))
@click.argument("right", type=click.Path(path_type=Path))
@click.option("--matcher", default="sgbm", show_default=True, help="How to match.")
@click.option("--max-disparity", "labels", default=128, show_default=True, help="Search labels 0..N-1.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Disparity file: .pfm, .png or .npy.")
@json_option
def command(left: Path, right: Path, matcher: str, labels: int, out: Path, as_json: bool) -> None:
    """Match the rectified pictures LEFT and RIGHT: disparity of the left one, unmatched where nothing is sure."""
    import time

    import numpy as np

    from prismstereo_calibration.window import DisparityWindow
    from prismstereo_device.match import create
    from prismstereo_device.rectify import RectifiedPair
    from prismstereo_hw import pfm
    from prismstereo_hw.files import read_picture

    pfm.require_format(out)
    pair = RectifiedPair(read_picture(left, grey=True), read_picture(right, grey=True), DisparityWindow(labels))
    begin = time.perf_counter()
    disparity = create(matcher).match(pair)
    milliseconds = 1e3 * (time.perf_counter() - begin)
    pfm.write_disparity(out, disparity.disparity_px)
    valid = int(np.count_nonzero(disparity.valid))
    say(
        {
            "out": out,
            "matcher": matcher,
            "labels": labels,
            "milliseconds": milliseconds,
            "density": disparity.density,
            "valid_pixels": valid,
        },
        [f"{out}: {100 * disparity.density:.1f} % of {disparity.valid.size} pixels matched in {milliseconds:.0f} ms"],
        as_json=as_json,
    )
