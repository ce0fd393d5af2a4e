"""The report: one well-formed page that needs nothing else, the same bytes for the same input."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree as ET

import pytest

from calibration.traced_boards import SQUARE_MM, traced_detection
from prismstereo_calibration.board import Board
from prismstereo_calibration.detection import Rejection
from prismstereo_calibration.quality import Quality, judge
from prismstereo_calibration.report import html
from prismstereo_calibration.solve import Solution, solve
from prismstereo_hw.rig import Rig

BOARD = Board(9, 7, SQUARE_MM)


@cache
def solved(poses: int = 6) -> tuple[Solution, Quality]:
    rig = Rig.read("oak-1")
    detection = traced_detection(rig, 1, poses=poses)
    solution = solve(detection, BOARD, rig=rig)
    return solution, judge(solution.calibration, detection, BOARD, rms_px=solution.rms_px)


def test_the_same_input_gives_the_same_bytes() -> None:
    assert html(*solved()) == html(*solved())


def test_the_page_loads_nothing_and_runs_nothing() -> None:
    page = html(*solved())
    assert not re.search(r"https?:|//|<script|<link|<img|src=|@import|url\(|javascript", page)
    assert "default-src 'none'" in page


def test_every_drawing_is_well_formed_and_has_a_name() -> None:
    drawings = re.findall(r"<svg.*?</svg>", html(*solved()), re.DOTALL)
    assert len(drawings) == 5  # rms, coverage of each view, residuals of each view
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


@pytest.mark.parametrize(("limit", "word"), [(0.1, "Usable"), (0.05, "Redo")])
def test_the_verdict_stands_on_top(limit: float, word: str) -> None:
    solution, quality = solved()
    first = replace(quality.criteria[0], good=0.01, usable=0.3 if word == "Usable" else limit)
    page = html(solution, replace(quality, criteria=(first, *quality.criteria[1:])))
    assert f">{word}: " in page
    assert page.index(f">{word}: ") < page.index("<table")
