"""The report: one well-formed page that needs nothing else, the same bytes for the same input."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from calibration.traced_boards import SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Rejection
from prismstereo_calibration.judging.quality import Quality, judge
from prismstereo_calibration.judging.report import html
from prismstereo_calibration.judging.report.heat_map import heat_map
from prismstereo_calibration.solving.fit import RejectedCorner
from prismstereo_calibration.solving.solve import Solution, solve
from prismstereo_hw.rig import Rig

BOARD = Board(9, 7, SQUARE_MM)


@cache
def solved(poses: int = 15) -> tuple[Solution, Quality]:
    rig = Rig.read("oak-1")
    detection = traced_detection(rig, 1, poses=poses)
    solution = solve(detection, BOARD, rig=rig)
    return solution, judge(solution.calibration, detection, BOARD, solution=solution)


def test_the_same_input_gives_the_same_bytes() -> None:
    assert html(*solved()) == html(*solved())


def test_the_page_loads_nothing_and_runs_nothing() -> None:
    page = html(*solved())
    assert not re.search(r"https?:|//|<script|<link|<img|src=|@import|url\(|javascript", page)
    assert "default-src 'none'" in page


def test_every_drawing_is_well_formed_and_has_a_name() -> None:
    drawings = re.findall(r"<svg.*?</svg>", html(*solved()), re.DOTALL)
    assert (
        len(drawings) == 11
    )  # rms, coverage and residuals of each view, rows, colour scale, maps at 0.4, 0.5, 1 and 2 m
    for drawing in drawings:
        assert ET.fromstring(drawing).get("aria-label")


def test_names_from_outside_are_escaped() -> None:
    solution, quality = solved()
    wicked = '<script>alert("x")</script>&.png'
    rigged = replace(solution.calibration, rig=wicked)
    page = html(
        replace(
            solution,
            calibration=rigged,
            used=(wicked, *solution.used[1:]),
            rejected=(Rejection(wicked, "no board in the <left> view"),),
        ),
        quality,
        title=wicked,
    )
    assert "<script" not in page
    assert "<left>" not in page
    assert page.count("&lt;script&gt;") >= 4


def test_what_a_person_looks_for_is_on_the_page() -> None:
    solution, quality = solved()
    page = html(replace(solution, rejected=(Rejection("bad.png", "corners are 9.99 px off"),)), quality)
    assert "Good: every figure is within its first limit." in page
    for text in (
        f"{solution.calibration.baseline:.4f}",
        f"{solution.rms_px:.3f}",
        "bad.png",
        "corners are 9.99 px off",
        *solution.used,
    ):
        assert text in page
    assert re.search(r"1\.0 px \(x\d+\)", page)  # the scale of the arrows is stated
    assert quality.next_views[0].sentence in page
    assert "mm at 1000 mm" in page
    for one in quality.maps:
        assert f"at {one.depth:.4g} mm: typically {one.typical:.3g}, at worst {one.worst:.3g} mm" in page
    assert f"{quality.assembly.axis_off_columns_deg:.3f}" in page


def test_rejected_corners_are_listed_by_frame_view_and_number() -> None:
    solution, quality = solved()
    corners = (RejectedCorner("pose03.png", 1, 17, 4.25), RejectedCorner("pose03.png", 1, 18, 3.0))
    page = html(replace(solution, rejected_corners=corners), quality)
    row = re.search(r"<tr><td>pose03\.png</td>.*?</tr>", page)
    assert row is not None
    assert [*re.findall(r">([^<]+)</td>", row[0])] == ["pose03.png", "right", "2", "17 (4.2 px), 18 (3.0 px)"]


def test_a_frame_with_corners_in_one_view_only_is_drawn_without_a_bar_for_the_other() -> None:
    solution, quality = solved()
    residuals, corners = solution.residuals_px.copy(), solution.corners_px.copy()
    residuals[2, 1] = corners[2, 1] = np.nan
    page = html(replace(solution, residuals_px=residuals, corners_px=corners), quality)
    assert "nan" not in page
    assert page.count("pose02.png, view 1:") == 1
    assert "pose02.png, view 2:" not in page


def test_a_third_view_is_drawn_beside_the_two() -> None:
    solution, quality = solved()
    corners, residuals = (
        np.concatenate([array, array[:, 1:]], axis=1) for array in (solution.corners_px, solution.residuals_px)
    )
    page = html(replace(solution, corners_px=corners, residuals_px=residuals, others=(solution.calibration,)), quality)
    assert page.count("<svg") == 13
    assert "residuals in the view 3 view" not in page
    assert page.count("pose02.png, view 3:") == 1


def test_a_calibration_without_uncertainty_says_so_instead_of_a_map() -> None:
    solution, quality = solved()
    page = html(solution, replace(quality, maps=(), next_views=()))
    assert "does not say how well its numbers are known" in page
    assert "No further view" in page


def test_what_is_beyond_the_limit_is_framed_and_nothing_else() -> None:
    values = np.array([[0.1, 0.2, 0.9], [np.nan, 0.3, 0.8]])
    drawing = ET.fromstring(heat_map(values, 1.0, 0.5, "a map"))
    frames = "".join(path.get("d") or "" for path in drawing.iter("path"))
    assert frames.count("v") == 4  # two fields in the last column: left and right edge of each
    assert frames.count("h") == 2  # one edge above, one below
    assert len([one for one in drawing.iter("rect") if one.get("class") == "heat"]) == 5


@pytest.mark.parametrize(("limit", "word"), [(0.1, "Usable"), (0.05, "Redo")])
def test_the_verdict_stands_on_top(limit: float, word: str) -> None:
    solution, quality = solved()
    first = replace(quality.criteria[0], good=0.01, usable=0.3 if word == "Usable" else limit)
    page = html(solution, replace(quality, criteria=(first, *quality.criteria[1:])))
    assert f">{word}: " in page
    assert page.index(f">{word}: ") < page.index("<table")
