"""A viewer for tests: the real hub and server before a small camera that sends the frames it is told to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import httpx
import numpy as np

from host.small_device import Answering, SmallDevice
from prismstereo.driver import StereoCamera
from prismstereo.viewer.hub import Hub
from prismstereo.viewer.records import Records
from prismstereo.viewer.serving import ViewerServer
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.protocol import Command, CommandReply, CommandStatus, calibration_hash, fragment
from prismstereo_device.wire import Channel
from prismstereo_hw.rig import Rig

IDENTITY = (
    b'{"product": "small", "version": "1", "rig": "oak-1", "settings": '
    b'[{"name": "gain", "kind": "number", "automatic": true, "least": 1.0, "most": 8.0}]}'
)


class Settable(Answering):
    """Keeps what it is told, and refuses a gain above eight."""

    def __init__(self, objects: dict[int, Held]) -> None:
        super().__init__(objects)
        self.settings: dict[str, object] = {"gain": 1.0, "preview": False, "raw": False, "reasons": False}

    def command(self, command: Command) -> CommandReply:
        if command.name not in self.settings:
            return CommandReply(CommandStatus.UNKNOWN, why=f"there is no {command.name}")
        if command.verb == "set":
            if command.name == "gain" and not 1 <= float(str(command.value)) <= 8:
                return CommandReply(CommandStatus.REFUSED, why="gain: give a number from 1 to 8")
            self.settings[command.name] = command.value
        return CommandReply(CommandStatus.OK, self.settings[command.name])


class SmallViewer:
    """A hub, its server and its camera; a context manager."""

    def __init__(self, rig: Rig, records: Path) -> None:
        self.calibration = Calibration.nominal(rig)
        self._flash = flash.pack(self.calibration)
        self.made = rectification(self.calibration)
        self.answering = Settable(
            {ObjectNumber.CALIBRATION: Held(1, self._flash), ObjectNumber.IDENTITY: Held(1, IDENTITY)}
        )
        ours, theirs = loopback()
        self.device = SmallDevice(theirs, answering=self.answering)
        self.hub = Hub(lambda: StereoCamera(ours), "small", Records(records))
        self.server = ViewerServer(self.hub)
        self.sent = 0
        # Nothing here is https, and to read a machine's list of authorities takes longer than all requests of a test.
        self.client = httpx.Client(base_url=f"http://{self.host}", verify=False, timeout=20)

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.server.port}"

    def post(self, action: str, what: object = None) -> httpx.Response:
        """Ask for something as the page does."""
        return self.client.post(f"/api/{action}", json=what or {}, headers={"origin": f"http://{self.host}"})

    def send(self, disparity: DisparityMap | None = None) -> DisparityMap:
        """Send the next frame: one that rises from left to right, unless another one is given."""
        if disparity is None:
            row = np.linspace(20, 40, self.made.width, dtype=np.float32)
            pixels = np.tile(np.rint(row * 16) / 16, (self.made.height, 1)).astype(np.float32)
            pixels[:4] = np.nan
            disparity = DisparityMap(pixels, self.made.window)
        parts = fragment(
            disparity,
            frame=self.sent,
            timestamp_us=33_333 * self.sent,
            calibration_hash=calibration_hash(self._flash),
            mtu=4096,
        )
        for flags, index, payload in parts:
            self.device.send(Channel.DISP, payload, flags, self.sent & 0xFFFF, index)
        self.sent += 1
        return disparity

    def __enter__(self) -> SmallViewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.client.close()
        self.server.close()
        self.hub.close()
        self.device.stop()


@contextmanager
def small_viewer(rig: Rig, records: Path) -> Iterator[SmallViewer]:
    with SmallViewer(rig, records) as viewer:
        yield viewer
