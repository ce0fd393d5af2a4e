"""`prismstereo target`: a calibration board to print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_calibration.target.sheet import Sheet


@click.command(
    "target",
    epilog="Example:  prismstereo target --page a3 -o board.pdf   (an 11x8 ChArUco board that fills the sheet)",
)
@click.option(
    "--board",
    default="charuco:11x8",
    show_default=True,
    help="charuco:COLUMNSxROWS in squares, chessboard:COLUMNSxROWS in inner corners, aprilgrid:COLUMNSxROWS in tags; "
    "behind more colons a dictionary (5x5_100), a share (0.7), `inverted`.",
)
@click.option(
    "--square-mm", type=float, help="Side of a square, of a tag. Default: the largest that fits, in steps of 0.5 mm."
)
@click.option("--page", default="a4", show_default=True, help="a4 to a0, letter, tabloid, or WIDTHxHEIGHT in mm.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="File to write: .pdf, .svg or .dxf.")
@json_option
def command(board: str, square_mm: float | None, page: str, out: Path, as_json: bool) -> None:
    """Write a calibration board of exact size, with a code beside it that tells `calibrate` which board it is.

    Print it at 100 %, measure its 100 mm bar, and pass what you measured: calibrate --bar-mm 99.6.
    """
    from prismstereo_calibration.boards.board import Board
    from prismstereo_calibration.target.page import Page
    from prismstereo_calibration.target.sheet import lay_out
    from prismstereo_hw.files import write_whole

    kind = out.suffix.lower()
    if kind not in (".pdf", ".svg", ".dxf"):
        raise UsageError(f"{out}: a board is written as .pdf (to print), .svg or .dxf (for plate makers)")
    sheet = lay_out(Board.parse(board, square_mm), Page.parse(page))
    write_whole(out, _content(sheet, kind))
    say(_result(sheet, out), _lines(sheet, out), as_json=as_json)


def _content(sheet: Sheet, kind: str) -> bytes:
    if kind == ".pdf":
        from prismstereo_calibration.target.pdf import pdf

        return pdf(sheet)
    if kind == ".svg":
        from prismstereo_calibration.target.svg import svg

        return svg(sheet)
    from prismstereo_calibration.target.dxf import dxf

    return dxf(sheet)


def _result(sheet: Sheet, out: Path) -> dict[str, object]:
    x0, y0, x1, y1 = sheet.pattern.bounds
    return {
        "out": out,
        "board": sheet.board.name,
        "square_mm": sheet.board.square_mm,
        "dictionary": sheet.board.dictionary,
        "share": sheet.board.share,
        "page": str(sheet.page),
        "page_width_mm": sheet.page.width_mm,
        "page_height_mm": sheet.page.height_mm,
        "board_width_mm": x1 - x0,
        "board_height_mm": y1 - y0,
        "bar_mm": sheet.bar_mm,
        "code_markers": list(sheet.code_markers),
    }


def _lines(sheet: Sheet, out: Path) -> list[str]:
    x0, y0, x1, y1 = sheet.pattern.bounds
    page, board = sheet.page, sheet.board
    code = (
        f"no code beside the board: {sheet.no_code}"
        if sheet.no_code
        else "the code beside the board tells it to calibrate"
    )
    return [
        f"{out}: {board.name}, squares of {board.square:g} mm, {x1 - x0:.1f} x {y1 - y0:.1f} mm on {page} "
        f"({page.width_mm:g} x {page.height_mm:g} mm)",
        f"  print at 100 %, measure the {sheet.bar_mm:g} mm bar; {code}",
    ]
