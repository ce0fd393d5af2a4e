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

import pytest

ROS2 = Path(__file__).parents[2] / "host" / "ros2"


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
