"""`prismstereo calibrate`: views of a board to a calibration, judged; or any scene to a rectification."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from prismstereo.cli.output import RANGE_HELP, Ticker, json_option, parse_range, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.cli.calibrate_input import Given
    from prismstereo_calibration.boards.board import Board
    from prismstereo_calibration.boards.detection import Detection
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.outputs import Output
    from prismstereo_calibration.seam import Seam
    from prismstereo_calibration.solving.solve import Solution

_SWITCH = {"auto": None, "on": True, "off": False}
_switch = click.Choice(list(_SWITCH))


@click.command(
    "calibrate",
    epilog="Example:  prismstereo calibrate frames/*.png --rig oak-1 --board chessboard:9x7 --square-mm 9.5 -o unit.json",
)
@click.argument("frames", nargs=-1, type=click.Path(path_type=Path))
@click.option("--left", metavar="PATTERN", help="Left pictures of two cameras, instead of FRAMES (quoted pattern).")
@click.option("--right", metavar="PATTERN", help="Right pictures of two cameras, paired by number.")
@click.option("--rig", help="The unit's rig: dslr-35mm, oak-1, pi-camera-v2, or a rig file.")
@click.option("--layout", help="Where the views lie, without a rig: side-by-side, swapped, top-bottom, FILE.toml.")
@click.option("--board", help="chessboard:9x6 (inner corners), charuco:11x8 (squares), aprilgrid:6x6 (tags). Default: what "
              "the session says, or the code printed beside the board.")  # fmt: skip
@click.option(
    "--square-mm",
    type=float,
    help="Side of a square (of a tag); without it and without a code, lengths are in squares.",
)
@click.option(
    "--bar-mm", type=float, help="What the 100 mm bar of the printed sheet measures: corrects the printer's scale."
)
@click.option("--model", type=click.Choice(["one-lens", "two-camera"]), help="Default: one-lens with a rig.")
@click.option(
    "--glass",
    type=_switch,
    default="auto",
    help="The rig's prism as a plate before the lens. Default: where there is one.",
)
@click.option(
    "--distortion",
    type=click.Choice(["radial", "full"]),
    help="full: p1, p2, k3 too. Default: radial for one lens, full for two cameras.",
)
@click.option(
    "--board-warp",
    type=_switch,
    default="auto",
    help="Let the board bend. Default: where the frames show it beyond doubt.",
)
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP.replace("the calibration", "the rig"))
@click.option(
    "--stills",
    metavar="PATTERN",
    help="The same board poses as stills, same numbers: measures the way from video to still.",
)
@click.option(
    "--flat", metavar="PATTERN", help="Frames of a white wall: evens out the light of both views, masks dark parts."
)
@click.option(
    "--lens-position", type=int, help="Where the focus is locked, as the camera counts; kept with the calibration."
)
@click.option("--temperature-c", type=float, help="Temperature of the unit; kept with the calibration.")
@click.option("--from-scene", is_flag=True, help="No board: any textured scene to a rectification without a scale.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Calibration file to write.")
@click.option("--report", type=click.Path(path_type=Path), help="Report to write: one HTML page.")
@json_option
def command(
    frames: tuple[Path, ...], left: str | None, right: str | None, rig: str | None, layout: str | None,
    board: str | None, square_mm: float | None, bar_mm: float | None, model: Literal["one-lens", "two-camera"] | None,
    glass: str, distortion: str | None, board_warp: str, range_mm: str | None, stills: str | None, flat: str | None,
    lens_position: int | None, temperature_c: float | None, from_scene: bool, out: Path, report: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Solve the calibration of a unit from FRAMES of a board, or a session folder with board views.

    Exit code 1 when the figures say that it must be done again; the files are written all the same.
    """
    from prismstereo.cli.calibrate_input import board_of, given, require_state, seam_of
    from prismstereo.cli.calibrate_lines import account, lines
    from prismstereo_calibration.boards.detect import detect
    from prismstereo_calibration.judging import report as reports
    from prismstereo_calibration.judging.quality import judge
    from prismstereo_calibration.solving.solve import Options, solve
    from prismstereo_calibration.store import write
    from prismstereo_hw.files import write_whole

    require_state(lens_position, temperature_c)
    found = given(frames, left, right, rig, layout, scene=from_scene)
    if from_scene:
        _require_no_board(
            board=board, square_mm=square_mm, bar_mm=bar_mm, range_mm=range_mm, report=report, stills=stills
        )
        return _scene(found, out, None if model is None else model == "one-lens", as_json=as_json)
    target = board_of(found, board, square_mm, bar_mm)
    seam = seam_of(found)
    detection = detect(found.frames, found.views, target, progress=Ticker("looking for the board"), seam=seam)
    solution = solve(
        detection,
        target,
        rig=found.rig,
        model=model,
        wish=parse_range(range_mm, found.rig.range.labels if found.rig else 128),
        options=Options(
            glass=_SWITCH[glass], full=None if distortion is None else distortion == "full", warped=_SWITCH[board_warp]
        ),
        lens_position=lens_position,
        temperature_c=temperature_c,
    )
    quality = judge(solution.calibration, detection.only(solution.used), target, solution=solution)
    outputs = _outputs(found, stills, target, detection)
    solution = _completed(solution, seam, flat, outputs)
    if report is not None:  # before the calibration: a report that cannot be written leaves all as it was
        write_whole(report, reports.html(solution, quality).encode())
    write(out, solution.calibration)
    others = _write_others(out, solution.others)
    say(
        account(solution, quality, target, seam, out, others),
        lines(solution, quality, target, seam, out, others),
        as_json=as_json,
    )
    return 1 if quality.verdict == "redo" else 0


def _require_no_board(**given: object) -> None:
    """Refuse what only a board can fulfil."""
    for name, value in given.items():
        if value is not None:
            option = "--" + name.replace("_", "-")
            raise UsageError(
                f"--from-scene finds no scale and knows no board: leave {option} out, or calibrate with a board"
            )


def _scene(found: Given, out: Path, one_lens: bool | None, *, as_json: bool) -> int:
    from prismstereo.cli.from_scene import from_scene

    if len(found.views) != 2:
        raise UsageError(
            f"a scene is matched between two views, the layout has {len(found.views)}: give [left] and [right]"
        )
    views = found.views[0], found.views[1]
    tell = Ticker("matching")
    return from_scene(found.frames, views, found.rig, out, one_lens=one_lens, progress=tell, as_json=as_json)


def _outputs(found: Given, stills: str | None, board: Board, video: Detection) -> tuple[Output, ...]:
    """Return the still output, measured from the board views that were also taken as stills."""
    from prismstereo.frames import BoardFrames, expand
    from prismstereo_calibration.boards.detect import detect
    from prismstereo_calibration.solving.still_to_video import still_to_video

    frames = found.stills if stills is None else BoardFrames(expand([stills]))
    if frames is None:
        return ()
    seen = detect(frames, found.views, board, progress=Ticker("looking for the board in stills"))
    return (still_to_video(video, seen).output,)


def _completed(solution: Solution, seam: Seam | None, flat: str | None, outputs: tuple[Output, ...]) -> Solution:
    """Add what else was measured to the calibration: other outputs, light, and which pixels never match."""
    from dataclasses import replace

    from prismstereo.frames import BoardFrames, expand
    from prismstereo_calibration.light.flat_field import measure
    from prismstereo_calibration.light.measured_mask import measured_mask

    calibration = solution.calibration
    field = None
    if flat is not None:
        field = measure(BoardFrames(expand([flat])), calibration.views, seam)
    masked = calibration.unit == "mm" and calibration.left_view.exposures == 1
    mask = measured_mask(calibration, seam, field) if masked else None
    light = None if field is None else field.photometry
    return replace(solution, calibration=replace(calibration, outputs=outputs, photometry=light, mask=mask))


def _write_others(out: Path, others: tuple[Calibration, ...]) -> list[Path]:
    """Write the calibrations of the left view with further views beside the first: unit-3.json and so on."""
    from prismstereo_calibration.store import write

    paths = [out.with_name(f"{out.stem}-{number}{out.suffix}") for number in range(3, 3 + len(others))]
    for path, calibration in zip(paths, others, strict=True):
        write(path, calibration)
    return paths
