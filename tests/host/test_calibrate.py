"""`prismstereo calibrate` and `depth`, on simulated boards, on real photographs, and on what cannot be calibrated."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from host.command import complaint_of, prismstereo, result_of


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards") / "session"
    result_of("simulate", "oak-1", "--frames", 1, "--boards", 8, "--out", folder)
    return folder


def test_a_session_calibrates_by_itself_and_its_calibration_gives_depth(boards: Path, tmp_path: Path) -> None:
    unit, report = tmp_path / "unit.json", tmp_path / "report.html"

    result = result_of("calibrate", boards, "-o", unit, "--report", report)

    assert result["model"] == "one-lens"
    assert result["rms_px"] < 0.15
    assert result["baseline_mm"] == pytest.approx(50.2, abs=0.3)
    assert result["views_used"] + len(result["views_rejected"]) == 8
    assert result["range_min_mm"] < 400
    assert set(result["triangulation_gap_mm"]) == {"mean", "variance"}
    assert report.read_text().startswith("<!DOCTYPE html>")
    assert result_of("depth", boards, "--calibration", unit, "-o", tmp_path / "out")["frames"][0]["density"] > 0.5


def test_people_are_told_what_was_rejected_and_the_verdict(boards: Path, tmp_path: Path) -> None:
    done = prismstereo("calibrate", boards, "-o", tmp_path / "unit.json")

    assert done.returncode == 0
    assert "verdict             good" in done.stdout
    assert "looking for the board" in done.stderr


class TestRealPhotographs:
    def test_a_stereo_pi_calibrates_and_sees_a_flat_board(self, data: Path, tmp_path: Path) -> None:
        frames, unit = data / "sbs-stereopi-320", tmp_path / "unit.json"

        result = result_of("calibrate", frames, "--layout", "side-by-side", "--board", "chessboard:9x6", "-o", unit)
        result_of("depth", frames / "scene_640x240_8.png", "--calibration", unit, "-o", tmp_path / "out")

        assert result["rms_px"] <= 0.22
        assert result["plane_fit_squares"]["rms"] < 0.06
        written = {path.suffix for path in (tmp_path / "out").iterdir()}
        assert written == {".pfm", ".png", ".ply"}

    def test_two_cameras_calibrate_from_pairs_of_files(self, data: Path, tmp_path: Path) -> None:
        pairs = data / "calib-opencv-9x6"

        result = result_of(
            "calibrate", "--left", pairs / "left*.jpg", "--right", pairs / "right*.jpg",
            "--board", "chessboard:9x6", "-o", tmp_path / "unit.json",
        )  # fmt: skip

        assert result["rms_px"] <= 0.25
        assert result["baseline_squares"] == pytest.approx(3.33, abs=0.03)
        assert result["views_used"] == 13


class TestWhatCannotBeCalibrated:
    def refused(self, tmp_path: Path, code: int, *arguments: object) -> str:
        out = tmp_path / "unit.json"
        complaint = complaint_of(code, "calibrate", *arguments, "-o", out)
        assert not out.exists()
        return complaint

    def test_frames_without_a_board(self, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / "a.png"), np.full((720, 1280), 90, np.uint8))

        assert "no" in self.refused(tmp_path, 4, tmp_path / "a.png", "--rig", "oak-1", "--board", "chessboard:9x7")

    @pytest.mark.soak
    def test_a_board_of_another_size_is_named(self, boards: Path, tmp_path: Path) -> None:
        complaint = self.refused(tmp_path, 4, boards / "boards", "--rig", "oak-1", "--board", "chessboard:8x5")

        assert "chessboard:9x7" in complaint

    def test_a_board_in_one_view_only(self, boards: Path, tmp_path: Path) -> None:
        for path in sorted((boards / "boards").iterdir())[:3]:
            half = cv2.imread(str(path), 0)
            half[:, :640] = 60
            cv2.imwrite(str(tmp_path / path.name), half)

        complaint = self.refused(tmp_path, 4, tmp_path, "--rig", "oak-1", "--board", "chessboard:9x7")

        assert "one view" in complaint or "right view" in complaint

    def test_frames_of_two_sizes(self, boards: Path, tmp_path: Path) -> None:
        first = sorted((boards / "boards").iterdir())[0]
        picture = cv2.imread(str(first), 0)
        cv2.imwrite(str(tmp_path / "a.png"), picture)
        cv2.imwrite(str(tmp_path / "b.png"), picture[:600])

        complaint = self.refused(tmp_path, 4, tmp_path, "--rig", "oak-1", "--board", "chessboard:9x7")

        assert "a.png" in complaint
        assert "b.png" in complaint

    def test_frames_that_are_not_the_rigs(self, tmp_path: Path, data: Path) -> None:
        frames = data / "sbs-stereopi-320"

        assert "640x240" in self.refused(tmp_path, 4, frames, "--rig", "oak-1", "--board", "chessboard:9x6")

    def test_flags_that_are_missing_or_contradict(self, boards: Path, tmp_path: Path) -> None:
        frames = boards / "boards"

        assert "--board" in self.refused(tmp_path, 4, frames, "--rig", "oak-1")  # no code is printed beside it
        assert "--layout" in self.refused(tmp_path, 2, frames, "--board", "chessboard:9x7")
        assert "not both" in self.refused(
            tmp_path, 2, frames, "--board", "chessboard:9x7", "--rig", "oak-1", "--layout", "swapped"
        )
        assert "no picture" in self.refused(tmp_path, 2, "nothing*.png", "--rig", "oak-1", "--board", "chessboard:9x7")

    def test_a_square_of_no_size_a_star_s_heat_and_a_focus_out_of_count(self, boards: Path, tmp_path: Path) -> None:
        given = (boards / "boards", "--rig", "oak-1", "--board", "chessboard:9x7")

        assert "a square of 0 mm" in self.refused(tmp_path, 2, *given, "--square-mm", 0)
        for hot in ("nan", "5000"):
            assert "--temperature-c" in self.refused(tmp_path, 2, *given, "--temperature-c", hot)
        assert "--lens-position" in self.refused(tmp_path, 2, *given, "--lens-position", 99_999_999)

    def test_a_report_that_cannot_be_written_leaves_no_calibration(self, boards: Path, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("no folder")

        frames = sorted((boards / "boards").iterdir())[:3]
        given = (*frames, "--rig", "oak-1", "--board", "chessboard:9x7", "--square-mm", 9.5)

        assert "report.html" in self.refused(tmp_path, 4, *given, "--report", tmp_path / "file" / "report.html")
