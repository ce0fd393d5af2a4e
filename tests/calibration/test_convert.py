"""Calibrations in the files of others: exact there and back, and meaning there what they mean here."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibration.pinhole_pairs import FRAME, in_front, numbers, prism
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.convert import ros
from prismstereo_calibration.convert.formats import FORMATS
from prismstereo_calibration.convert.frame_size import frame_size
from prismstereo_calibration.convert.pair import StereoPairModel, calibration_of, pair_of
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import LAYOUTS, View

Array = NDArray[np.float64]
MIRRORED = tuple(View(left=left, top=0.0, width=0.5, height=1.0, mirrored=True) for left in (0.5, 0.0))
VIEWS = {**LAYOUTS, "mirrored": (MIRRORED[0], MIRRORED[1])}


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Two lenses with any distortion, a turn about any axis, a right camera to the right, views of any attitude."""
    views = VIEWS[draw(st.sampled_from(sorted(VIEWS)))]
    lenses = []
    for view in views:
        x, y, w, h = view.rectangle(*FRAME)
        focal = draw(st.floats(700, 3000))
        bends = [draw(st.floats(-size, size)) for size in (0.1, 0.05, 2e-3, 2e-3, 0.02)]
        cx, cy = x + w * draw(st.floats(0, 1)), y + h * draw(st.floats(0.3, 0.7))
        k1, k2, p1, p2, k3 = bends
        lenses.append(Lens(focal, focal * draw(st.floats(0.95, 1.05)), cx, cy, (k1, k2, p1, p2, k3)))
    turn = np.array([draw(st.floats(-size, size)) for size in (0.05, 0.3, 0.05)])
    R = np.asarray(cv2.Rodrigues(turn)[0])
    centre = np.array([draw(st.floats(size, limit)) for size, limit in ((10, 300), (-2, 2), (-5, 5))])
    try:
        return made(views, lenses[0], Camera(lenses[1], R, -R @ centre), draw(st.sampled_from([0, 117])))
    except CalibrationError:  # a distortion that folds the picture
        reject()


def made(views: tuple[View, View], left: Lens, right: Camera, lens_position: int = 0) -> Calibration:
    return Calibration(
        rig="any",
        frame_width=FRAME[0],
        frame_height=FRAME[1],
        left_view=views[0],
        right_view=views[1],
        left=Camera.at_origin(left),
        right=right,
        range=RangeWish(near_mm=400.0, far_mm=math.inf, labels=128),
        model="two-camera",
        lens_position=lens_position or None,
    )


def there_and_back(form: str, one: Calibration) -> Calibration:
    with tempfile.TemporaryDirectory() as name:
        for file, content in FORMATS[form].write(pair_of(one)).files.items():
            (Path(name) / file).write_bytes(content)
        pair = FORMATS[form].read([Path(name)])
    return calibration_of(pair, one.views, frame_size(pair, one.views), one.range, one.rig)


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_every_number_comes_back_and_every_point_is_seen_where_it_was(form: str, data: st.DataObject) -> None:
    one = data.draw(calibrations())
    if form == "kalibr":
        one = without_k3(one)
    back = there_and_back(form, one)
    assert back.baseline == pytest.approx(one.baseline, rel=1e-9)
    np.testing.assert_allclose(back.right.t_camera_from_left, one.right.t_camera_from_left, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(back.right.R_camera_from_left, one.right.R_camera_from_left, rtol=0, atol=1e-12)
    points = in_front(one)
    for mine, theirs in ((one.left, back.left), (one.right, back.right)):
        np.testing.assert_allclose(numbers(theirs.lens), numbers(mine.lens), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(theirs.project(points), mine.project(points), rtol=0, atol=1e-6)
    assert back.lens_position == (one.lens_position if form == "luxonis" else None)


def without_k3(one: Calibration) -> Calibration:
    left, right = (replace(lens, distortion=(*lens.distortion[:4], 0.0)) for lens in (one.left.lens, one.right.lens))
    try:
        return replace(one, left=Camera.at_origin(left), right=replace(one.right, lens=right))
    except CalibrationError:
        reject()


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_calibration_gives_the_same_bytes(form: str) -> None:
    assert FORMATS[form].write(pair_of(prism())).files == FORMATS[form].write(pair_of(prism())).files


def test_glass_is_replaced_by_the_nearest_pinholes_and_what_that_costs_is_told() -> None:
    behind = Calibration.nominal(Rig.read("oak-1"))
    pair = pair_of(behind)
    assert behind.left.plate is not None
    assert 0.02 < pair.glass_rms_px < 0.2
    assert pair.glass_shift != 0
    flat = behind.pinholes()
    assert pair.left.lens.fx_px == flat.left.lens.fx_px
    np.testing.assert_array_equal(pair.t_right_from_left, flat.right.t_camera_from_left)


@pytest.mark.parametrize("form", ["ros", "kalibr", "luxonis", "colmap"])
def test_lengths_in_squares_have_no_metric_form(form: str) -> None:
    with pytest.raises(UsageError, match=r"unit is 'square'.*--square-mm"):
        FORMATS[form].write(pair_of(replace(prism(), unit="square")))


def test_opencv_files_say_that_lengths_are_in_squares() -> None:
    assert there_and_back("opencv", replace(prism(), unit="square")).unit == "square"


def test_interlaced_views_have_no_ros_form_but_come_back_from_the_others() -> None:
    one = Calibration.nominal(Rig.read("field-sequential")).pinholes()
    with pytest.raises(UsageError, match=r"interlaced.*convert to opencv"):
        ros.write(pair_of(one))
    back = there_and_back("opencv", one)
    assert (back.frame_width, back.frame_height) == (one.frame_width, one.frame_height)
    assert numbers(back.right.lens) == pytest.approx(numbers(one.right.lens), rel=1e-9)


@pytest.mark.parametrize("name", ["oak-1", "two-mirrors", "three-mirrors", "field-sequential"])
def test_one_lens_seen_twice_is_known_again(name: str) -> None:
    rig = Rig.read(name)
    one = Calibration.nominal(rig)
    back = there_and_back("colmap", replace(one, range=RangeWish(near_mm=400.0, far_mm=math.inf, labels=128)))
    assert back.model == "one-lens"
    assert back.views == rig.views


def test_files_of_another_picture_size_belong_to_no_frame_of_these_views() -> None:
    pair = pair_of(prism())
    odd = replace(pair, right=replace(pair.right, size=(600, 720)))
    with pytest.raises(CalibrationError, match="640x720 and 600x720 px are no views of one frame"):
        frame_size(odd, prism().views)
    with pytest.raises(CalibrationError, match="no views of a frame of 640x480"):
        frame_size(pair, prism().views, asked=(640, 480))
    assert frame_size(pair, prism().views, likely=(1920, 1080)) == FRAME


def test_without_a_range_it_is_what_128_labels_reach_from_infinity() -> None:
    pair: StereoPairModel = pair_of(prism())
    found = calibration_of(pair, prism().views, FRAME, None, "side-by-side")
    window = rectification(found).window
    assert found.range.far_mm == math.inf
    assert window.labels == 128
    assert window.nearest == pytest.approx(found.range.near_mm)
