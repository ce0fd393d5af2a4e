"""What others make of our files: ROS' and OpenCV's rectification, depthai, COLMAP's pixels, Kalibr's lens."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calibration.pinhole_pairs import FRAME, in_front, numbers, prism
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.convert import colmap, kalibr, luxonis, opencv, ros
from prismstereo_calibration.convert.frame_size import frame_size
from prismstereo_calibration.convert.pair import calibration_of, pair_of
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

Array = NDArray[np.float64]


def test_ros_matrices_rectify_as_we_do_and_its_disparities_give_the_depth_in_metres(tmp_path: Path) -> None:
    one, found = prism(), rectification(prism())
    left, right = written_camera_infos(tmp_path, one)
    for info, side in ((left, found.left), (right, found.right)):
        K, D, R, P = info
        columns, rows = cv2.initUndistortRectifyMap(K, D, R, P[:, :3], (640, 720), cv2.CV_32FC1)
        ours = found.sources(side)
        seen = np.isfinite(ours[..., 0])
        np.testing.assert_allclose(np.stack([columns, rows], axis=-1)[seen], ours[seen], rtol=0, atol=2e-4)
    P_left, P_right = left[3], right[3]
    assert P_right[0, 3] == pytest.approx(-P_right[0, 0] * one.baseline / 1000, rel=1e-12)
    assert P_left[0, 2] - P_right[0, 2] == pytest.approx(-found.window.offset_px)

    points = in_front(one)
    seen_at = [undistorted(info, view, camera.project(points)) for info, view, camera in
               zip((left, right), one.views, (one.left, one.right), strict=True)]  # fmt: skip
    raw = seen_at[0][:, 0] - seen_at[1][:, 0]
    adjusted = raw - (P_left[0, 2] - P_right[0, 2])  # as stereo_msgs/DisparityImage defines d
    depth_m = P_left[0, 0] * (-P_right[0, 3] / P_right[0, 0]) / adjusted
    np.testing.assert_allclose(depth_m, (points @ left[2].T)[:, 2] / 1000, rtol=1e-6)
    np.testing.assert_allclose(seen_at[0][:, 1], seen_at[1][:, 1], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.window.depth(raw.astype(np.float32)), 1000 * depth_m, rtol=1e-5)


def undistorted(info: tuple[Array, ...], view: View, pixels: Array) -> Array:
    """Rectified pixels as image_proc computes them, of pixels of the upright cut-out view."""
    K, D, R, P = info
    x, y, _, _ = view.rectangle(*FRAME)
    own = (pixels - np.array([x, y]))[:, None]
    return np.reshape(cv2.undistortPoints(own, K, D, R=R, P=P), (-1, 2))


def written_camera_infos(folder: Path, one: Calibration) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """K, D, R, P of left.yaml and right.yaml, read by a YAML reader that knows nothing of us."""
    found = []
    for name, content in ros.write(pair_of(one)).files.items():
        info = yaml.safe_load(content)
        assert (info["image_width"], info["image_height"]) == (640, 720)
        assert (info["camera_name"], info["distortion_model"]) == (name.removesuffix(".yaml"), "plumb_bob")
        parts = [info[f"{key}_matrix"] for key in ("camera", "rectification", "projection")]
        K, R, P = (np.array(part["data"], float).reshape(part["rows"], part["cols"]) for part in parts)
        found.append((K, np.array(info["distortion_coefficients"]["data"]), R, P))
    return found[0], found[1]


def test_opencv_reads_its_file_and_q_gives_the_points_of_the_left_camera(tmp_path: Path) -> None:
    one = prism()
    (tmp_path / "stereo.yml").write_bytes(opencv.write(pair_of(one)).files["stereo.yml"])
    storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_READ)
    names = ("M1", "D1", "M2", "D2", "R", "T", "R1", "R2", "P1", "P2", "Q")
    read = {name: np.asarray(storage.getNode(name).mat()) for name in names}
    assert storage.getNode("left_width").real() == 640
    assert storage.getNode("unit").string() == "mm"
    storage.release()
    assert np.ravel(read["T"]).tolist() == one.right.t_camera_from_left.tolist()
    assert read["D1"].shape == (1, 5)

    points = in_front(one)
    left, right = (
        undistorted(
            (read[f"M{n}"], np.ravel(read[f"D{n}"]), read[f"R{n}"], read[f"P{n}"]), view, camera.project(points)
        )
        for n, view, camera in zip((1, 2), one.views, (one.left, one.right), strict=True)
    )
    lifted = np.column_stack([left, left[:, 0] - right[:, 0], np.ones(len(left))]) @ read["Q"].T
    np.testing.assert_allclose(lifted[:, :3] / lifted[:, 3:] @ read["R1"], points, rtol=1e-6)


def test_opencv_files_of_its_own_sample_are_read_together_and_their_lengths_taken_as_mm(tmp_path: Path) -> None:
    one = prism()
    for name, values in (
        ("intrinsics.yml", {"M1": own_matrix(one, 0), "D1": bends(one, 0), "M2": own_matrix(one, 1), "D2": bends(one, 1)}),
        ("extrinsics.yml", {"R": one.right.R_camera_from_left, "T": one.right.t_camera_from_left[:, None]}),
    ):  # fmt: skip
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            storage.write(key, value)
        storage.release()
    pair = opencv.read([tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"])
    back = calibration_of(pair, one.views, frame_size(pair, one.views, FRAME), one.range, one.rig)
    np.testing.assert_allclose(numbers(back.left.lens), numbers(one.left.lens), rtol=1e-12)
    assert pair.assumed == ("T has no unit in this file: taken as mm",)
    with pytest.raises(UsageError, match="--frame-px"):
        frame_size(pair, one.views)


def own_matrix(one: Calibration, index: int) -> Array:
    return pair_of(one).cameras[index].lens.K


def bends(one: Calibration, index: int) -> Array:
    return np.array([[*pair_of(one).cameras[index].lens.distortion, 0.0, 0.0, 0.0]])


def test_depthai_loads_the_luxonis_file_and_finds_the_pair_in_it(tmp_path: Path) -> None:
    dai = pytest.importorskip("depthai")
    one = prism()
    (tmp_path / "eeprom.json").write_bytes(luxonis.write(pair_of(replace(one, lens_position=117))).files["eeprom.json"])
    handler = dai.CalibrationHandler(tmp_path / "eeprom.json")
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    assert (handler.getStereoLeftCameraId(), handler.getStereoRightCameraId()) == (left, right)
    assert handler.getEepromData().version == 7
    assert handler.getLensPosition(left) == 117
    pose_cm = np.array(handler.getCameraExtrinsics(left, right))
    np.testing.assert_allclose(pose_cm[:3, 3] * 10, one.right.t_camera_from_left, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(pose_cm[:3, :3], one.right.R_camera_from_left, rtol=0, atol=1e-6)
    assert handler.getBaselineDistance(right, left) * 10 == pytest.approx(one.baseline, rel=1e-6)
    for socket, camera in ((left, pair_of(one).left), (right, pair_of(one).right)):
        np.testing.assert_allclose(handler.getCameraIntrinsics(socket), camera.lens.K, rtol=1e-6, atol=1e-4)
        assert len(handler.getDistortionCoefficients(socket)) == 14
    assert handler.eepromToJsonFile(tmp_path / "again.json")
    back = luxonis.read([tmp_path / "again.json"])
    np.testing.assert_allclose(back.t_right_from_left, one.right.t_camera_from_left, rtol=1e-6, atol=1e-6)


def test_a_pose_from_right_to_left_in_metres_is_turned_round(tmp_path: Path) -> None:
    one = prism()
    content = json.loads(luxonis.write(pair_of(one)).files["eeprom.json"])
    left, right = (entry[1] for entry in content["cameraData"])
    R, t = one.right.R_camera_from_left.T, -one.right.R_camera_from_left.T @ one.right.t_camera_from_left / 1000
    part = {"rotationMatrix": R.tolist(), "translation": dict(zip("xyz", t.tolist(), strict=True)), "lengthUnit": 0}
    right["extrinsics"].update(part, toCameraSocket=1)
    left["extrinsics"]["toCameraSocket"] = -1
    (tmp_path / "eeprom.json").write_text(json.dumps(content))
    back = luxonis.read([tmp_path / "eeprom.json"])
    np.testing.assert_allclose(back.t_right_from_left, one.right.t_camera_from_left, rtol=1e-12, atol=1e-12)


def test_colmap_has_the_centre_of_a_pixel_at_a_half_and_full_opencv_where_there_is_a_k3() -> None:
    one = prism()
    text = colmap.write(pair_of(one)).files["cameras.txt"].decode().splitlines()[1].split()
    assert text[:4] == ["1", "OPENCV", "640", "720"]
    assert [float(word) for word in text[6:8]] == [645.25 - 640 + 0.5, 353.0]
    lens = replace(one.left.lens, distortion=(0.0, 0.0, 0.0, 0.0, 0.01))
    bent = replace(one, left=Camera.at_origin(lens))
    words = colmap.write(pair_of(bent)).files["cameras.txt"].decode().splitlines()[1].split()
    assert words[1] == "FULL_OPENCV"
    assert [float(word) for word in words[8:]] == [0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0]


def test_kalibr_fits_a_small_k3_away_and_refuses_one_that_is_needed() -> None:
    one = prism()
    lens = replace(one.left.lens, distortion=(0.03, -0.02, 5e-4, -3e-4, 4e-3))
    export = kalibr.write(pair_of(replace(one, left=Camera.at_origin(lens))))
    assert 1e-4 < export.residual_px < 0.05
    assert "k3 was fitted away" in export.notes[0]
    cam0 = yaml.safe_load(export.files["camchain.yaml"])["cam0"]
    fx, fy, cx, cy = cam0["intrinsics"]
    k1, k2, p1, p2 = cam0["distortion_coeffs"]
    slopes = lens.slopes(np.stack(np.meshgrid(np.linspace(640, 1279, 90), np.linspace(0, 719, 90)), axis=-1))
    theirs = Lens(fx, fy, cx + 640, cy, (k1, k2, p1, p2, 0.0)).project_slopes(slopes)
    worst = np.linalg.norm(theirs - lens.project_slopes(slopes), axis=-1).max()
    assert worst == pytest.approx(export.residual_px, rel=0.02)
    strong = replace(lens, distortion=(0.0, 0.0, 0.0, 0.0, 0.4))
    with pytest.raises(UsageError, match=r"k3 = 0\.4.*at most 0\.05 px"):
        kalibr.write(pair_of(replace(one, left=Camera.at_origin(strong))))


def test_a_real_intrinsics_file_of_opencv_is_read(data: Path, tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(tmp_path / "extrinsics.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("R", np.eye(3))
    storage.write("T", np.array([[-3.34], [0.05], [0.01]]))
    storage.release()
    pair = opencv.read([data / "calib-opencv-9x6" / "intrinsics.yml", tmp_path / "extrinsics.yml"])
    assert pair.left.size is None
    assert pair.left.lens.fx_px == pytest.approx(534.80326845)
    assert pair.right.lens.distortion[:2] == pytest.approx((-0.169163583, -0.112141736))
