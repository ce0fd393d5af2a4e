"""The catalogue: every number has a source, and the numbers of one camera agree with each other."""

from __future__ import annotations

import math

import pytest

from prismstereo_hw.catalogue import camera, cameras
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

EVERY = pytest.mark.parametrize("name", cameras())
SOURCED = {"sensor_width_mm", "focal_mm", "f_number", "hfov_deg", "pupil_to_prism_mm"}


def test_the_common_cameras_are_there() -> None:
    assert len(cameras()) >= 8
    assert {"oak-1", "oak-1-lite", "pi-camera-v2", "pi-camera-v3", "pi-hq-6mm", "pi-hq-16mm"} <= set(cameras())


@EVERY
def test_every_number_says_where_it_is_from(name: str) -> None:
    entry = camera(name)
    assert set(entry.sources) == SOURCED
    assert all(len(source) > 10 for source in entry.sources.values())
    assert entry.sources["pupil_to_prism_mm"].startswith("assumed")


@EVERY
def test_field_of_view_sensor_and_focal_length_agree(name: str) -> None:
    entry = camera(name)
    ideal = 2 * math.degrees(math.atan(entry.sensor_width_mm / 2 / entry.focal_mm))
    assert entry.hfov_deg == pytest.approx(ideal, abs=4.0)  # phone lenses are focused by moving, and distort a little


@EVERY
def test_the_still_shows_at_least_the_video(name: str) -> None:
    entry = camera(name)
    assert entry.still.width >= entry.video.width
    assert entry.still.height / entry.still.width >= entry.video.height / entry.video.width - 1e-12


@EVERY
def test_the_camera_fits_a_rig(name: str) -> None:
    entry = camera(name)
    assert entry.camera.hfov_deg == entry.hfov_deg
    assert entry.camera.pupil_diameter_mm == pytest.approx(entry.focal_mm / entry.f_number, abs=0.0005)


@pytest.mark.parametrize(
    ("name", "rig"), [("oak-1", "oak-1"), ("pi-camera-v2", "pi-camera-v2"), ("aps-c-35mm", "dslr-35mm")]
)
def test_the_cameras_of_the_built_in_rigs_are_those_of_the_catalogue(name: str, rig: str) -> None:
    ours, built = camera(name), Rig.read(rig)
    assert ours.hfov_deg == built.camera.hfov_deg
    assert ours.pupil_to_prism_mm == built.prism.pupil_to_prism_mm
    assert ours.camera.pupil_diameter_mm == pytest.approx(built.camera.pupil_diameter_mm, abs=0.03)
    assert ours.video == built.camera.video
    assert ours.still == built.camera.still


def test_an_unknown_camera_is_answered_with_the_names() -> None:
    with pytest.raises(UsageError, match=r"no camera 'brownie'.*oak-1, .*aps-c-50mm"):
        camera("brownie")
