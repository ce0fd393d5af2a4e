"""A camera that matches by itself is served as it is, and starts again with a calibration that a host writes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from typing import Any

import pytest

from device.service_host import disparity
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.control.settings import Settings
from prismstereo_device.objects import ObjectNumber, WriteStatus
from prismstereo_device.program.assembly import Program
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.self_matching import matches_by_itself, self_matching
from prismstereo_device.serving.log_ring import LogRing
from prismstereo_device.source import ProducedFrame
from prismstereo_device.state import MemoryDisk
from prismstereo_hw.errors import UsageError


class Numbered:
    """A camera that gives disparity."""

    temperature_c = 52.0

    def __init__(self) -> None:
        self.made = self.closed = 0

    def read(self) -> ProducedFrame:
        self.made += 1
        return ProducedFrame(self.made, self.made, None, disparity())

    def close(self) -> None:
        self.closed += 1


def test_on_device_stereo_is_asked_for_by_its_address() -> None:
    assert matches_by_itself("oak:?mode=stereo")
    assert not matches_by_itself("oak:")
    assert not matches_by_itself("twin:oak-1")


@pytest.mark.parametrize(
    ("wish", "named"),
    [({"filters": "robot"}, "filters"), ({"settings": Settings(zones=True, gain=2.0)}, "gain, zones")],
)
def test_what_only_our_own_matcher_does_is_refused_by_name(wish: dict[str, Any], named: str) -> None:
    configuration = Configuration(sensor="oak:?mode=stereo&rig=oak-1", **wish)
    with ThreadPoolExecutor(1) as worker:
        program = Program(worker, LogRing(), lambda: None, lambda: None)
        with pytest.raises(UsageError, match=rf"{named}: a camera that matches by itself"):
            self_matching(configuration, MemoryDisk(), program, lambda *_: Numbered())


def test_its_frames_go_out_and_a_new_calibration_starts_it_again() -> None:
    camera, opened, reboots = Numbered(), [], []

    def open_camera(configuration: Configuration, calibration: Calibration) -> Numbered:
        opened.append((configuration.sensor, calibration.rig))
        return camera

    with ThreadPoolExecutor(1) as worker:
        program = Program(worker, LogRing(), lambda: None, lambda: reboots.append(1))
        configuration = Configuration(sensor="oak:?mode=stereo&rig=oak-1")
        made = self_matching(configuration, MemoryDisk(), program, open_camera)
    assert opened == [("oak:?mode=stereo&rig=oak-1", "oak-1")]
    assert made.commands is None
    assert made.temperature_c() == 52.0
    first = made.source.read()
    assert first is not None
    assert first.index == 1
    held = made.shelf.read(ObjectNumber.CALIBRATION)
    assert held is not None
    written = flash.pack(flash.unpack(held.content))
    name = sha256(written).digest()
    made.shelf.begin(ObjectNumber.CALIBRATION, len(written), name)
    made.shelf.write(ObjectNumber.CALIBRATION, 0, written)
    assert made.shelf.commit(ObjectNumber.CALIBRATION, len(written), name).status is WriteStatus.OK
    assert reboots == [1]
    made.source.stop()
    assert made.source.read() is None
    made.source.close()
    assert camera.closed == 1
