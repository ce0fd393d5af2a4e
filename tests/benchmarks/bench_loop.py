"""The whole way of a frame, beside its matcher alone: what split, rectify, codec, packets and the host add."""

from __future__ import annotations

import threading

from benchmarks.row import BenchRow, interleave
from prismstereo.driver import StereoCamera
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.codec import encode
from prismstereo_device.link.loopback import loopback
from prismstereo_device.match import create
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_device.source import ProducedFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin


class _OnDemand:
    """Matches the same raw frame once for every permit, so that nothing is computed ahead of the clock."""

    def __init__(self, pipeline: Pipeline, twin: Twin) -> None:
        self._pipeline, self._frame, self._index = pipeline, twin.frame(), 0
        self.permits = threading.Semaphore(0)
        self.over = False

    def read(self) -> ProducedFrame | None:
        self.permits.acquire()
        self._index += 1
        return None if self.over else ProducedFrame(self._index, self._index, None, self._pipeline.process(self._frame))


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    calibration = Calibration.nominal(rig)
    twin, pipeline, matcher = Twin(rig, desk(rig)), Pipeline(calibration), create()
    pair = pipeline.rectifier.rectify(pipeline.split(twin.frame()))
    source = _OnDemand(pipeline, twin)
    device, host = loopback()
    objects = FixedObjects({ObjectNumber.CALIBRATION: flash.pack(calibration)})
    service = Service(source, device, DeviceIdentity(bytes(8), 1), objects=objects, lossless=True)
    with device, service, StereoCamera(host, keep_all=True) as camera:
        frames = iter(camera)

        def whole() -> None:
            source.permits.release()
            next(frames)

        ours, peer = interleave(whole, lambda: matcher.match(pair))
        source.over = True
        source.permits.release()
    note = "640x720 over loopback; latency of a single frame"
    rows = [BenchRow("raw frame in the sensor to map on the desk", ours, "its matcher alone", peer, note)]
    return [*rows, _on_camera(pipeline, twin)]


def _on_camera(pipeline: Pipeline, twin: Twin) -> BenchRow:
    """What the camera does to a frame: split, rectify, match, encode."""
    frame, anchor = twin.frame(), create("sgbm-3way")
    pair = pipeline.rectifier.rectify(pipeline.split(frame))

    def camera() -> None:
        encode(pipeline.process(frame).fixed_point())

    ours, peer = interleave(camera, lambda: anchor.match(pair))
    note = f"640x720, 128 labels; {1e3 / ours:.0f} frames/s"
    return BenchRow("split, rectify, match, encode", ours, "sgbm-3way, one pass, alone", peer, note)
