"""`prismstereo check`: whether a calibration still holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import Ticker, json_option, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.frames import BoardFrames
    from prismstereo_calibration.boards.board import Board
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.upkeep.check import Check, State
    from prismstereo_calibration.upkeep.focus import BoardFindings
    from prismstereo_calibration.upkeep.mount import Mount

_WORDS = {
    "fine": "fine",
    "refine": "refine: `prismstereo refine` with ten ordinary scenes and one known distance mends it",
    "recalibrate": "recalibrate: take views of a board, and `prismstereo calibrate`",
}


@click.command(
    "check",
    epilog="Examples:  prismstereo check scenes/*.png --calibration unit.json\n\n"
    "           prismstereo check boards/*.png --calibration unit.json --board charuco:11x8 --square-mm 12",
)
@click.argument("frames", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--calibration", required=True, type=click.Path(path_type=Path), help="Calibration file of the unit.")
@click.option("--rig", help="The unit's rig, where the calibration does not name a built-in one: a rig file.")
@click.option("--board", help="The board that some of FRAMES show: then lengths and the focus are checked too.")
@click.option("--square-mm", type=float, help="Side of a square of that board.")
@click.option("--lens-position", type=int, help="Where the lens stood when FRAMES were taken.")
@click.option("--temperature-c", type=float, help="How warm the unit was when FRAMES were taken.")
@json_option
def command(
    frames: tuple[Path, ...], calibration: Path, rig: str | None, board: str | None, square_mm: float | None,
    lens_position: int | None, temperature_c: float | None, as_json: bool,
) -> int:  # fmt: skip
    """Say whether the calibration of a unit still holds, from a few FRAMES of any textured scene.

    The answer is fine, refine or recalibrate, with the figures and their limits. Without a board the scale of lengths and the
    focus cannot be seen. Exit code 1 unless all is fine.
    """
    from prismstereo.cli.calibrate_input import require_state
    from prismstereo.frames import BoardFrames, expand, named_frames
    from prismstereo_calibration.store import read
    from prismstereo_calibration.upkeep.check import check
    from prismstereo_calibration.upkeep.matcher import SceneMatcher
    from prismstereo_calibration.upkeep.mount import mount_for

    if board is None and square_mm is not None:
        raise UsageError("--square-mm is the side of a board's square: say which board with --board")
    require_state(lens_position, temperature_c)
    unit = read(calibration)
    shown = None if board is None else _board_of(board, square_mm, unit)
    state = _state(unit, calibration, lens_position, temperature_c)
    mount, matcher, files = mount_for(unit, rig), SceneMatcher(unit), expand(frames)
    scenes = [matcher.match(name, frame) for name, frame in with_progress(named_frames(frames), len(files), "matching")]
    seen = None if shown is None else _findings(unit, BoardFrames(files), shown, mount)
    found = check(unit, scenes, mount, board=seen, state=state)
    say(_object(found, unit), _lines(found, unit), as_json=as_json)
    return 0 if found.advice == "fine" else 1


def _state(unit: Calibration, path: Path, lens_position: int | None, temperature_c: float | None) -> State:
    from prismstereo_calibration.upkeep.check import State

    for option, given, known in (
        ("--lens-position", lens_position, unit.lens_position),
        ("--temperature-c", temperature_c, unit.temperature_c),
    ):
        if given is not None and known is None:
            click.echo(f"note: {path} does not say its own, so {option} is held against nothing", err=True)
    return State(lens_position, temperature_c)


def _board_of(name: str, square_mm: float | None, unit: Calibration) -> Board:
    from prismstereo_calibration.boards.board import Board

    board = Board.parse(name, square_mm)
    if board.unit != unit.unit:
        raise UsageError(
            f"the board is given in {board.unit}, but the calibration is in {unit.unit}: give --square-mm to both or to none"
        )
    return board


def _findings(unit: Calibration, frames: BoardFrames, board: Board, mount: Mount) -> BoardFindings:
    from prismstereo_calibration.boards.detect import detect
    from prismstereo_calibration.upkeep.focus import board_findings

    return board_findings(
        unit, detect(frames, unit.views, board, progress=Ticker("looking for the board")).sightings, board, mount
    )


def _object(found: Check, unit: Calibration) -> dict[str, object]:
    board = found.board
    lengths: dict[str, object] = {}
    if board is not None:
        lengths = {
            "boards": board.boards,
            "scale_error_percent": 100 * board.scale_error,
            "scale_sigma_percent": 100 * board.scale_sigma,
            "focal_change_percent": 100 * board.focal_change,
            "focal_sigma_percent": 100 * board.focal_sigma,
        }
    return {
        "advice": found.advice,
        "cause": found.cause,
        "scenes": found.scenes,
        "matches": found.matches,
        f"at_depth_{'mm' if unit.unit == 'mm' else 'squares'}": found.at_depth,
        "depth_unseen_percent": 200 * found.depth_sigma if board is None else None,
        "findings": [
            {
                "name": finding.name,
                "value": finding.value,
                "fine_up_to": finding.fine,
                "refine_up_to": finding.refine,
                "unit": finding.unit,
                "advice": finding.advice,
            }
            for finding in found.findings
        ],
        **lengths,
    }


def _lines(found: Check, unit: Calibration) -> list[str]:
    lines = [f"{found.matches} points in {found.scenes} scenes"]
    for finding in found.findings:
        mark = "ok" if finding.advice == "fine" else finding.advice.upper()
        lines.append(
            f"  {mark:12}{finding.name:42}{finding.value:9.3f} {finding.unit:6} fine up to {finding.fine:g}, refine up to "
            f"{finding.refine:g}"
        )
    lines += [f"likely cause: {found.cause}"] if found.cause else []
    if found.board is None:
        lines.append(
            f"without a board, a depth error of up to {200 * found.depth_sigma:.1f} % at {found.at_depth:.4g} {unit.unit} "
            "stays unseen"
        )
    return [*lines, _WORDS[found.advice]]
