"""Rectification without a board on real pictures: a camera and a mirror, and two cameras that nobody here set up.

PRISMSTEREO_DATA names the folder. The whole table is behind `make soak`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.uncalibrated.form_figures import FormFigures
from prismstereo_calibration.uncalibrated.scene_fit import fit_scene
from prismstereo_calibration.uncalibrated.scene_matches import scene_matches
from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification
from prismstereo_hw.files import read_picture
from prismstereo_hw.view import View, layout

MIRROR_EDGE = ((0.0, 0.0), (0.555, 0.0), (0.484, 0.24), (0.484, 0.75), (0.55, 1.0), (0.0, 1.0))  # of the direct view
MIRROR = (
    View(left=0.0, top=0.0, width=0.56, height=1.0, polygon=MIRROR_EDGE),
    View(left=0.585, top=0.0, width=0.415, height=1.0, mirrored=True),  # behind the bevelled edge
)


def two_cameras(data: Path, numbers: list[int]) -> list[NamedFrame]:
    """Pairs of the two webcams, side by side."""
    folder = data / "calib-opencv-9x6"
    return [
        NamedFrame(
            f"{number:02}", np.hstack([read_picture(folder / f"{side}{number:02}.jpg") for side in ("left", "right")])
        )
        for number in numbers
    ]


def by_form(made: SceneRectification) -> dict[str, FormFigures]:
    return {one.form: one for one in made.figures}


def test_a_camera_and_one_mirror_are_rectified_to_half_a_pixel_at_full_size(data: Path) -> None:
    picture = read_picture(data / "mirror-one-planar" / "catadioptric_f-6-mm_1.jpg")
    made = fit_scene(scene_matches([NamedFrame("mirror", picture)], MIRROR), most_labels=512)
    print(
        f"| mirror-one-planar | {made.form} | {made.matches} matches | median {made.chosen.row_error_median_px:.3f} px |"
    )
    assert (made.frame_width, made.frame_height) == (4000, 3000)
    assert made.scale == 1.0
    assert made.form == "quasi-euclidean-6"
    assert made.matches >= 100
    assert made.chosen.row_error_median_px <= 0.6  # measured 0.26
    assert made.chosen.skew_deg < 0.5


def test_eight_numbers_are_no_worse_than_hartley_and_bend_less(data: Path) -> None:
    forms = by_form(fit_scene(scene_matches(two_cameras(data, [4, 13]), layout("side-by-side"))))
    eight, hartley = forms["quasi-euclidean-8"], forms["hartley"]
    assert eight.row_error_mean_px <= hartley.row_error_mean_px
    assert eight.skew_deg < min(0.5, hartley.skew_deg)


def real_pairs(data: Path) -> Iterator[tuple[str, list[NamedFrame]]]:
    """Each picture of the webcams by itself, and always two of the StereoPi, and all of them together."""
    webcams = two_cameras(data, [number for number in range(1, 15) if number != 10])
    yield from ((f"webcams {frame.name}", [frame]) for frame in webcams)
    yield "webcams, all", webcams
    paths = sorted((data / "sbs-stereopi-320").glob("*.png"))
    pi = [NamedFrame(path.stem, read_picture(path)) for path in paths]
    yield from ((f"stereopi {first.name}", [first, second]) for first, second in zip(pi[::2], pi[1::2], strict=True))
    yield "stereopi, all", pi


@pytest.mark.soak
def test_over_all_real_pairs_eight_numbers_are_no_worse_than_hartley_and_bend_less(data: Path) -> None:
    compared: list[tuple[FormFigures, FormFigures]] = []
    for name, frames in real_pairs(data):
        made = fit_scene(scene_matches(frames, layout("side-by-side")))
        forms = by_form(made)
        cells = [
            f"{one.form} {one.row_error_mean_px:.3f} ({one.row_error_p95_px:.3f}) px, {one.skew_deg:.1f} deg, "
            f"{one.aspect:.2f}, {one.area_ratio:.2f}"
            for one in made.figures
        ]
        print(f"| {name} | {made.matches} matches | {made.form} | {' | '.join(cells)} |")
        if "quasi-euclidean-8" in forms and "hartley" in forms:
            compared.append((forms["quasi-euclidean-8"], forms["hartley"]))
    assert len(compared) >= 26  # of 27; one picture has its matches on next to a plane
    errors = np.array([[one.row_error_mean_px for one in pair] for pair in compared])
    skews = np.array([[one.skew_deg for one in pair] for pair in compared])
    print(
        f"| mean | worst | {errors.mean(axis=0).round(3)} | {errors.max(axis=0).round(3)} | skew {skews.max(axis=0).round(2)} |"
    )
    assert errors[:, 0].mean() <= errors[:, 1].mean()
    assert errors[:, 0].max() <= errors[:, 1].max()
    assert skews[:, 0].max() < 0.5
    assert np.mean(skews[:, 0] < skews[:, 1]) >= 0.9
