"""Sheets: re-measured from the rendered page, parsed back from SVG and DXF, and the sizes that do not fit."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pypdfium2
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.corners import find_corners
from prismstereo_calibration.target.dxf import dxf
from prismstereo_calibration.target.page import Page
from prismstereo_calibration.target.pdf import pdf
from prismstereo_calibration.target.reading import read
from prismstereo_calibration.target.scale import printed
from prismstereo_calibration.target.sheet import Sheet, lay_out
from prismstereo_calibration.target.svg import svg
from prismstereo_hw.errors import UsageError

DPI = 254
WORST_MM = 0.02
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
Array = NDArray[np.float64]


def rendered(sheet: Sheet) -> tuple[NDArray[np.uint8], Array]:
    """The page as another program draws it, and its pixels per millimetre along x and y."""
    document = pypdfium2.PdfDocument(pdf(sheet))
    pixels = document[0].render(scale=DPI / 72, grayscale=True).to_numpy()
    grey = np.ascontiguousarray(np.squeeze(pixels), np.uint8)
    points = np.array(document[0].get_size())
    document.close()
    return grey, np.array(grey.shape[::-1]) / (points * 25.4 / 72)


def charuco_corners(grey: NDArray[np.uint8], board: Board) -> Array:
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    size, share = (board.columns, board.rows), float(board.share or 0)
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(
        cv2.aruco.CharucoBoard(size, board.square, share * board.square, book)
    ).detectBoard(grey)
    assert len(corners) == board.corner_count
    return np.reshape(corners, (-1, 2))[np.argsort(np.ravel(numbers))]


def chessboard_corners(grey: NDArray[np.uint8], board: Board) -> Array:
    small = cv2.resize(grey, (grey.shape[1] // 4, grey.shape[0] // 4), interpolation=cv2.INTER_AREA).astype(np.uint8)
    corners = find_corners(small, board)
    assert isinstance(corners, np.ndarray)
    return 4 * (corners + 0.5) - 0.5


def april_corners(grey: NDArray[np.uint8], board: Board) -> Array:
    """The corners of the tags in board order: OpenCV's contours are a module rough, so by rank in rows and columns."""
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = 2
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    found, _, _ = cv2.aruco.ArucoDetector(book, settings).detectMarkers(grey)
    points = np.reshape(np.stack(found), (-1, 2))
    assert len(points) == board.corner_count
    columns, _ = board.corner_grid
    by_row = points[np.argsort(points[:, 1])].reshape(-1, columns, 2)
    return np.concatenate([row[np.argsort(row[:, 0])] for row in by_row])


FINDERS = {"charuco": charuco_corners, "chessboard": chessboard_corners, "aprilgrid": april_corners}


@pytest.mark.parametrize("name", ["charuco:11x8", "chessboard:9x6", "aprilgrid:6x5"])
def test_the_rendered_page_has_every_corner_within_two_hundredths_of_a_millimetre(name: str) -> None:
    sheet = lay_out(Board.parse(name), Page.parse("a4"))
    grey, pixels_per_mm = rendered(sheet)

    found = FINDERS[sheet.board.kind](grey, sheet.board)

    start = found.astype(np.float32).reshape(-1, 1, 2)
    exact = np.reshape(cv2.cornerSubPix(grey, start, (9, 9), (-1, -1), STOP), (-1, 2))
    found_mm = (exact + 0.5) / pixels_per_mm - sheet.board_at_mm
    assert np.abs(found_mm - sheet.board.points()[:, :2]).max() < WORST_MM
    assert read(grey) == sheet.board


def test_the_bar_measures_100_mm_from_the_middle_of_its_first_line_to_the_middle_of_its_last() -> None:
    sheet = lay_out(Board.parse("charuco:11x8"), Page.parse("a4"))
    grey, pixels_per_mm = rendered(sheet)
    _, top, _, bottom = sheet.bar.bounds
    row = round((top + (bottom - top) * 0.2) * pixels_per_mm[1])  # above the short lines

    ink = 255.0 - grey[row]

    columns = np.flatnonzero(ink > 20)
    groups = np.split(columns, np.flatnonzero(np.diff(columns) > 5) + 1)
    middles = [float((ink[group] * group).sum() / ink[group].sum()) for group in groups]
    assert len(middles) == 2
    assert (middles[1] - middles[0]) / pixels_per_mm[0] == pytest.approx(100.0, abs=0.01)
    assert sheet.bar_mm == 100


def test_a_pdf_says_what_it_is_how_to_print_it_and_that_it_must_not_be_scaled() -> None:
    sheet = lay_out(Board.parse("charuco:11x8", 20.0), Page.parse("a4"))
    content = pdf(sheet)
    document = pypdfium2.PdfDocument(content)
    words = " ".join(document[0].get_textpage().get_text_range().split())
    size_mm = np.array(document[0].get_size()) * 25.4 / 72
    document.close()

    assert "charuco:11x8, squares of 20 mm, markers of 15 mm from 4x4_50." in words
    assert "Print at 100 %" in words
    assert "--board charuco:11x8 --square-mm 20, or leave both out" in words
    assert "--bar-mm 99.6" in words
    assert b"/PrintScaling /None" in content
    np.testing.assert_allclose(size_mm, [297, 210], atol=1e-3)


@pytest.mark.parametrize("write", [pdf, svg, dxf])
def test_the_same_sheet_has_the_same_bytes_and_no_date(write: object) -> None:
    assert callable(write)
    first, second = (write(lay_out(Board.parse("chessboard:7x5"), Page.parse("letter"))) for _ in range(2))

    assert first == second
    assert not re.search(rb"D:20[2-9]\d", first)


def test_an_svg_has_exact_sizes() -> None:
    sheet = lay_out(Board(7, 5, 12.5), Page.parse("250x180"))

    root = ET.fromstring(svg(sheet).decode())

    space = {"svg": "http://www.w3.org/2000/svg"}
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("250mm", "180mm", "0 0 250 180")
    paths = {path.get("id"): path.get("d") or "" for path in root.findall("svg:path", space)}
    numbers = np.array(re.findall(r"M(\S+) (\S+)H(\S+)V(\S+)H\S+?Z", paths["pattern"]), float)
    np.testing.assert_allclose(numbers, sheet.pattern.rectangles, atol=1e-6)
    np.testing.assert_allclose(numbers[:, 2:] - numbers[:, :2], 12.5, atol=2e-6)
    assert numbers[:, 2].max() - numbers[:, 0].min() == pytest.approx(8 * 12.5, abs=2e-6)
    assert paths.keys() == {"pattern", "code", "bar"}


def test_a_dxf_has_closed_outlines_of_exact_size_with_y_up() -> None:
    sheet = lay_out(Board(7, 5, 12.5), Page.parse("250x180"))
    lines = dxf(sheet).decode("ascii").splitlines()
    pairs = list(zip(map(int, lines[::2]), lines[1::2], strict=True))

    outlines: dict[str, list[Array]] = {}
    for begin in (i for i, pair in enumerate(pairs) if pair == (0, "POLYLINE")):
        end = pairs.index((0, "SEQEND"), begin)
        entity = pairs[begin:end]
        assert (70, "1") in entity  # closed
        xs, ys = ([float(value) for code, value in entity if code == which][1:] for which in (10, 20))
        outlines.setdefault(dict(entity[:2])[8], []).append(np.stack([xs, ys], axis=-1))

    pattern = np.array(outlines["PATTERN"])
    corners = np.concatenate([pattern.min(axis=1), pattern.max(axis=1)], axis=-1)
    flipped = np.stack([corners[:, 0], 180 - corners[:, 3], corners[:, 2], 180 - corners[:, 1]], axis=-1)
    np.testing.assert_allclose(flipped, sheet.pattern.rectangles, atol=1e-6)
    assert pattern.shape == (24, 4, 2)
    assert outlines.keys() == {"PATTERN", "CODE", "BAR"}
    assert pairs[-1] == (0, "EOF")


@pytest.mark.parametrize(
    ("name", "page", "lies"),
    [("charuco:11x8", "a4", True), ("charuco:5x12", "a3", False), ("chessboard:9x6", "tabloid", True)],
)
def test_a_board_lies_as_it_fills_the_page_and_half_a_millimetre_more_does_not_fit(
    name: str, page: str, lies: bool
) -> None:
    sheet = lay_out(Board.parse(name), Page.parse(page))
    square = sheet.board.square

    assert (sheet.page.width_mm > sheet.page.height_mm) == lies
    assert math.isclose(2 * square, round(2 * square))
    x0, y0, x1, y1 = sheet.ink.bounds
    assert min(x0, y0) >= 8 - 1e-9
    assert x1 <= sheet.page.width_mm - 8 + 1e-9
    assert y1 <= sheet.page.height_mm - 8
    assert max(sheet.pattern.bounds[3], (sheet.code or sheet.pattern).bounds[3]) < sheet.bar.bounds[1]
    with pytest.raises(UsageError, match=f"at most .* fit, give --square-mm {square:g} or a larger page"):
        lay_out(Board.parse(name, square + 0.5), Page.parse(page))


def test_the_largest_square_of_all_is_one_that_the_code_can_say() -> None:
    sheet = lay_out(Board.parse("aprilgrid:2x2"), Page.parse("5000x5000"))

    assert sheet.board.square_mm == 999.5
    assert len(sheet.code_markers) == 10


def test_a_square_that_the_code_cannot_say_is_printed_without_one() -> None:
    sheet = lay_out(Board.parse("chessboard:9x6", 12.34), Page.parse("a4"))

    assert sheet.code is None
    assert "steps of 0.1 mm" in sheet.no_code
    assert "leave both out" not in " ".join(line.text for line in sheet.lines)


def test_a_small_plate_has_a_shorter_bar_and_says_so() -> None:
    sheet = lay_out(Board.parse("chessboard:9x7"), Page.parse("60x40"))

    assert sheet.bar_mm == 50
    assert "50 mm long" in sheet.lines[1].text
    assert "times 2" in " ".join(line.text for line in sheet.lines)


@pytest.mark.parametrize(
    ("name", "page", "complaint"),
    [
        ("charuco:11x8:36h11", "a4", "upside down"),
        ("chessboard:64x64", "60x40", "fewer squares or a larger page"),
        ("chessboard:9x6", "a9", "one of a4, a3"),
        ("chessboard:9x6", "10x10", "20 to 5000 mm"),
    ],
)
def test_what_cannot_be_printed_is_refused(name: str, page: str, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        lay_out(Board.parse(name), Page.parse(page))


def test_a_measured_bar_gives_the_squares_their_true_side() -> None:
    board = Board.parse("charuco:11x8:0.7", 20.0)

    assert printed(board, 99.6).square_mm == pytest.approx(19.92)
    assert printed(board, 50.5, bar_nominal_mm=50).square_mm == pytest.approx(20.2)
    assert printed(board, 100.0) == board


@pytest.mark.parametrize("bar_mm", [3.92, 89.9, 110.1, math.nan, -100.0])
def test_a_bar_that_no_printer_makes_is_refused(bar_mm: float) -> None:
    with pytest.raises(UsageError, match="90 to 110 mm"):
        printed(Board(9, 6, 25.0), bar_mm)


def test_a_bar_corrects_nothing_where_the_square_is_unknown() -> None:
    with pytest.raises(UsageError, match="--square-mm"):
        printed(Board(9, 6), 99.6)
