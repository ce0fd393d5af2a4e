from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from host.export_frames import WALL_MM, flat_calibration
from host.fake_ros import SENSOR_DATA, Durability, Graph, Reliability
from host.ros_world import ROS2, World
from prismstereo.export.ros_messages import FrameNames
from prismstereo_calibration import flash
from prismstereo_hw.rig import Rig

pytest.importorskip("rosbags", reason="it knows ROS's message definitions: pip install 'prismstereo[ros]'")


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    found = Graph()
    found.install(monkeypatch)
    monkeypatch.syspath_prepend(str(ROS2))
    return found


@pytest.fixture(scope="module")
def content(small: Rig) -> bytes:
    return flash.pack(flat_calibration(small))


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


def test_the_rviz_window_shows_topics_and_frames_that_the_node_publishes(world: World) -> None:
    world.run()

    shown = yaml.safe_load((ROS2 / "rviz" / "prismstereo.rviz").read_text())["Visualization Manager"]

    topics = {display["Topic"]["Value"] for display in shown["Displays"] if "Topic" in display}
    assert topics
    assert topics <= set(world.graph.qos)
    assert shown["Global Options"]["Fixed Frame"] == FrameNames().link
