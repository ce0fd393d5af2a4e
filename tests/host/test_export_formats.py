from __future__ import annotations

import sys
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from host.export_frames import WALL_MM, flat_calibration, frame_of, painted, pinhole_points_m, wall
from prismstereo.export.film import write_film
from prismstereo.export.formats import Wishes, export
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.export.las import las_bytes
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.files import read_depth_png, read_picture
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def flat(small: Rig) -> Calibration:
    return flat_calibration(small)


@pytest.mark.parametrize("name", ["las", "laz"])
def test_las_files_hold_the_points_in_metres_with_z_up(flat: Calibration, name: str, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy", reason="reader of LAS: pip install 'prismstereo[las]'")
    made = rectification(flat)

    written = export(name, tmp_path / f"wall.{name}", [frame_of(flat)], Wishes())

    found = laspy.read(tmp_path / f"wall.{name}")
    x, y, z = pinhole_points_m(flat, wall(made)).T
    np.testing.assert_allclose(found.xyz, np.stack([x, z, -y], axis=-1), atol=6e-6)
    colours = np.stack([found.red, found.green, found.blue], axis=-1)
    np.testing.assert_array_equal(colours, 257 * painted(made)[20:].reshape(-1, 3)[:, ::-1].astype(int))
    assert written.points == len(found.points) == np.isfinite(wall(made)).sum()


def test_las_reaches_as_far_as_the_points_do_and_may_be_empty() -> None:
    laspy = pytest.importorskip("laspy", reason="reader of LAS: pip install 'prismstereo[las]'")
    import io

    far = laspy.read(io.BytesIO(las_bytes(np.array([[0, 0, 1e5], [1, 2, 3]], np.float32))))
    none = laspy.read(io.BytesIO(las_bytes(np.zeros((0, 3), np.float32))))

    np.testing.assert_allclose(far.xyz, [[0, 1e5, 0], [1, 3, -2]], atol=1e-4)
    assert len(none.points) == 0


def test_without_the_package_the_refusal_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)

    with pytest.raises(UsageError, match=r"'laspy'.*prismstereo\[las\]"):
        las_bytes(np.zeros((1, 3), np.float32))


def test_depth_can_be_made_of_a_png_and_its_list_alone(flat: Calibration, tmp_path: Path) -> None:
    frames = [frame_of(flat, index=3, timestamp_ns=7), frame_of(flat, index=4, picture=False)]

    written = export("png16", tmp_path, frames, Wishes())

    listed = msgspec.json.decode((tmp_path / "frames.json").read_bytes())
    assert written.frames == len(listed["frames"]) == 2
    first, second = listed["frames"]
    steps = read_depth_png(tmp_path / first["disparity"])
    disparity_px = steps[20:] / 16
    depth = first["focal_px"] * first["baseline"] / (disparity_px + first["offset_px"])
    np.testing.assert_allclose(depth, WALL_MM, rtol=1 / 32 / disparity_px.min())  # half a step
    assert not steps[:20].any()
    assert (first["index"], first["timestamp_ns"], first["unit"]) == (3, 7, "mm")
    np.testing.assert_array_equal(read_picture(tmp_path / first["left"]), painted(rectification(flat)))
    assert second["left"] is None


def test_what_glass_does_is_taken_off_the_png(small: Rig, tmp_path: Path) -> None:
    behind_glass = Calibration.nominal(small)
    frame = frame_of(behind_glass)

    export("png16", tmp_path, [frame], Wishes())

    told = msgspec.json.decode((tmp_path / "frames.json").read_bytes())["frames"][0]
    steps = read_depth_png(tmp_path / told["disparity"])[20:]
    true_px = told["focal_px"] * told["baseline"] / frame.depth[20:]
    np.testing.assert_allclose(steps / 16 + told["offset_px"], true_px, atol=1 / 32 + 1e-4)  # half a step
    assert np.abs(frame.disparity.disparity_px[20:] + told["offset_px"] - true_px).max() > 0.05  # the glass is worth it


@pytest.mark.parametrize("ending", ["mp4", "avi"])
def test_a_film_has_every_frame_at_the_rate_of_their_stamps(flat: Calibration, tmp_path: Path, ending: str) -> None:
    frames = [frame_of(flat, index=index, timestamp_ns=index * 50_000_000) for index in range(14)]
    path = tmp_path / f"depth.{ending}"

    assert write_film(path, frames) == (14, 20.0)

    film = cv2.VideoCapture(str(path))
    pictures = []
    while (read := film.read())[0]:
        pictures.append(read[1])
    assert len(pictures) == 14
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    film.release()
    made = rectification(flat)
    left, depth = pictures[0][:, : made.width], pictures[0][:, made.width : 2 * made.width]
    assert np.median(np.abs(left.astype(int) - painted(made))) < 12
    assert depth[:15].max() < 40  # unmatched is black
    assert depth[40:, 20:-20].max(axis=2).min() > 45  # the wall is not
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_the_colours_of_a_film_mean_one_distance_throughout(flat: Calibration, tmp_path: Path) -> None:
    made = rectification(flat)
    near_and_far = wall(made)
    near_and_far[:, 80:] = 1600.0
    near_and_far[:20] = np.nan
    far = wall(made, 1600.0)
    frames = [frame_of(flat, near_and_far), frame_of(flat, far)]

    write_film(tmp_path / "depth.avi", frames)

    film = cv2.VideoCapture(str(tmp_path / "depth.avi"))
    first, second = (film.read()[1] for _ in range(2))
    film.release()
    at = np.s_[60:100, made.width + 100 : made.width + 140]
    np.testing.assert_allclose(first[at].mean(axis=(0, 1)), second[at].mean(axis=(0, 1)), atol=6)


def test_a_film_keeps_its_size_through_half_resolution_and_missing_pictures(flat: Calibration, tmp_path: Path) -> None:
    large = frame_of(flat)
    small_map = DisparityMap(large.disparity.disparity_px[::2, ::2] / 2, _halved(large.disparity.window))
    small = ExportFrame.of(1, 5_050_000_000, small_map, None, Geometries(flat))

    assert write_film(tmp_path / "depth.avi", [large, small, large])[0] == 3

    film = cv2.VideoCapture(str(tmp_path / "depth.avi"))
    first, second, _ = (film.read()[1] for _ in range(3))
    film.release()
    at = np.s_[40:160, :300]  # the last picture stands, and depth has its colours
    assert np.median(np.abs(first[at].astype(int) - second[at])) <= 8


def _halved(window: DisparityWindow) -> DisparityWindow:
    return DisparityWindow((window.labels - 2) // 2 + 2, window.offset_px / 2, window.scale_px / 2)


def test_a_film_of_nothing_and_one_of_another_ending_are_refused(flat: Calibration, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no frames"):
        write_film(tmp_path / "depth.mp4", [])
    with pytest.raises(UsageError, match=r"\.mp4 or \.avi"):
        write_film(tmp_path / "depth.mkv", [frame_of(flat)])


def test_one_file_holds_one_frame_and_a_folder_holds_many(flat: Calibration, tmp_path: Path) -> None:
    frames = [frame_of(flat, index=index) for index in (5, 6)]

    written = export("ply", tmp_path / "out", frames, Wishes())

    assert [path.name for path in written.paths] == ["000005.ply", "000006.ply"]
    with pytest.raises(DataError, match="holds one frame"):
        export("ply", tmp_path / "one.ply", frames, Wishes())
    with pytest.raises(DataError, match="no frames"):
        export("ply", tmp_path / "none", [], Wishes())
