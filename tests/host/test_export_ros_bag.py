from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from host.export_frames import WALL_MM, flat_calibration, frame_of, painted, pinhole_points_m, wall
from prismstereo.export.frames import ExportFrame
from prismstereo.export.ros_bag import write_bag
from prismstereo.export.ros_messages import FrameNames
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import RangeWish, Rig

pytest.importorskip("rosbags", reason="the reader of ROS 2 bags: pip install 'prismstereo[ros]'")
NAMES = FrameNames("eye")
LEFT = "eye_left_optical_frame"


@pytest.fixture(scope="module", params=["to infinity", "to 3 m"])
def flat(small: Rig, request: pytest.FixtureRequest) -> Calibration:
    """A calibration whose window has its offset at -1, and one far from there."""
    from dataclasses import replace

    made = flat_calibration(small)
    return (
        made
        if request.param == "to infinity"
        else replace(made, range=RangeWish(near_mm=500.0, far_mm=3000.0, labels=64))
    )


@pytest.fixture(scope="module")
def made(flat: Calibration) -> Rectification:
    return rectification(flat)


@pytest.fixture(scope="module")
def bag(flat: Calibration, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    folder = tmp_path_factory.mktemp("ros") / "bag"
    frames = [frame_of(flat, index=index, timestamp_ns=index * 100_000_000) for index in range(2)]
    assert write_bag(folder, frames, names=NAMES, depth="32FC1") == 2
    return read(folder)


def read(folder: Path) -> dict[str, list[Any]]:
    """All messages of a bag by topic, as the independent reader sees them."""
    from rosbags.highlevel import AnyReader

    found: dict[str, list[Any]] = {}
    with AnyReader([folder]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


def floats(message: Any) -> NDArray[np.float64]:
    """The pixels of a 32FC1 image."""
    assert (message.encoding, message.step, message.is_bigendian) == ("32FC1", 4 * message.width, 0)
    return message.data.view("<f4").reshape(message.height, message.width).astype(float)


def test_disparity_is_positive_and_depth_is_f_t_over_d_to_a_millionth(
    bag: dict[str, list[Any]], made: Rectification
) -> None:
    message = bag["/eye/disparity"][0]

    d = floats(message.image)

    matched = np.isfinite(wall(made))
    np.testing.assert_allclose(message.f * message.t / d[matched], WALL_MM / 1000, rtol=1e-6)
    assert message.t == pytest.approx(made.window.scale_px / made.focal_px / 1000, rel=1e-6)
    assert d.min() == 0.0
    assert (d[~matched] < message.min_disparity).all()
    assert 0 < message.min_disparity < d[matched].min() <= d.max() < message.max_disparity
    assert message.delta_d == 1 / 16
    assert message.header.frame_id == message.image.header.frame_id == LEFT


def test_the_right_camera_info_says_the_baseline_and_both_stand_in_the_left_frame(
    bag: dict[str, list[Any]], made: Rectification
) -> None:
    left, right = bag["/eye/left/camera_info"][0], bag["/eye/right/camera_info"][0]

    baseline_m = made.window.scale_px / made.focal_px / 1000
    assert right.p[3] == pytest.approx(-made.focal_px * baseline_m, rel=1e-9)
    assert left.p[3] == 0
    assert left.p[0] == left.p[5] == right.p[0] == made.focal_px
    assert left.p[2] - right.p[2] == pytest.approx(-made.window.offset_px)
    assert left.header.frame_id == right.header.frame_id == LEFT
    assert (left.width, left.height) == (right.width, right.height) == (made.width, made.height)
    np.testing.assert_allclose(left.r.reshape(3, 3) @ left.r.reshape(3, 3).T, np.eye(3), atol=1e-12)


def test_both_camera_infos_take_raw_points_of_the_scene_to_rectified_ones(
    bag: dict[str, list[Any]], flat: Calibration, made: Rectification
) -> None:
    point = np.array([35.0, -20.0, 900.0])  # mm, of the left camera
    infos = bag["/eye/left/camera_info"][0], bag["/eye/right/camera_info"][0]

    for info, camera, side in zip(infos, (flat.left, flat.right), (made.left, made.right), strict=True):
        own = camera.R_camera_from_left @ point + camera.t_camera_from_left
        turned = info.r.reshape(3, 3) @ own  # a ray of the raw camera, by ROS's rule
        by_ros = info.p.reshape(3, 4)[:, :3] @ turned
        view = camera.project(point[None])
        np.testing.assert_allclose(by_ros[:2] / by_ros[2], made.rectify(view, side)[0], atol=1e-5)


def test_points_are_the_pinholes_and_carry_their_colours(
    bag: dict[str, list[Any]], flat: Calibration, made: Rectification
) -> None:
    message = bag["/eye/points2"][0]
    kinds = [(field.name, field.offset, field.datatype) for field in message.fields]
    assert kinds == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 7)]

    rows = message.data.view("<f4").reshape(-1, 4)

    np.testing.assert_allclose(rows[:, :3], pinhole_points_m(flat, wall(made)), rtol=1e-6, atol=1e-7)
    assert message.width * message.point_step == message.row_step == len(message.data)
    blue_green_red = message.data.reshape(-1, 16)[:, 12:15]
    np.testing.assert_array_equal(blue_green_red, painted(made)[20:].reshape(-1, 3))


def test_the_cloud_the_disparity_and_the_depth_tell_of_the_same_points(
    bag: dict[str, list[Any]], made: Rectification
) -> None:
    disparity, info = bag["/eye/disparity"][0], bag["/eye/left/camera_info"][0]
    P, d = info.p.reshape(3, 4), floats(disparity.image)
    rows, columns = np.nonzero(d)
    z = disparity.f * disparity.t / d[rows, columns]
    by_ros = np.stack([(columns - P[0, 2]) * z / P[0, 0], (rows - P[1, 2]) * z / P[1, 1], z], axis=-1)

    points = bag["/eye/points2"][0].data.view("<f4").reshape(-1, 4)[:, :3]
    depth = floats(bag["/eye/depth"][0])

    np.testing.assert_allclose(points, by_ros, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(depth[rows, columns], z, rtol=1e-6)
    assert np.isnan(depth[:20]).all()


def test_frames_are_those_of_rep_103_and_wait_for_late_comers(
    flat: Calibration, made: Rectification, tmp_path: Path
) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import QosDurability

    write_bag(tmp_path / "bag", [frame_of(flat)], names=NAMES)
    with AnyReader([tmp_path / "bag"]) as reader:
        (static,) = (one for one in reader.connections if one.topic == "/tf_static")
        assert [qos.durability for qos in static.ext.offered_qos_profiles] == [QosDurability.TRANSIENT_LOCAL]
    (message,) = read(tmp_path / "bag")["/tf_static"]
    left, right = message.transforms

    for transform in (left, right):
        turn = _matrix(transform.transform.rotation)
        np.testing.assert_allclose(turn @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # optical ahead is body x
        np.testing.assert_allclose(turn @ [1, 0, 0], [0, -1, 0], atol=1e-12)  # to the right is -y
        np.testing.assert_allclose(turn @ [0, 1, 0], [0, 0, -1], atol=1e-12)  # down is -z
        assert transform.header.frame_id == "eye_link"
    assert (left.child_frame_id, right.child_frame_id) == (LEFT, "eye_right_optical_frame")
    assert left.transform.translation.y == 0
    assert right.transform.translation.y == pytest.approx(-made.window.scale_px / made.focal_px / 1000, rel=1e-9)


def _matrix(q: Any) -> NDArray[np.float64]:
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_a_clock_that_begins_at_zero_is_moved_because_ros_takes_zero_for_the_latest(bag: dict[str, list[Any]]) -> None:
    stamps = [message.header.stamp for message in bag["/eye/depth"]]

    assert [(stamp.sec, stamp.nanosec) for stamp in stamps] == [(1, 0), (1, 100_000_000)]


def test_the_left_picture_is_grey_and_depth_is_whole_millimetres_unless_asked_otherwise(
    flat: Calibration, made: Rectification, tmp_path: Path
) -> None:
    write_bag(tmp_path / "bag", [frame_of(flat)], names=NAMES)

    found = read(tmp_path / "bag")

    picture, depth = found["/eye/left/image_rect"][0], found["/eye/depth"][0]
    assert (picture.encoding, picture.step, len(picture.data)) == ("mono8", made.width, made.width * made.height)
    assert depth.encoding == "16UC1"
    millimetres = depth.data.view("<u2").reshape(depth.height, depth.width)
    assert set(millimetres[:20].ravel()) == {0}
    assert set(millimetres[20:].ravel()) == {800}


def test_a_frame_without_a_picture_has_no_picture_topic(flat: Calibration, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", [frame_of(flat, picture=False)], names=NAMES)

    found = read(tmp_path / "bag")

    assert "/eye/left/image_rect" not in found
    assert not found["/eye/points2"][0].data.reshape(-1, 16)[:, 12:].any()


def test_a_bag_is_whole_or_not_there(flat: Calibration, tmp_path: Path) -> None:
    def broken() -> Iterator[ExportFrame]:
        yield frame_of(flat)
        raise DataError("the recording ends in the middle")

    for frames, said in ((broken(), "in the middle"), (iter(()), "no frames")):
        with pytest.raises(DataError, match=said):
            write_bag(tmp_path / "bag", frames, names=NAMES)
        assert list(tmp_path.iterdir()) == []
    (tmp_path / "bag").mkdir()
    with pytest.raises(UsageError, match="exists already"):
        write_bag(tmp_path / "bag", [frame_of(flat)], names=NAMES)


def test_without_the_package_the_refusal_names_the_extra(
    flat: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)

    with pytest.raises(UsageError, match=r"'rosbags'.*prismstereo\[ros\]"):
        write_bag(tmp_path / "bag", [frame_of(flat)], names=NAMES)
