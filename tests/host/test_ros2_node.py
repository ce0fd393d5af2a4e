from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import pytest
import yaml

from host.counting import IDENTITY
from host.export_frames import WALL_MM, flat_calibration, frame_of, painted
from host.fake_ros import SENSOR_DATA, Durability, Graph, Reliability
from prismstereo.driver import StereoCamera
from prismstereo.export.ros_messages import FrameNames
from prismstereo_calibration import flash
from prismstereo_calibration.rectification import rectification
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import ObjectNumber, Progress, WriteStatus
from prismstereo_device.protocol import Capability, Command, CommandReply, CommandStatus, calibration_hash
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import Service
from prismstereo_device.source import ProducedFrame
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.rig import Rig

pytest.importorskip("rosbags", reason="it knows ROS's message definitions: pip install 'prismstereo[ros]'")
ROS2 = Path(__file__).parents[2] / "host" / "ros2"
SETTINGS: list[dict[str, Any]] = [
    {"name": "exposure_us", "kind": "number", "automatic": True, "unit": "us", "least": 10.0, "most": 30000.0},
    {
        "name": "lens_position",
        "kind": "whole",
        "automatic": False,
        "least": 0,
        "most": 255,
        "unavailable": "fixed focus",
    },
    {"name": "bound", "kind": "choice", "automatic": True, "unit": "1/16 px", "choices": [0, 1, 2, 4]},
    {"name": "zones", "kind": "switch", "automatic": False, "about": "the nearest distance of each zone"},
]


class Settings:
    """A camera's settings, of which one cannot be what a test wishes."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {"exposure_us": "auto", "bound": "auto", "zones": False}

    def answer(self, command: Command) -> CommandReply:
        if command.verb == "set":
            if command.value == 4:
                return CommandReply(CommandStatus.REFUSED, why="bound 4: this line carries less")
            self.values[command.name] = command.value
        return CommandReply(CommandStatus.OK, self.values[command.name])


class Shelf(FixedObjects):
    """Objects, of which the calibration can be written."""

    written = b""

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        del obj, size, sha256
        return Progress(WriteStatus.OK, 0)

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        del obj
        self.written = self.written[:offset] + data
        return Progress(WriteStatus.OK, len(self.written))

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        del obj, sha256
        return Progress(WriteStatus.OK, size)


class Wall:
    """A camera before a wall: frames with pictures, raw frames and zones."""

    def __init__(self, content: bytes, raw: Any) -> None:
        calibration = flash.unpack(content)
        self._named = calibration_hash(content)
        self._disparity = frame_of(calibration).disparity
        self._left = painted(rectification(calibration))[..., 0]
        self._raw = raw
        self._frames = iter(range(40))

    def read(self) -> ProducedFrame | None:
        index = next(self._frames, None)
        if index is None:
            return None
        nearest_mm = np.array([[700, 0, 65535, 900], [800, 0, 0, 500]], np.uint16)
        zones = ZoneDistances(index, 1000 * index, nearest_mm)
        extras = {"preview": self._left, "raw": self._raw, "zones": zones}
        return ProducedFrame(index, 1000 * index, None, self._disparity, self._named, **extras)


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    found = Graph()
    found.install(monkeypatch)
    monkeypatch.syspath_prepend(str(ROS2))
    return found


@pytest.fixture(scope="module")
def content(small: Rig) -> bytes:
    return flash.pack(flat_calibration(small))


class World:
    """A graph, a camera in it, and what the camera was told."""

    def __init__(self, graph: Graph, content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
        self.graph = graph
        self.settings = Settings()
        identity = msgspec.json.encode({"serial": "1", "settings": SETTINGS})
        self.shelf = Shelf({ObjectNumber.CALIBRATION: content, ObjectNumber.IDENTITY: identity})
        self.calibration = flash.unpack(content)
        raw = np.zeros((self.calibration.frame_height, self.calibration.frame_width), np.uint8)
        raw[:, raw.shape[1] // 2 :] = 200
        device, host = loopback()
        how = {"objects": self.shelf, "commands": self.settings, "offers": Capability.WRITE}
        self.service = Service(Wall(content, raw), device, IDENTITY, lossless=True, **how)
        import prismstereo_ros.node as node

        self._node = node
        self.opened: list[str | None] = []

        def opened(target: str | None) -> StereoCamera:
            self.opened.append(target)
            return StereoCamera(host)

        monkeypatch.setattr(node, "open_camera", opened)

    def run(self) -> int:
        with self.service:
            return int(self._node.main([]))


@pytest.fixture
def world(graph: Graph, content: bytes, monkeypatch: pytest.MonkeyPatch) -> World:
    return World(graph, content, monkeypatch)


def test_what_the_camera_sends_becomes_topics(world: World) -> None:
    graph = world.graph
    topics = [
        "/prismstereo/left/image_rect", "/prismstereo/left/camera_info", "/prismstereo/right/camera_info",
        "/prismstereo/disparity", "/prismstereo/depth", "/prismstereo/points2", "/prismstereo/scan",
        "/prismstereo/left/image_raw", "/prismstereo/right/image_raw", "/tf_static", "/diagnostics",
    ]  # fmt: skip

    def spin() -> None:
        graph.wait_for(*topics[:-1])
        graph.timers[0]()

    graph.spin = spin

    assert world.run() == 0

    assert not graph.problems
    assert graph.destroyed
    assert not graph.up
    assert sorted(graph.messages) == sorted(topics)
    assert world.opened == [None]
    disparity, right = graph.messages["/prismstereo/disparity"][0], graph.messages["/prismstereo/right/camera_info"][0]
    d = np.frombuffer(disparity.image.data, "<f4")
    assert np.median(disparity.f * disparity.t / d[d > 0]) == pytest.approx(WALL_MM / 1000, rel=2e-3)
    assert right.p[3] == pytest.approx(-disparity.f * disparity.t, rel=1e-6)
    left, other = (graph.messages[f"/prismstereo/{side}/image_raw"][0] for side in ("left", "right"))
    assert (set(left.data), set(other.data)) == ({200}, {0})  # behind a prism the right half is the left view
    assert len(graph.messages["/tf_static"]) == 1
    status = graph.messages["/diagnostics"][0].status[0]
    assert status.hardware_id == b"serial-1".hex()
    assert {"frames", "lost frames", "round trip us"} <= {value.key for value in status.values}


def test_topics_have_the_qos_that_ros_users_expect(world: World) -> None:
    world.graph.spin = lambda: world.graph.wait_for("/tf_static")

    world.run()

    qos = world.graph.qos
    assert qos["/prismstereo/points2"] == qos["/prismstereo/left/image_rect"] == SENSOR_DATA
    assert (qos["/tf_static"].durability, qos["/tf_static"].reliability) == (
        Durability.TRANSIENT_LOCAL,
        Reliability.RELIABLE,
    )


def test_nothing_is_computed_for_topics_that_nobody_listens_to(world: World) -> None:
    world.graph.deaf |= {
        f"/prismstereo/{name}" for name in ("points2", "depth", "left/image_raw", "right/image_raw", "scan")
    }
    world.graph.spin = lambda: world.graph.wait_for("/prismstereo/disparity")

    world.run()

    assert not any(world.graph.messages[topic] for topic in world.graph.deaf)


def test_stamps_are_ros_time_of_the_exposure_and_not_of_the_arrival(world: World) -> None:
    world.graph.spin = lambda: world.graph.wait_for("/prismstereo/depth")

    world.run()

    stamp = world.graph.messages["/prismstereo/depth"][0].header.stamp
    behind_s = world.graph.now_ns / 1e9 - (stamp.sec + stamp.nanosec / 1e9)
    assert behind_s >= 0  # this camera's stamps begin with its clock, long ago


def test_a_urdf_may_publish_the_frames_instead(world: World) -> None:
    world.graph.arguments |= {"publish_tf": False, "port": "tcp:camera:5000"}
    world.graph.spin = lambda: world.graph.wait_for("/prismstereo/depth")

    world.run()

    assert world.graph.messages["/tf_static"] == []
    assert world.opened == ["tcp:camera:5000"]


def test_settings_are_parameters_with_their_ranges_and_units(world: World) -> None:
    world.run()

    parameters = world.graph.parameters
    assert set(parameters) == {"port", "depth_encoding", "publish_tf", "exposure_us", "bound", "zones"}
    value, exposure = parameters["exposure_us"]
    assert value == "auto"
    assert exposure.dynamic_typing
    assert (exposure.floating_point_range[0].from_value, exposure.floating_point_range[0].to_value) == (10.0, 30000.0)
    assert exposure.description == "[us]"
    assert parameters["bound"][1].additional_constraints == "one of 0, 1, 2, 4 or auto"
    assert parameters["zones"][0] is False
    assert not parameters["zones"][1].dynamic_typing
    assert parameters["port"][1].read_only


def test_setting_a_parameter_sets_the_camera_and_a_refused_one_leaves_all_as_it_was(world: World) -> None:
    answers = []

    def spin() -> None:
        assert world.graph.setting is not None
        for wishes in ({"exposure_us": 8000}, {"zones": True, "bound": 4}):
            answers.append(world.graph.setting([SimpleNamespace(name=name, value=wishes[name]) for name in wishes]))

    world.graph.spin = spin
    world.run()

    good, bad = answers
    assert (good.successful, bad.successful) == (True, False)
    assert "this line carries less" in bad.reason
    assert world.settings.values == {"exposure_us": 8000.0, "bound": "auto", "zones": False}


def test_both_camera_infos_together_become_the_cameras_calibration(world: World, small: Rig) -> None:
    answers = []
    infos: dict[str, Any] = {}

    def spin() -> None:
        world.graph.wait_for("/prismstereo/left/camera_info", "/prismstereo/right/camera_info")
        smaller = SimpleNamespace(camera_info=SimpleNamespace(width=64, height=48))
        response = SimpleNamespace(success=True, status_message="")
        answers.append(world.graph.services["/prismstereo/left/set_camera_info"](smaller, response))
        for side in ("left", "right"):
            infos[side] = world.graph.messages[f"/prismstereo/{side}/camera_info"][0]
            request = SimpleNamespace(camera_info=infos[side])
            response = SimpleNamespace(success=False, status_message="")
            answers.append(world.graph.services[f"/prismstereo/{side}/set_camera_info"](request, response))

    world.graph.spin = spin
    world.run()

    assert [answer.success for answer in answers] == [False, True, True]
    assert "right/set_camera_info" in answers[1].status_message
    assert "160x180" in answers[0].status_message
    written = flash.unpack(world.shelf.written)
    present = world.calibration
    assert written.views == present.views
    np.testing.assert_allclose(written.right.t_camera_from_left, present.right.t_camera_from_left, atol=1e-6)
    np.testing.assert_allclose(written.right.R_camera_from_left, present.right.R_camera_from_left, atol=1e-9)
    assert written.left.lens.fx_px == pytest.approx(present.left.lens.fx_px)


def test_the_scan_points_at_the_zones(content: bytes) -> None:
    from prismstereo.export.ros_scan import laser_scan

    geometry = frame_of(flash.unpack(content)).geometry
    zones = ZoneDistances(0, 0, np.array([[700, 0, 65535, 900], [800, 0, 0, 500]], np.uint16))

    scan = laser_scan(zones, geometry, 0, FrameNames().link, 0.1).fields

    ranges = scan["ranges"]
    assert isinstance(ranges, np.ndarray)
    angles = float(str(scan["angle_min"])) + float(str(scan["angle_increment"])) * np.arange(len(ranges))
    assert scan["angle_max"] == pytest.approx(angles[-1])
    ahead = ranges * np.cos(angles)
    columns = ((geometry.cx_px - geometry.focal_px * np.tan(angles)) + 0.5) // (geometry.width / 4)
    for column, expected in enumerate((0.7, np.nan, np.inf, 0.5)):  # left to right in the picture
        found = ahead[columns == column]
        assert len(found) >= 3
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert angles[0] < angles[-1]  # anticlockwise: the right border comes first
    assert columns[0] == 3


def test_diagnostics_judge_the_line(content: bytes) -> None:
    from prismstereo.driver import CameraStatistics
    from prismstereo.events import CameraState
    from prismstereo.export.ros_diagnostics import Level, diagnostic_array
    from prismstereo_device.framing import LineStatistics

    def judged(state: CameraState, frames: int, lost: int) -> tuple[int, str]:
        before, now = (
            CameraStatistics(f, 0, gone, 0, 0, LineStatistics(), None, None)
            for f, gone in ((100, 0), (100 + frames, lost))
        )
        array = diagnostic_array("eye", "id", state, now, before, stamp_ns=0, period_s=1.0)
        statuses = array.fields["status"]
        assert isinstance(statuses, tuple)
        fields: Any = statuses[0].fields
        return fields["level"].value, fields["message"]

    assert judged(CameraState.CONNECTED, 30, 0) == (Level.OK, "30.0 frames a second")
    assert judged(CameraState.CONNECTED, 0, 0)[0] == Level.STALE
    assert judged(CameraState.CONNECTED, 15, 15) == (
        Level.WARN,
        "50 % of the frames are lost or lack stripes: the line is slow, or disturbed",
    )
    assert judged(CameraState.SEARCHING, 0, 0)[0] == Level.ERROR


def test_without_ros_the_refusal_names_a_remedy_that_works(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(ROS2))
    monkeypatch.setitem(sys.modules, "rclpy", None)
    from prismstereo_ros.node import main

    assert main([]) == 2

    complaint = capsys.readouterr().err
    assert "source your ROS 2 distribution" in complaint
    assert "pip install" not in complaint


def test_the_package_names_everything_that_it_imports_and_holds() -> None:
    package = ET.parse(ROS2 / "package.xml").getroot()
    needed = {element.text for element in package.findall("exec_depend")}
    kinds = set[str]()
    for folder in (ROS2 / "prismstereo_ros", ROS2.parent / "prismstereo" / "export"):
        for file in folder.glob("*.py"):
            kinds |= set(re.findall(r'"(\w+)/(?:msg|srv)/\w+"', file.read_text()))
    assert kinds
    assert kinds | {"rclpy", "rcl_interfaces"} <= needed
    setup = (ROS2 / "setup.py").read_text()
    for file in re.findall(r'"((?:launch|rviz|resource)/[^"{]+)"', setup):
        assert (ROS2 / file).is_file(), file
    assert (ROS2 / "resource" / "prismstereo_ros").is_file()
    version = tomllib.loads((ROS2.parents[1] / "pyproject.toml").read_text())["project"]["version"]
    assert package.findtext("version") == version
    assert f'version="{version}"' in setup


def test_the_rviz_window_shows_topics_and_frames_that_the_node_publishes(world: World) -> None:
    world.run()

    shown = yaml.safe_load((ROS2 / "rviz" / "prismstereo.rviz").read_text())["Visualization Manager"]

    topics = {display["Topic"]["Value"] for display in shown["Displays"] if "Topic" in display}
    assert topics
    assert topics <= set(world.graph.qos)
    assert shown["Global Options"]["Fixed Frame"] == FrameNames().link


@contextmanager
def _launch_modules(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[dict[str, Any]]]:
    """Stand-ins for ROS's launch packages, that note which nodes are made."""
    from types import ModuleType

    made: list[dict[str, Any]] = []
    content: dict[str, dict[str, Any]] = {
        "ament_index_python.packages": {"get_package_share_directory": lambda name: f"/share/{name}"},
        "launch": {"LaunchDescription": lambda parts: parts},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, default_value, description: (name, default_value),
            "OpaqueFunction": lambda function: function,
        },
        "launch.substitutions": {
            "LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda context: context[name])
        },
        "launch_ros.actions": {"Node": lambda **how: made.append(how)},
    }
    for name in ("ament_index_python", "launch_ros", *content):
        module = ModuleType(name)
        module.__path__ = []
        vars(module).update(content.get(name, {}))
        monkeypatch.setitem(sys.modules, name, module)
    yield made


def test_the_launch_file_leaves_the_frames_to_a_urdf_and_finds_its_mesh(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "eye.urdf").write_text('<robot><mesh filename="meshes/mount.stl"/></robot>')
    file = ROS2 / "launch" / "prismstereo.launch.py"
    with _launch_modules(monkeypatch) as made:
        space: dict[str, Any] = {}
        exec(compile(file.read_text(), str(file), "exec"), space)
        *arguments, start = space["generate_launch_description"]()
        start({**dict(arguments), "urdf": str(tmp_path / "eye.urdf"), "name": "eye", "rviz": "true"})

    node, publisher, window = made
    assert (node["package"], node["name"]) == ("prismstereo_ros", "eye")
    assert node["parameters"][0]["publish_tf"] is False
    assert f'filename="file://{tmp_path}/meshes/mount.stl"' in publisher["parameters"][0]["robot_description"]
    assert window["arguments"] == ["-d", "/share/prismstereo_ros/rviz/prismstereo.rviz"]
