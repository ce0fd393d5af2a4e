"""A camera before a wall in a stand-in for ROS, for the tests of the node."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from host.counting import IDENTITY
from host.export_frames import frame_of, painted
from host.fake_ros import Graph
from prismstereo.driver import StereoCamera
from prismstereo_calibration import flash
from prismstereo_calibration.rectification import rectification
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import ObjectNumber, Progress, WriteStatus
from prismstereo_device.protocol import Capability, Command, CommandReply, CommandStatus, calibration_hash
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import Service
from prismstereo_device.source import ProducedFrame
from prismstereo_device.zones import ZoneDistances

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
