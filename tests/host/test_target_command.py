"""`prismstereo target` from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from host.command import complaint_of, prismstereo, result_of


def test_a_board_that_fills_the_page_is_written_and_described(tmp_path: Path) -> None:
    result = result_of("target", "-o", tmp_path / "board.pdf")

    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF-")
    assert (result["board"], result["dictionary"], result["page"]) == ("charuco:11x8", "4x4_50", "a4")
    assert (result["page_width_mm"], result["page_height_mm"], result["bar_mm"]) == (297, 210, 100)
    assert 20 <= result["square_mm"] <= 24
    assert result["board_width_mm"] == pytest.approx(11 * result["square_mm"])
    assert result["board_height_mm"] == pytest.approx(8 * result["square_mm"])
    assert len(result["code_markers"]) == 10


def test_a_plate_is_written_for_its_maker_in_words_for_people(tmp_path: Path) -> None:
    done = prismstereo(
        "target", "--board", "chessboard:9x7", "--square-mm", 3.25, "--page", "60x50", "-o", tmp_path / "plate.dxf"
    )

    assert done.returncode == 0, done.stderr
    assert "chessboard:9x7, squares of 3.25 mm, 32.5 x 26.0 mm on 60x50" in done.stdout
    assert "no code beside the board: squares of 3.25 mm" in done.stdout
    assert b"AC1009" in (tmp_path / "plate.dxf").read_bytes()


def test_what_is_no_drawing_is_refused(tmp_path: Path) -> None:
    assert ".svg or .dxf" in complaint_of(2, "target", "-o", tmp_path / "board.docx")
    assert not list(tmp_path.iterdir())
