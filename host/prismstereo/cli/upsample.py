"""`prismstereo upsample`: one disparity map onto one still."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.fusion.upsampling import Grid, Upsampled

_METHODS = ("edge-snap", "votes", "geodesic", "joint-bilateral", "weighted-mode")
_UNEVEN = 0.02  # of the two scales that the sizes give; more than rounding makes


@click.command(
    "upsample", epilog="Example:  prismstereo upsample video.pfm still.jpg --scale 3.7125 -o still.pfm --json"
)
@click.argument("disparity", type=click.Path(path_type=Path))
@click.argument("guide", type=click.Path(path_type=Path))
@click.option("--method", type=click.Choice(_METHODS), default=_METHODS[0], show_default=True, help="How to upsample.")
@click.option(
    "--scale", type=float, help="Still pixels per pixel of the map, both with one middle. Default: from the sizes."
)
@click.option(
    "--shift", nargs=2, type=float, metavar="X Y", help="Still pixels that the map lies off that place, right and down."
)
@click.option("--keep-holes", is_flag=True, help="Leave empty what rests on a hole of the map.")
@click.option(
    "--flags",
    type=click.Path(path_type=Path),
    help="PNG of how each pixel came about: the bits of `prismstereo.fusion.flags`.",
)
@click.option("--threads", default=2, show_default=True, type=click.IntRange(1, 256), help="How many work at once.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Disparity file: .pfm, .png or .npy.")
@json_option
def command(
    disparity: Path, guide: Path, method: str, scale: float | None, shift: tuple[float, float] | None, keep_holes: bool,
    flags: Path | None, threads: int, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Bring the map DISPARITY to the size of the picture GUIDE, with depth edges where the picture has them.

    Values become pixels of the still. What the map does not cover stays unmatched.
    """
    from prismstereo.fusion.upsampling import upsample
    from prismstereo_hw import pfm
    from prismstereo_hw.files import read_picture, write_picture

    pfm.require_format(out)
    if flags is not None and flags.suffix.lower() != ".png":
        raise UsageError(f"--flags {flags}: this picture is a PNG, give a name that ends in .png")
    low, picture = pfm.read_disparity(disparity), read_picture(guide)
    grid = _grid(low.shape, picture.shape, scale, shift)
    begin = time.perf_counter()
    done = upsample(low, picture, method, grid=grid, fill=not keep_holes, threads=threads)
    milliseconds = 1e3 * (time.perf_counter() - begin)
    pfm.write_disparity(out, done.disparity_px)
    if flags is not None:
        write_picture(flags, done.flags)
    result = {"out": out, "method": method, "flags": flags, "milliseconds": milliseconds, **_figures(done, grid)}
    share, (height, width) = 100 * float(str(result["density"])), done.flags.shape
    say(result, [f"{out}: {width}x{height}, {share:.1f} % with disparity, in {milliseconds:.0f} ms"], as_json=as_json)


def _grid(low: tuple[int, ...], high: tuple[int, ...], scale: float | None, shift: tuple[float, float] | None) -> Grid:
    from dataclasses import replace

    from prismstereo.fusion.upsampling import Grid

    if scale is None:
        grid = Grid.between(low, high)
        if abs(grid.scale_x / grid.scale_y - 1) > _UNEVEN:
            raise UsageError(
                f"the map is {low[1]}x{low[0]} and the guide {high[1]}x{high[0]}, {grid.scale_x:.4g} times as wide but "
                f"{grid.scale_y:.4g} times as high: they do not show the same, give --scale"
            )
    else:
        grid = Grid.centred(low, high, scale)
    if shift is None:
        return grid
    return replace(grid, shift_x_px=grid.shift_x_px + shift[0], shift_y_px=grid.shift_y_px + shift[1])


def _figures(done: Upsampled, grid: Grid) -> dict[str, object]:
    import numpy as np

    from prismstereo.fusion.flags import Flag

    valid = int(np.isfinite(done.disparity_px).sum())
    counted = {name: int(np.count_nonzero(done.flags & flag)) for name, flag in (
        ("band_pixels", Flag.BAND), ("filled_pixels", Flag.FILLED), ("no_low_resolution_pixels", Flag.NO_LOW_RESOLUTION),
    )}  # fmt: skip
    height, width = done.flags.shape
    return {
        "scale_x": grid.scale_x,
        "scale_y": grid.scale_y,
        "shift_x_px": grid.shift_x_px,
        "shift_y_px": grid.shift_y_px,
        "width": width,
        "height": height,
        "density": valid / (width * height),
        "valid_pixels": valid,
        **counted,
    }
