"""OAK cameras, the part that needs no depthai: what can be asked of them, the mesh, and what their numbers mean."""

from __future__ import annotations

from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.rectify import Rectifier
from prismstereo_device.sensors.oak.mesh import ViewMesh
from prismstereo_device.sensors.oak.on_device_stereo import StereoPlan
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_device.sensors.oak.stereo_settings import StereoSettings
from prismstereo_device.sensors.oak.thinning import Thinning
from prismstereo_device.split import split
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Mode, RangeWish, Rig

# ---- what is asked for


def test_an_address_names_the_camera_and_what_it_shall_give() -> None:
    options = OakOptions.parse(
        "192.168.1.20?mode=stereo&width=640&height=400&rate=15&socket=CAM_D&lens=0&bits=5&shift=32"
    )
    assert (options.device, options.mode, options.width, options.height) == ("192.168.1.20", "stereo", 640, 400)
    assert (options.rate_hz, options.socket, options.lens) == (15.0, "CAM_D", 0)
    assert options.stereo == StereoSettings(bits=5, shift_px=32)


def test_without_options_the_first_camera_captures_whole_frames_with_stills() -> None:
    assert OakOptions.parse("") == OakOptions("", "capture", 1280, 720, 30.0, "CAM_A", None, "nv12", stills=True)
    assert OakOptions.parse("", rate_hz=12.5).rate_hz == 12.5
    assert OakOptions.parse("", rate_hz=1000.0).rate_hz == 240.0
    assert OakOptions.parse("?rate=20", rate_hz=12.5).rate_hz == 12.5
    assert OakOptions.parse("?rate=20", rate_hz=60.0).rate_hz == 20.0


@pytest.mark.parametrize(
    ("argument", "complaint"),
    [
        ("?mode=depth", "mode=depth: give one of capture, stereo"),
        ("?socket=CAM_Z", "socket=CAM_Z: give one of CAM_A"),
        ("?width=641", "frames of 641x720: an OAK camera gives even numbers"),
        ("?width=99999", "width=99999: give a whole number from 32 to 8192"),
        ("?rate=1000", "rate=1000: an OAK camera gives at most 240"),
        ("?lens=256", "lens=256: give a whole number from 0 to 255"),
        ("?bits=9", "bits=9: its sub-pixels have 3, 4 or 5 fractional bits"),
        ("?bits=2", "bits=2: its sub-pixels have 3, 4 or 5"),
        ("?median=5", "median=5 with bits=4: its median filter takes 3 bits only"),
        ("?shift=20", "shift=20: give a multiple of 16 up to 128"),
        ("?shift=144", "shift=144: give a multiple of 16 up to 128"),
        ("?threshold=256", "threshold=256: give a whole number from 0 to 255"),
        ("?flash=1", "there is no option 'flash' of this sensor"),
    ],
)
def test_what_no_oak_can_do_is_refused_before_one_is_looked_for(argument: str, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        OakOptions.parse(argument)


@pytest.mark.parametrize(
    ("size", "platform", "complaint"),
    [
        ((648, 720), "RVC4", "648x720: the camera's warp takes widths in steps of 16"),
        ((640, 722), "RVC2", "640x722: the camera's warp takes .* heights in steps of 4"),
        ((1296, 720), "RVC2", "1296 pixels wide: this camera's stereo engine takes at most 1280"),
    ],
)
def test_pictures_that_the_engine_does_not_take_are_refused(
    size: tuple[int, int], platform: str, complaint: str
) -> None:
    with pytest.raises(UsageError, match=complaint):
        StereoSettings().require_picture(*size, platform)
    StereoSettings().require_picture(1280, 720, "RVC2")
    StereoSettings().require_picture(1296, 720, "RVC4")


@pytest.mark.parametrize(
    "settings", [StereoSettings(bits=3), StereoSettings(extended=True), StereoSettings(shift_px=16)]
)
def test_what_only_rvc2_can_be_set_to_is_refused_on_rvc4(settings: StereoSettings) -> None:
    settings.require_platform("RVC2")
    with pytest.raises(UsageError, match="are fixed on this camera"):
        settings.require_platform("RVC4")


# ---- what the numbers mean


def test_disparities_count_in_fractions_and_zero_is_unmatched() -> None:
    values = np.array([[0, 1, 16, 1520]], np.uint16)
    found = StereoSettings(bits=4, shift_px=32).disparity(values, DisparityWindow(128), np.ones((1, 4), bool))
    np.testing.assert_array_equal(found.disparity_px, [[np.nan, 32.0625, 33.0, 127.0]])
    assert found.confidence is None


def test_where_the_left_view_shows_nothing_no_number_is_taken() -> None:
    seen = np.array([[True, False]])
    found = StereoSettings(bits=3).disparity(
        np.array([[80, 80]], np.uint16), DisparityWindow(96), seen, np.array([[0, 200]], np.uint8)
    )
    np.testing.assert_array_equal(found.disparity_px, [[10.0, np.nan]])
    np.testing.assert_array_equal(found.confidence, [[1, 0]])  # 0 is kept for unmatched


@pytest.mark.parametrize(
    ("options", "labels", "nearest_mm"), [("", 96, 505.2), ("?extended=1", 192, 248.6), ("?shift=32", 128, 375.9)]
)
def test_the_range_ends_where_the_engines_search_does(oak: Rig, options: str, labels: int, nearest_mm: float) -> None:
    window = StereoPlan.of(Calibration.nominal(oak), OakOptions.parse(options)).made.window
    assert window.labels == labels
    assert window.offset_px == -1.0  # to infinity, as our own matcher has it
    assert window.nearest == pytest.approx(nearest_mm, abs=0.5)


def test_a_range_that_the_engine_does_not_reach_is_refused(oak: Rig) -> None:
    with pytest.raises(UsageError, match="needs 128 disparity labels, but 96 are searched"):
        StereoPlan.of(Calibration.nominal(oak), OakOptions(), RangeWish(near_mm=400.0, far_mm=np.inf, labels=128))


def test_a_calibration_of_another_size_or_focus_is_refused(oak: Rig) -> None:
    calibration = replace(Calibration.nominal(oak), lens_position=120)
    with pytest.raises(CalibrationError, match="640x400, but the calibration of 'oak-1' is for 1280x720"):
        StereoPlan.of(calibration, OakOptions(width=640, height=400))
    plan = StereoPlan.of(calibration, OakOptions())
    plan.require_camera("RVC2", None)
    with pytest.raises(
        CalibrationError, match="locked at 130, but the calibration of 'oak-1' is for 120: give lens=120"
    ):
        plan.require_camera("RVC2", 130)


# ---- the mesh


def misses_px(rig: str) -> tuple[float, float]:
    """How far mesh and rectification lie apart at most, at the nodes and between them."""
    made = rectification(Calibration.nominal(Rig.read(rig)))
    at_nodes = between = 0.0
    for side in (made.left, made.right):
        mesh, ours = ViewMesh.of(made, side), made.sources(side)
        assert (mesh.columns, mesh.rows) == (made.width // 16 + 1, made.height // 16 + 1)
        missed = np.abs(mesh.nodes[:-1, :-1] - ours[::16, ::16])
        assert np.isfinite(missed).mean() > 0.75
        at_nodes = max(at_nodes, float(np.nanmax(missed)))
        between = max(between, float(np.nanmax(np.abs(mesh.dense() - ours))))
    return at_nodes, between


def test_the_mesh_is_our_rectification_at_its_nodes_and_within_three_hundredths_of_a_pixel_between() -> None:
    at_nodes, between = misses_px("oak-1")
    assert at_nodes < 1e-3
    assert between < 0.03


@pytest.mark.soak
@pytest.mark.parametrize("rig", ["dslr-35mm", "pi-camera-v2"])
def test_so_it_is_on_the_other_rigs(rig: str) -> None:
    _, between = misses_px(rig)
    print(f"| mesh of {rig} | {between:.4f} px at most from the rectification |")
    assert between < 0.03


@pytest.mark.parametrize(("mirrored", "turn_deg"), [(False, 0), (True, 0), (False, 180)])
def test_crop_and_mesh_do_what_split_and_rectify_do(
    oak: Rig, rng: np.random.Generator, *, mirrored: bool, turn_deg: int
) -> None:
    video = Mode(width=640, height=360, rate_hz=30.0)
    nominal = Calibration.nominal(msgspec.structs.replace(oak, camera=msgspec.structs.replace(oak.camera, video=video)))
    left, right = (msgspec.structs.replace(view, mirrored=mirrored, turn_deg=turn_deg) for view in nominal.views)
    made = rectification(replace(nominal, left_view=left, right_view=right))
    frame = RawFrame(cv2.GaussianBlur(rng.integers(0, 256, (360, 640), np.uint8), (0, 0), 3.0))
    ours = Rectifier(made).rectify(split(frame, (left, right)))
    for side, picture, seen in ((made.left, ours.left, ours.left_seen), (made.right, ours.right, ours.right_seen)):
        mesh = ViewMesh.of(made, side)
        x, y, w, h = mesh.crop
        warped = cv2.remap(frame.pixels[y : y + h, x : x + w], mesh.dense(), None, cv2.INTER_LINEAR)
        assert seen is not None
        assert np.abs(warped.astype(int) - picture)[seen].max() <= 2  # grey levels


def test_interlaced_views_cannot_be_cut_out_by_the_camera(oak: Rig) -> None:
    made = rectification(Calibration.nominal(oak))
    interlaced = replace(made.left, view=msgspec.structs.replace(made.left.view, row_step=2))
    with pytest.raises(UsageError, match=r"interlaced rows .* use mode=capture"):
        ViewMesh.of(made, interlaced)


# ---- a lower rate


@pytest.mark.parametrize(("rate_hz", "kept"), [(30.0, 60), (15.0, 30), (10.0, 20), (12.0, 24), (1.0, 2)])
def test_a_lower_rate_leaves_frames_out(rng: np.random.Generator, rate_hz: float, kept: int) -> None:
    thinning = Thinning(rate_hz)
    stamps = np.arange(60) * 1e6 / 30 + rng.uniform(-2000, 2000, 60)
    assert sum(thinning.keeps(round(stamp)) for stamp in stamps) == pytest.approx(kept, abs=1)


def test_a_clock_that_jumps_back_stops_nothing() -> None:
    thinning = Thinning(30.0)
    assert [thinning.keeps(stamp) for stamp in (10_000_000, 0, 5_000, 33_333)] == [True, True, False, True]
