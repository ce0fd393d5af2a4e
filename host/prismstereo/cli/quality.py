"""`prismstereo quality`: how good depth is, in the figures that depth cameras are compared by."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.measuring.account import Account, FlatTarget, TrueScene
    from prismstereo.measuring.comparison import Change
    from prismstereo.measuring.frames import RecordedFrames, TakenFrames
    from prismstereo.measuring.gap import Gap
    from prismstereo.measuring.patch import Patch
    from prismstereo_calibration.boards.board import Board

_PATCH_SIDES = 4
_FLAT_SCENES = ("plane:", "board:")


@click.command(
    "quality",
    epilog="Examples:  prismstereo quality near far --distance-mm 500 --distance-mm 2000 --report quality.html\n\n"
    "           prismstereo quality desk --json > desk.json",
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...", type=click.Path(path_type=Path))
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Calibration file; a session and a recording have their own."
)
@click.option(
    "--distance-mm", "distances", multiple=True, type=click.FloatRange(min=0, min_open=True),
    help="True distance of the target, from the left pinhole and square to it; once for each SOURCE, or not at all.",
)  # fmt: skip
@click.option(
    "--as", "kind", type=click.Choice(["flat", "scene"]),
    help="What SOURCE shows. Default: a scene where it holds the truth of one, else a flat target.",
)  # fmt: skip
@click.option("--roi", metavar="X,Y,W,H", help="Where the flat target is. Default: the middle 40 % each way.")
@click.option("--frames", "most", default=10, show_default=True, type=click.IntRange(1), help="Frames of each SOURCE.")
@click.option("--board", help="The board that SOURCE shows: its corners tell the triangulation gap.")
@click.option("--square-mm", type=float, help="Side of a square of that board.")
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP)
@click.option("--report", type=click.Path(path_type=Path), help="HTML file for the figures, with plots.")
@click.option("--compare", "earlier", type=click.Path(path_type=Path), help="What --json printed before a change.")
@matching_options
@json_option
def command(
    sources: tuple[Path, ...], calibration: Path | None, distances: tuple[float, ...], kind: str | None, roi: str | None,
    most: int, board: str | None, square_mm: float | None, range_mm: str | None, report: Path | None, earlier: Path | None,
    matching: Matching, as_json: bool,
) -> None:  # fmt: skip
    """Judge depth: fill rate, Z accuracy, spatial and temporal noise, sub-pixel error, triangulation gap, disparity levels.

    Each SOURCE is a session folder, pictures, or an MCAP recording of one flat target, square to the camera, or a session of
    the optical twin with its truth, which is judged by distance. The definitions stand in the report.
    """
    from prismstereo.measuring.account import Account, read
    from prismstereo.measuring.comparison import compare
    from prismstereo.measuring.definitions import DEFINITIONS

    if distances and len(distances) != len(sources):
        raise UsageError(
            f"{len(distances)} distances for {len(sources)} sources: give --distance-mm once for each, or not at all"
        )
    before = None if earlier is None else read(earlier)
    shown, patch = _board(board, square_mm), _patch(roi)
    flat: list[FlatTarget] = []
    scenes: list[TrueScene] = []
    for index, source in enumerate(sources):
        opened = _open(source, calibration, matching, range_mm)
        distance = distances[index] if distances else None
        if (kind or _kind(opened, distance)) == "flat":
            flat.append(_flat(source, opened, most, distance, patch, shown))
        else:
            scenes.append(_scene(source, opened, most, shown))
    account = Account(tuple(sorted(flat, key=lambda one: one.figures.distance_mm)), tuple(scenes))
    changes = () if before is None else compare(before, account)
    _write(report, account, changes)
    told = {
        **account.told(),
        "compared": [_change(one) for one in changes],
        "definitions": DEFINITIONS,
        "report": report,
    }
    say(told, _lines(account, changes, report), as_json=as_json)


def _open(
    source: Path, calibration: Path | None, matching: Matching, range_mm: str | None
) -> TakenFrames | RecordedFrames:
    from prismstereo.measuring.frames import open_frames

    matcher = matching.create() if matching.matcher or source.suffix.lower() != ".mcap" else None
    return open_frames(source, calibration, matcher, matching.chain(), parse_range(range_mm, 1024))


def _kind(opened: TakenFrames | RecordedFrames, distance: float | None) -> str:
    from prismstereo.measuring.frames import TakenFrames

    if distance is not None or not opened.true or not isinstance(opened, TakenFrames) or opened.session is None:
        return "flat"
    return "flat" if opened.session.info.scene.startswith(_FLAT_SCENES) else "scene"


def _flat(
    source: Path, opened: TakenFrames | RecordedFrames, most: int, distance: float | None, roi: Patch | None,
    board: Board | None,
) -> FlatTarget:  # fmt: skip
    from prismstereo.measuring.assessment import assess_flat

    return assess_flat(source.name, with_progress(opened.frames(0, most), None, source.name), distance, roi, board)


def _scene(source: Path, opened: TakenFrames | RecordedFrames, most: int, board: Board | None) -> TrueScene:
    from prismstereo.measuring.assessment import assess_scene

    return assess_scene(source.name, with_progress(opened.frames(0, most), None, source.name), board)


def _board(name: str | None, square_mm: float | None) -> Board | None:
    from prismstereo_calibration.boards.board import Board

    if name is None:
        if square_mm is not None:
            raise UsageError("--square-mm is the side of a board's square: say which board with --board")
        return None
    return Board.parse(name, square_mm)


def _patch(text: str | None) -> Patch | None:
    from prismstereo.measuring.patch import Patch

    if text is None:
        return None
    sides = [side.strip() for side in text.split(",")]
    if len(sides) != _PATCH_SIDES or not all(side.isascii() and side.isdigit() for side in sides):
        raise UsageError(f"--roi {text}: give X,Y,WIDTH,HEIGHT in whole pixels, e.g. 100,50,320,240")
    return Patch(*map(int, sides))


def _write(report: Path | None, account: Account, changes: tuple[Change, ...]) -> None:
    from prismstereo.measuring.page import html
    from prismstereo_hw.files import write_whole

    if report is not None:
        write_whole(report, html(account, changes).encode())


def _change(one: Change) -> dict[str, object]:
    return {"figure": one.figure, "where": one.where, "before": one.before, "after": one.after, "verdict": one.verdict}


def _lines(account: Account, changes: tuple[Change, ...], report: Path | None) -> list[str]:
    lines = []
    for target in account.flat:
        one = target.figures
        accuracy = "" if one.z_accuracy_percent is None else f", Z accuracy {one.z_accuracy_percent:+.3f} %"
        noise = "" if one.temporal_rms_mm is None else f", temporal noise {one.temporal_rms_mm:.4g} mm rms"
        lines.append(
            f"{target.source}: {one.distance_mm:.1f} mm, fill {one.fill_percent:.1f} %{accuracy}, plane-fit RMS "
            f"{one.plane_rms_mm:.4g} mm ({one.plane_rms_percent:.3f} %), sub-pixel RMS {one.subpixel_rms_px:.4f} px{noise}"
            f"{_gap(target.triangulation_gap_mm)}, {one.frames} frames"
        )
    for scene in account.scenes:
        lines.append(
            f"{scene.source}: fill {scene.fill_percent:.1f} %, {scene.levels.in_use} disparity levels in use"
            f"{_gap(scene.triangulation_gap_mm)}, {scene.frames} frames"
        )
        lines += [
            f"  {one.from_mm:.0f} to {one.to_mm:.0f} mm: fill {one.fill_percent:.1f} %, {one.bad_percent:.2f} % over 1 px off, "
            f"depth rms {one.errors.depth_rms_mm:.4g} mm, predicted {one.errors.predicted_rms_mm:.4g} mm"
            for one in scene.by_distance
            if one.errors is not None
        ]
    lines += [f"{one.where}: {one.figure} {one.before:.4g} -> {one.after:.4g}, {one.verdict}" for one in changes]
    return lines if report is None else [*lines, f"wrote {report}"]


def _gap(gap: Gap | None) -> str:
    return "" if gap is None else f", gap {gap.mean:.4f} mm"
