"""`prismstereo calibrate`: views of a board to a calibration, judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.frames import BoardFrames
    from prismstereo_calibration.quality import Quality
    from prismstereo_calibration.solve import Solution
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.view import View


@click.command(
    "calibrate",
    epilog="Example:  prismstereo calibrate frames/*.png --rig oak-1 --board chessboard:9x7 --square-mm 9.5 -o unit.json",
)
@click.argument("frames", nargs=-1, type=click.Path(path_type=Path))
@click.option("--left", metavar="PATTERN", help="Left pictures of two cameras, instead of FRAMES (quoted pattern).")
@click.option("--right", metavar="PATTERN", help="Right pictures of two cameras, paired by number.")
@click.option("--rig", help="The unit's rig: dslr-35mm, oak-1, pi-camera-v2, or a rig file.")
@click.option("--layout", help="Where the views lie, without a rig: side-by-side, swapped, top-bottom, bottom-top.")
@click.option("--board", help="chessboard:COLUMNSxROWS in inner corners; a session knows its own.")
@click.option("--square-mm", type=float, help="Side of a square; without it, lengths are in squares.")
@click.option("--model", type=click.Choice(["one-lens", "two-camera"]), help="Default: one-lens with a rig.")
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP.replace("the calibration", "the rig"))
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Calibration file to write.")
@click.option("--report", type=click.Path(path_type=Path), help="Report to write: one HTML page.")
@json_option
def command(
    frames: tuple[Path, ...], left: str | None, right: str | None, rig: str | None, layout: str | None,
    board: str | None, square_mm: float | None, model: Literal["one-lens", "two-camera"] | None,
    range_mm: str | None, out: Path, report: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Solve the calibration of a unit from FRAMES of a board, or a session folder with board views.

    Exit code 1 when the figures say that it must be done again; the files are written all the same.
    """
    from prismstereo_calibration import report as reports
    from prismstereo_calibration.board import Board
    from prismstereo_calibration.detect import detect
    from prismstereo_calibration.quality import judge
    from prismstereo_calibration.rectification import rectification
    from prismstereo_calibration.solve import solve
    from prismstereo_calibration.store import write
    from prismstereo_calibration.summary import summary
    from prismstereo_hw.files import write_whole

    pictures, found_board, found_square, found_rig = _frames(frames, left, right)
    if board or found_board:
        target = Board.parse(board or found_board or "", square_mm or found_square)
    else:
        raise UsageError("say which board is in the pictures: --board chessboard:9x6 (inner corners, columns x rows)")
    built, views = _views(rig or found_rig, layout, two_cameras=left is not None)
    detection = detect(pictures, views, target, progress=_Progress())
    wish = parse_range(range_mm, built.range.labels if built else 128)
    solution = solve(detection, target, rig=built, model=model, wish=wish)
    quality = judge(solution.calibration, detection.only(solution.used), target, rms_px=solution.rms_px)
    window = rectification(solution.calibration).window
    write(out, solution.calibration)
    if report is not None:
        write_whole(report, reports.html(solution, quality).encode())
    suffix = "mm" if solution.calibration.unit == "mm" else "squares"
    reach = {f"range_min_{suffix}": window.nearest, f"range_max_{suffix}": window.farthest, "labels": window.labels}
    say({**summary(solution, quality), **reach, "out": out}, _lines(solution, quality, out), as_json=as_json)
    return 1 if quality.verdict == "redo" else 0


class _Progress:
    """Shows detection on stderr: a line every two seconds, and the last."""

    def __init__(self) -> None:
        self._spoken_s = 0.0

    def __call__(self, done: int, total: int, name: str) -> None:
        import time

        if done == total or time.monotonic() - self._spoken_s > 2:
            self._spoken_s = time.monotonic()
            click.echo(f"looking for the board: {done} of {total} ({name})", err=True)


def _frames(
    frames: tuple[Path, ...], left: str | None, right: str | None
) -> tuple[BoardFrames, str | None, float | None, str | None]:
    """Return the pictures and what a session says of itself: board, square in mm, rig."""
    from prismstereo.frames import BoardFrames, expand, pairs
    from prismstereo_hw.session import Session

    if left or right:
        if frames or not (left and right):
            raise UsageError("give FRAMES, or both --left and --right, not a mixture")
        return BoardFrames(pairs(left, right)), None, None, None
    if not frames:
        raise UsageError(
            "give pictures of the board: prismstereo calibrate frames/*.png --rig oak-1 --board ... -o unit.json"
        )
    if len(frames) == 1 and (frames[0] / "session.toml").is_file():
        session = Session.open(frames[0])
        paths, info = session.paths("boards"), session.info
        if not paths:
            raise UsageError(f"{frames[0]} holds no board views: simulate some with --boards, or give FRAMES")
        own_rig = frames[0] / "rig.toml"
        rig = str(own_rig) if own_rig.is_file() else info.rig
        return BoardFrames(paths), info.board or None, info.square_mm or None, rig
    return BoardFrames(expand(frames)), None, None, None


def _views(rig: str | None, layout: str | None, *, two_cameras: bool) -> tuple[Rig | None, tuple[View, View]]:
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.view import layout as layout_by_name

    if rig is not None and layout is not None:
        raise UsageError("give --rig or --layout, not both: a rig knows its layout")
    if two_cameras and (rig or layout):
        raise UsageError("--left and --right are two cameras: they have no --rig and no --layout")
    if rig is not None:
        built = Rig.read(rig)
        return built, built.views
    if layout is None and not two_cameras:
        raise UsageError("say where the views lie: --rig oak-1 for a prism unit, or --layout side-by-side")
    return None, layout_by_name(layout or "side-by-side")


def _lines(solution: Solution, quality: Quality, out: Path) -> list[str]:
    calibration = solution.calibration
    unit, lens, gap = calibration.unit, calibration.left.lens, quality.triangulation_gap
    return [
        f"{out}: {calibration.model}, {len(solution.used)} views used, {len(solution.rejected)} rejected",
        *(f"  rejected {entry.name}: {entry.reason}" for entry in solution.rejected),
        f"  reprojection RMS    {solution.rms_px:.3f} px",
        f"  baseline            {calibration.baseline:.3f} +- {solution.baseline_sigma:.3f} {unit}",
        f"  focal length        {lens.fx_px:.1f} +- {solution.focal_sigma_px:.1f} px, principal point "
        f"{lens.cx_px:.1f}, {lens.cy_px:.1f}",
        f"  triangulation gap   {gap.mean:.4f} {unit} (variance {gap.variance:.2g})",
        f"  plane fit           {quality.plane_fit.mean:.4f} {unit} (variance {quality.plane_fit.variance:.2g}), "
        f"RMS {quality.plane_fit.rms:.4f}",
        f"  row error           {quality.row_error.mean_px:.3f} px, 95 % below {quality.row_error.p95_px:.3f}",
        f"  verdict             {quality.verdict}",
    ]
