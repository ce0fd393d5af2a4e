"""The camera's node; with `urdf:=FILE` also what the sensor looks like, with `rviz:=true` a window to see it all in."""

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

_ARGUMENTS = (
    (
        "port",
        "",
        "serial port, serial:NUMBER, tcp:HOST:PORT, a recording, simulated[:RIG[:SCENE]]; empty: the one on USB",
    ),
    ("name", "prismstereo", "of the node: begins topics and frames"),
    ("depth_encoding", "16UC1", "of depth: 16UC1 in mm, or 32FC1 in metres"),
    ("urdf", "", "made by `prismstereo export --to urdf`, with the same --name: its frames are published then"),
    ("rviz", "false", "true: open rviz"),
)


def _description(file: str) -> str:
    """Read a URDF and say where on this machine its mesh lies: rviz finds no relative paths."""
    path = Path(file).resolve()
    return path.read_text("utf-8").replace('filename="meshes/', f'filename="file://{path.parent}/meshes/')


def _nodes(context: Any) -> list[Node]:
    chosen = {name: LaunchConfiguration(name).perform(context) for name, _, _ in _ARGUMENTS}
    parameters = {
        "port": chosen["port"],
        "depth_encoding": chosen["depth_encoding"],
        "publish_tf": not chosen["urdf"],
    }
    nodes = [Node(package="prismstereo_ros", executable="node", name=chosen["name"], parameters=[parameters])]
    if chosen["urdf"]:
        described = {"robot_description": _description(chosen["urdf"])}
        nodes.append(Node(package="robot_state_publisher", executable="robot_state_publisher", parameters=[described]))
    if chosen["rviz"].lower() == "true":
        window = Path(get_package_share_directory("prismstereo_ros")) / "rviz" / "prismstereo.rviz"
        nodes.append(Node(package="rviz2", executable="rviz2", arguments=["-d", str(window)]))
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Describe it to `ros2 launch`."""
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=about) for name, value, about in _ARGUMENTS
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])
