import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.command import complaint_of, prismstereo, result_of
from prismstereo_hw import pfm
from prismstereo_hw.session import Session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("twin") / "session"
    result_of("simulate", "oak-1", "--scene", "plane:800", "--frames", 1, "--boards", 6, "--out", folder)
    return folder


@pytest.mark.parametrize(
    ("rig", "baseline_mm", "columns_kept"),
    [("dslr-35mm", 49.6, 1.0), ("oak-1", 50.2, 0.816), ("pi-camera-v2", 50.2, 0.925)],
)
def test_design_prints_the_figures_of_a_rig(rig: str, baseline_mm: float, columns_kept: float) -> None:
    result = result_of("design", rig)

    assert result["baseline_mm"] == pytest.approx(baseline_mm, abs=0.1)
    assert result["columns_kept"] == pytest.approx(columns_kept, abs=0.005)
    assert result["range_min_mm"] < 450
    assert result["range_max_mm"] is None  # infinity


def test_design_prints_a_rig_file_that_can_be_read_again(tmp_path: Path) -> None:
    text = prismstereo("design", "oak-1", "--toml").stdout
    (tmp_path / "my.toml").write_text(text.replace('name = "oak-1"', 'name = "mine"'))

    assert result_of("design", tmp_path / "my.toml")["rig"] == "mine"


def test_a_rig_that_cannot_be_built_is_refused_with_value_rule_and_mend(tmp_path: Path) -> None:
    text = prismstereo("design", "oak-1", "--toml").stdout
    (tmp_path / "bad.toml").write_text(text.replace("angle_deg = 53.2", "angle_deg = 90.0"))

    complaint = complaint_of(2, "design", tmp_path / "bad.toml")

    assert "mirrors.angle_deg is 90" in complaint
    assert "45 and 75" in complaint


def test_simulate_writes_a_whole_session_with_truth(session: Path) -> None:
    opened = Session.open(session)

    assert opened.info.video_frames == 1
    assert opened.info.board_frames == 6
    assert opened.truth(0).depth_mm.shape == (720, 640)


def test_simulate_does_not_overwrite_a_session(session: Path) -> None:
    assert "already holds a session" in complaint_of(4, "simulate", "oak-1", "--frames", 1, "--out", session)


def test_depth_of_a_session_is_the_depth_of_its_plane(session: Path, tmp_path: Path) -> None:
    result = result_of("depth", session, "-o", tmp_path)

    # the plane stands 800 mm before the entrance pupil, the virtual pinholes a little behind it
    assert result["frames"][0]["median_depth_mm"] == pytest.approx(813, abs=4)
    assert result["frames"][0]["density"] > 0.6
    for ending in ("_disparity.pfm", "_depth.pfm", "_depth.png", ".ply"):
        assert (tmp_path / f"000000{ending}").is_file()


def test_a_wished_range_is_honoured_and_an_impossible_one_refused(session: Path, tmp_path: Path) -> None:
    frame, calibration = session / "video" / "000000.png", session / "calibration.json"

    result = result_of("depth", frame, "--calibration", calibration, "--range-mm", "500:2000", "-o", tmp_path)

    assert result["range_min_mm"] < 500
    assert result["range_max_mm"] == pytest.approx(2000, rel=1e-6)
    assert result["frames"][0]["median_depth_mm"] == pytest.approx(813, abs=4)
    refusal = complaint_of(2, "depth", frame, "--calibration", calibration, "--range-mm", "20:inf", "-o", tmp_path)
    assert "disparity labels" in refusal


def test_match_writes_a_disparity_file_and_says_how_it_went(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    left = cv2.GaussianBlur(rng.integers(0, 255, (120, 200), dtype=np.uint8), (0, 0), 1.2)
    cv2.imwrite(str(tmp_path / "left.png"), left)
    cv2.imwrite(str(tmp_path / "right.png"), np.roll(left, -7, axis=1))

    result = result_of(
        "match", tmp_path / "left.png", tmp_path / "right.png", "--max-disparity", 32, "-o", tmp_path / "d.pfm"
    )

    disparity = pfm.read(tmp_path / "d.pfm")
    assert np.nanmedian(disparity) == pytest.approx(7, abs=0.05)
    assert result["valid_pixels"] == np.count_nonzero(np.isfinite(disparity))
    assert set(result) >= {"milliseconds", "density", "valid_pixels"}


class TestBadInput:
    def test_a_truncated_picture(self, session: Path, tmp_path: Path) -> None:
        whole = (session / "video" / "000000.png").read_bytes()
        (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
        out = tmp_path / "out"

        complaint = complaint_of(
            4, "depth", tmp_path / "cut.png", "--calibration", session / "calibration.json", "-o", out
        )

        assert "cut.png is cut off" in complaint
        assert not out.exists()

    def test_a_file_that_is_no_picture(self, session: Path, tmp_path: Path) -> None:
        (tmp_path / "text.png").write_text("not a picture")

        complaint = complaint_of(
            4, "depth", tmp_path / "text.png", "--calibration", session / "calibration.json", "-o", tmp_path / "out"
        )

        assert "not a picture that can be read" in complaint

    def test_a_frame_of_another_size(self, session: Path, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / "small.png"), np.zeros((240, 320), np.uint8))

        complaint = complaint_of(
            4, "depth", tmp_path / "small.png", "--calibration", session / "calibration.json", "-o", tmp_path / "out"
        )

        assert "320x240" in complaint
        assert "1280x720" in complaint

    def test_a_calibration_of_another_rig(self, session: Path, tmp_path: Path) -> None:
        result_of("simulate", "pi-camera-v2", "--frames", 0, "--boards", 1, "--out", tmp_path / "other")

        complaint = complaint_of(
            4, "depth", session, "--calibration", tmp_path / "other" / "calibration.json", "-o", tmp_path / "out"
        )

        assert "'pi-camera-v2'" in complaint
        assert "'oak-1'" in complaint

    def test_a_calibration_with_a_number_that_is_none(self, session: Path, tmp_path: Path) -> None:
        content = (session / "calibration.json").read_text()
        start = content.index("fx_px")
        number = content[start:].split(":")[1].split(",")[0]
        (tmp_path / "nan.json").write_text(content.replace(number, " NaN", 1))

        complaint_of(4, "depth", session, "--calibration", tmp_path / "nan.json", "-o", tmp_path / "out")

        assert not (tmp_path / "out").exists()

    def test_pictures_of_two_sizes_are_no_pair(self, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / "a.png"), np.zeros((24, 32), np.uint8))
        cv2.imwrite(str(tmp_path / "b.png"), np.zeros((24, 48), np.uint8))

        complaint = complaint_of(4, "match", tmp_path / "a.png", tmp_path / "b.png", "-o", tmp_path / "d.pfm")

        assert "32x24" in complaint
        assert not (tmp_path / "d.pfm").exists()

    def test_nonsense_on_the_command_line(self, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / "a.png"), np.zeros((24, 32), np.uint8))
        a = tmp_path / "a.png"

        assert "no matcher 'magic'" in complaint_of(2, "match", a, a, "--matcher", "magic", "-o", tmp_path / "d.pfm")
        assert "--max-disparity 0" in complaint_of(2, "match", a, a, "--max-disparity", 0, "-o", tmp_path / "d.pfm")
        assert ".pfm, .png, .npy" in complaint_of(2, "match", a, a, "-o", tmp_path / "d.jpg")
        assert "no rig 'nothing'" in complaint_of(2, "design", "nothing")
        assert "no scene 'moon'" in complaint_of(2, "simulate", "oak-1", "--scene", "moon", "-o", tmp_path / "s")
        assert "calibration" in complaint_of(2, "depth", a, "-o", tmp_path / "out")

    def test_results_are_strict_json(self) -> None:
        json.loads(prismstereo("design", "oak-1", "--json").stdout, parse_constant=pytest.fail)
