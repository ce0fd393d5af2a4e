"""What the sensor's options of `prismstereo simulate` do to a session."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from host.command import complaint_of, prismstereo, result_of
from prismstereo_hw.files import read_picture
from prismstereo_hw.session import Session


@pytest.fixture(scope="module")
def little(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of an OAK-1 with few pixels, whose still is twice as fine as its video, and taller."""
    text = prismstereo("design", "oak-1", "--toml").stdout
    for size, wanted in (("1280", "320"), ("720", "180"), ("4056", "640"), ("3040", "480")):
        text = text.replace(f" {size}", f" {wanted}")
    path = tmp_path_factory.mktemp("rigs") / "little.toml"
    path.write_text(text)
    return path


def test_stills_are_full_frames_at_irregular_instants_a_second_apart(little: Path, tmp_path: Path) -> None:
    result = result_of("simulate", little, "--frames", 2, "--stills", 5, "-o", tmp_path / "s")
    assert (result["video_frames"], result["still_frames"]) == (2, 5)

    stills = list(Session.open(tmp_path / "s").frames("stills"))
    assert {still.pixels.shape for still in stills} == {(480, 640)}
    gaps = np.diff([still.timestamp_us for still in stills])
    assert gaps.min() >= 1_000_000
    assert len(set(gaps)) == len(gaps)


def test_board_stills_show_the_first_poses_again_finer(little: Path, tmp_path: Path) -> None:
    result = result_of("simulate", little, "--frames", 0, "--boards", 2, "--board-stills", 1, "-o", tmp_path / "s")
    assert (result["board_frames"], result["board_still_frames"]) == (2, 1)

    session = Session.open(tmp_path / "s")
    board, still = (next(session.frames(kind)).pixels for kind in ("boards", "boards_still"))
    assert (board.shape, still.shape) == ((180, 320), (480, 640))
    middle = still[60:-60].reshape(180, 2, 320, 2).mean(axis=(1, 3))  # twice as fine, a third taller
    assert np.corrcoef(board.ravel(), middle.ravel())[0, 1] > 0.98


def test_more_board_stills_than_boards_are_refused(little: Path, tmp_path: Path) -> None:
    told = complaint_of(2, "simulate", little, "--boards", 1, "--board-stills", 2, "-o", tmp_path / "s")
    assert "--board-stills 2 of --boards 1" in told
    assert not (tmp_path / "s").exists()


def test_exposure_gain_noise_pupil_and_motion_reach_the_sensor(little: Path, tmp_path: Path) -> None:
    common = ("simulate", little, "--scene", "plane:700", "--frames", 1, "--noise", 0)
    options = {
        "plain": (),
        "brighter": ("--exposure-us", 15_000),
        "evened": ("--exposure-us", 5_000, "--gain", 2, "--motion-blur", 2),
        "noisy": ("--sensor-noise",),
        "mixed": ("--pupil-samples", 8),
    }
    pictures = {}
    for name, chosen in options.items():
        result_of(*common, *chosen, "-o", tmp_path / name)
        pictures[name] = next(Session.open(tmp_path / name).frames("video")).pixels.astype(float)
    plain = pictures["plain"]
    lit = (plain > 30) & (plain < 150)
    assert np.median(pictures["brighter"][lit] / plain[lit]) == pytest.approx(1.5, abs=0.02)
    np.testing.assert_array_equal(pictures["evened"], plain)  # half as long, twice amplified; and nothing moves
    noise = (pictures["noisy"] - plain)[lit]
    assert noise.var() == pytest.approx(plain[lit].mean() / 40 + 1 / 6, rel=0.1)  # 40 electrons a level, rounded twice
    changed = np.flatnonzero((pictures["mixed"] != plain).any(axis=0))
    assert 140 < changed.min() < 160 < changed.max() < 180  # the seam alone


def test_an_exposure_of_nothing_is_refused(little: Path, tmp_path: Path) -> None:
    assert "exposure-us" in complaint_of(2, "simulate", little, "--exposure-us", 0, "-o", tmp_path / "s")


@pytest.mark.soak
def test_dust_warmth_and_a_rolling_shutter_reach_the_session(tmp_path: Path) -> None:
    clean, day = tmp_path / "clean", tmp_path / "day"
    result_of("simulate", "oak-1", "--scene", "plane:700", "--frames", 1, "--noise", 0, "-o", clean)

    result_of(
        "simulate", "oak-1", "--scene", "plane:700", "--frames", 1, "--noise", 0, "--dust", 12, "--drops", 2,
        "--temperature-c", 60, "--rolling-shutter-us", 20, "-o", day,
    )  # fmt: skip

    baselines = [tomllib.loads((folder / "truth" / "lens.toml").read_text())["baseline_mm"] for folder in (clean, day)]
    # 40 K of PETG: mirrors 0.041 mm further out widen the baseline, 0.030 mm further up narrow it again
    assert baselines[1] - baselines[0] == pytest.approx(0.041, abs=0.005)
    assert not np.array_equal(*(read_picture(folder / "video" / "000000.png") for folder in (clean, day)))
