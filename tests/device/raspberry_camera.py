"""A strict stand-in for the library picamera2, after its documentation and its source.

Whatever it has not got is an AttributeError, as are unknown words; controls, stream sizes and configurations are checked as
the library checks them, and every request must be released once. A picture shows its exposure's number: `10 + n % 200`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

PERIOD_US = 33_333
BOOT_NS = 1_000_000_000_000
_STILL, _VIDEO = "still", "preview"


def sensor_mode(size: tuple[int, int], rate_hz: float, crop: tuple[int, int, int, int]) -> dict[str, Any]:
    """A mode as the library lists them."""
    return {
        "format": "SRGGB10_CSI2P",
        "unpacked": "SRGGB10",
        "bit_depth": 10,
        "size": size,
        "fps": rate_hz,
        "crop_limits": crop,
        "exposure_limits": (75, 11766829, 20000),
    }


SLOW_MODES = [  # IMX219: all pixels at 21 Hz only, the middle of the sensor at 47 Hz
    sensor_mode((640, 480), 103.33, (1000, 752, 1280, 960)),
    sensor_mode((1640, 1232), 41.85, (0, 0, 3280, 2464)),
    sensor_mode((1920, 1080), 47.57, (680, 692, 1920, 1080)),
    sensor_mode((3280, 2464), 21.19, (0, 0, 3280, 2464)),
]
QUICK_MODES = [sensor_mode((328, 246), 60.0, (0, 0, 328, 246))]


class Request:
    """One exposure."""

    def __init__(self, camera: Picamera2, number: int, configuration: dict[str, Any]) -> None:
        self._camera, self._number, self._configuration = camera, number, configuration
        self._released = False
        self._lens = camera.applied.get("LensPosition")

    def make_array(self, name: str) -> NDArray[np.uint8]:
        assert not self._released, "a released buffer is somebody else's"
        stream = self._configuration[name]
        assert stream is not None, f"Stream {name!r} is not defined"
        (width, height), stride = stream["size"], stream["size"][0] + 64
        planes = np.full((height * 3 // 2, stride), 128, np.uint8)
        planes[:height, :width] = 10 + self._number % 200
        return planes

    def get_metadata(self) -> dict[str, Any]:
        assert not self._released
        applied = self._camera.applied
        told: dict[str, Any] = {
            "SensorTimestamp": BOOT_NS + self._number * PERIOD_US * 1000,
            "ExposureTime": applied.get("ExposureTime") or 10_000,
            "FrameDuration": PERIOD_US,
            "ColourGains": (1.5, 2.0),
            "SensorTemperature": 41.5,
            "ScalerCrop": (0, 309, 3280, 1845),
        }
        return told if self._lens is None else told | {"LensPosition": self._lens}

    def release(self) -> None:
        assert not self._released, "CompletedRequest: lock now has negative ref_count"
        self._released = True
        self._camera.out.discard(self)


class Picamera2:
    """The library's class; `modes` and `camera_controls` are what one camera module says of itself."""

    modes: ClassVar = SLOW_MODES
    known: ClassVar[dict[str, tuple[Any, Any, Any]]] = {
        "AeEnable": (False, True, True),
        "AnalogueGain": (1.0, 10.67, 1.0),
        "AwbEnable": (False, True, None),
        "ColourGains": (0.0, 32.0, None),
        "ExposureTime": (75, 11_766_829, 20_000),
        "FrameDurationLimits": (23_895, 11_767_556, 33_333),
        "NoiseReductionMode": (0, 4, 0),
        "ScalerCrop": ((0, 0, 64, 64), (0, 0, 3280, 2464), (0, 0, 3280, 2464)),
    }
    made: ClassVar[list[Picamera2]] = []

    adjusted: ClassVar[dict[str, tuple[int, int]]] = {}  # sizes that the image processor makes of those asked for

    @staticmethod
    def global_camera_info() -> list[dict[str, Any]]:
        return [
            {"Model": "imx219", "Location": 2, "Rotation": 180, "Id": "/base/soc/i2c0mux/i2c@1/imx219@10", "Num": 0}
        ]

    def __init__(self, camera_num: int = 0) -> None:
        assert camera_num == 0
        self.camera_controls = dict(self.known)
        self.configuration: dict[str, Any] | None = None
        self.asked: list[dict[str, object]] = []  # what set_controls was called with
        self.applied: dict[str, Any] = {}
        self.out: set[Request] = set()
        self.started, self.closed, self.silent = False, False, False
        self.number = -1
        self.stills = 0
        self._results: dict[int, Request] = {}
        self.made.append(self)

    @property
    def sensor_modes(self) -> list[dict[str, Any]]:
        assert not self.started, "Camera must be stopped before configuring"  # it configures each mode to ask for it
        return self.modes

    def _configuration(
        self,
        use: str,
        main: dict[str, Any],
        lores: dict[str, Any] | None,
        raw: dict[str, Any],
        controls: dict[str, Any],
        buffer_count: int,
    ) -> dict[str, Any]:
        for stream in filter(None, (main, lores, raw)):
            assert set(stream) == {"format", "size"}
            assert isinstance(stream["size"], tuple)
            assert not stream["size"][0] % 2
            assert not stream["size"][1] % 2, "width and height should be even"
        assert main["format"] == "YUV420"
        assert raw["format"] == "SRGGB10"
        self._check(controls)
        return {
            "use_case": use,
            "main": main,
            "lores": lores,
            "raw": raw,
            "controls": controls,
            "buffers": buffer_count,
        }

    def create_preview_configuration(
        self,
        main: dict[str, Any],
        lores: dict[str, Any],
        raw: dict[str, Any],
        controls: dict[str, Any],
        buffer_count: int = 4,
        display: str | None = "main",
        encode: str | None = "main",
    ) -> dict[str, Any]:
        assert display is None
        assert encode is None
        assert lores["format"] == "YUV420", "lores stream must be YUV"
        assert lores["size"][0] <= main["size"][0], "lores stream dimensions may not exceed main stream"
        assert lores["size"][1] <= main["size"][1]
        return self._configuration(_VIDEO, main, lores, raw, controls, buffer_count)

    def create_still_configuration(
        self, main: dict[str, Any], raw: dict[str, Any], controls: dict[str, Any], buffer_count: int = 1
    ) -> dict[str, Any]:
        return self._configuration(_STILL, main, None, raw, controls, buffer_count)

    def configure(self, camera_config: dict[str, Any]) -> None:
        assert not self.started, "Camera must be stopped before configuring"
        self.configuration = camera_config
        self.applied = dict(camera_config["controls"])

    def stream_configuration(self, name: str = "main") -> dict[str, Any]:
        assert self.configuration is not None, "Camera has not been configured"
        return {"size": self.adjusted.get(name, self.configuration[name]["size"])}

    def start(self) -> None:
        assert self.configuration is not None, "Camera has not been configured"
        self.started = True

    def set_controls(self, controls: dict[str, object]) -> None:
        self._check(controls)
        self.asked.append(dict(controls))
        self.applied |= controls

    def capture_request(
        self, wait: bool | None = None, signal_function: Callable[[object], None] | None = None
    ) -> object:
        assert self.started
        assert self.configuration is not None
        assert len(self.out) < self.configuration["buffers"] - 1, "all buffers are held: the camera stands still"
        return self._job(self.configuration, signal_function)

    def switch_mode_and_capture_request(
        self,
        camera_config: dict[str, Any],
        wait: bool | None = None,
        signal_function: Callable[[object], None] | None = None,
    ) -> object:
        assert self.started
        assert not self.out, "a buffer that is held is lost in a change of mode"
        before = self.configuration
        self.configure_for_still(camera_config)
        job = self._job(camera_config, signal_function)
        assert before is not None
        self.applied = dict(before["controls"])  # what was set since is forgotten
        self.stills += 1
        return job

    def configure_for_still(self, camera_config: dict[str, Any]) -> None:
        self.applied = dict(camera_config["controls"])
        self.still_controls = self.applied

    def _job(self, configuration: dict[str, Any], signal_function: Callable[[object], None] | None) -> object:
        assert signal_function is not None
        self.number += 1
        request = Request(self, self.number, configuration)
        self.out.add(request)
        job = object()
        self._results[id(job)] = request
        if not self.silent:  # from the library's own thread
            threading.Timer(0.001, signal_function, (job,)).start()
        return job

    def wait(self, job: object) -> Request:
        return self._results.pop(id(job))

    def close(self) -> None:
        if self.silent:
            time.sleep(0.2)
        self.closed, self.started = True, False

    def _check(self, controls: dict[str, Any]) -> None:
        for name in controls:
            if name not in self.camera_controls:
                raise RuntimeError(f"Control {name} is not advertised by libcamera")
