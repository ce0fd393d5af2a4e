"""What pages can ask of the camera that is watched, and how things stand with it."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from concurrent.futures import Executor

from prismstereo.driver import StereoCamera
from prismstereo.viewer.capture import Capture, Shot
from prismstereo.viewer.judgement import by_optics, by_scenes
from prismstereo.viewer.playback import Playback
from prismstereo.viewer.records import Records
from prismstereo.viewer.state import state_of
from prismstereo.viewer.switches import Switches
from prismstereo.viewer.tape import Tape
from prismstereo.viewer.watch import Watch
from prismstereo_calibration.model import Calibration
from prismstereo_device.protocol import Capability
from prismstereo_device.protocol.command import Value
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DataError, DeviceError, PrismStereoError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import BUILT_IN, LITERATURE, Rig

__all__ = ["Desk"]

logger = logging.getLogger(__name__)

_OPTICS_EVERY_S = 60.0
_RAW_WAIT_S = 15.0
_CHECK_FRAMES = 3


class Desk:
    """One camera that is watched; actions wait for the camera and may be called from any thread, one still at a time."""

    def __init__(
        self,
        camera: StereoCamera,
        watch: Watch,
        records: Records,
        *,
        playback: Playback | None = None,
        rig: Rig | None = None,
    ) -> None:
        self.camera, self.watch, self.playback, self._rig = camera, watch, playback, rig
        self.able = playback is None and bool(camera.identity.capabilities & Capability.COMMANDS)
        self.switches = Switches(camera, able=self.able)
        self.tape: Tape | None = None
        self._records = records
        self._capture: Capture | None = None
        self._acting = threading.Lock()
        self._taping = threading.Lock()
        self._details: dict[str, object] | None = None
        self._optics: dict[str, object] | None = None
        self._advice: dict[str, object] = {"advice": "unknown", "why": "", "by": ""}
        self._look_at_s = time.monotonic() + 5.0
        self._last = (time.monotonic(), 0)

    def close(self) -> None:
        """Stop recording, and let go of the camera."""
        with contextlib.suppress(PrismStereoError):
            self.record(on=False)
        self.watch.close()

    # ---- settings

    def details(self) -> dict[str, object]:
        """Give the camera's own words about itself, and the settings with what is in force; empty where it has none."""
        if not self.able:
            return {}
        if self._details is None:
            self._details = self.camera.identity_details
        rules = self._details.get("settings")
        values: dict[str, Value] = {}
        for rule in rules if isinstance(rules, list) else []:
            name = str(rule.get("name", "")) if isinstance(rule, dict) else ""
            if name:
                values[name] = self.camera.get(name)
        return {**self._details, "values": values}

    def change(self, name: str, value: Value) -> Value:
        """Set a setting and return what is in force."""
        return self.camera.set(name, value)

    # ---- pictures that are kept

    def record(self, *, on: bool, raw: bool = False) -> None:
        """Begin or end a recording; the one that runs goes on where it is begun twice."""
        with self._taping:
            if on and self.tape is None:
                if self.playback is not None:
                    raise UsageError("this is a recording already: go back to the camera first")
                self.tape = Tape(self.camera, self._records, self.switches, raw=raw)
            elif not on and self.tape is not None:
                tape, self.tape = self.tape, None
                tape.close()

    def shoot(self, shot: Shot) -> dict[str, object]:
        """Take a still and a raw frame of the same moment into this run's session folder; tells where they lie."""
        self._require_camera()
        if not self._acting.acquire(blocking=False):
            raise UsageError("a picture is being taken: wait for it")
        try:
            still = self.camera.still()
            video = self._raw_frames(1)[0]
            if self._capture is None:
                self._capture = Capture(self._records.new_session(), self._rig_there(), self._calibration())
            place = self._capture.add(shot, still, video)
        finally:
            self._acting.release()
        height, width = still.pixels.shape[:2]
        return {"session": self._capture.folder.name, "picture": place, "width": width, "height": height}

    # ---- health

    def look(self) -> dict[str, object]:
        """Let the camera look at its optics, and judge its calibration by that."""
        self._require_camera()
        self._look_at_s = time.monotonic() + _OPTICS_EVERY_S
        self._optics = self.camera.optics()
        if self._advice["by"] in ("", "optics"):
            self._advice = by_optics(self._optics)
        return self._optics

    def look_now_and_then(self, chores: Executor) -> None:
        """Look at the optics in the background when it is time."""
        if self.able and self.watch.newest is not None and time.monotonic() >= self._look_at_s:
            self._look_at_s = time.monotonic() + _OPTICS_EVERY_S
            chores.submit(self._look_quietly)

    def _look_quietly(self) -> None:
        try:
            self.look()
        except PrismStereoError as error:
            logger.info("the optics were not looked at: %s", error)

    def check(self) -> dict[str, object]:
        """Judge the calibration by a few raw frames of whatever stands before the camera."""
        self._require_camera()
        calibration = self.camera.calibration
        self._advice = by_scenes(calibration, self._raw_frames(_CHECK_FRAMES))
        return self._advice

    def status(self) -> dict[str, object]:
        """Tell how things stand, for the page."""
        now_s, received = time.monotonic(), self.camera.statistics.line.received_bytes
        before_s, before = self._last
        self._last = (now_s, received)
        rate = (received - before) / max(now_s - before_s, 1e-3)
        return state_of(self.camera, self.watch, self._details) | {
            "bytes_per_s": round(rate),
            "live": self.playback is None,
            "able": self.able,
            "tape": None if self.tape is None else self.tape.told(),
            "playback": None if self.playback is None else self.playback.told(),
            "optics": self._optics,
            "calibration": self._advice,
        }

    def _require_camera(self) -> None:
        if not self.able:
            raise UsageError("this is a recording, or a camera that takes no commands: open a live camera")

    def _raw_frames(self, count: int) -> list[RawFrame]:
        with self.camera.stream(Channel.RAW, count) as stream, self.switches.during("raw"):
            frames = []
            for _ in range(count):
                picture = stream.take(_RAW_WAIT_S)
                if picture is None:
                    raise DeviceError(f"no raw frame came within {_RAW_WAIT_S:g} s: is the camera streaming?")
                head = picture.head
                frames.append(RawFrame(picture.pixels(), head.frame, head.timestamp_us, head.lens_position))
            return frames

    def _rig_there(self) -> Rig:
        """Give the rig that a session folder is about: the one that was named at the start, else the calibration's."""
        if self._rig is not None:
            return self._rig
        named = self.camera.calibration.rig  # the camera's word: a built-in name, and never a path of this machine
        if named not in BUILT_IN + LITERATURE:
            raise UsageError(f"the rig {named[:40]!r} is not a built-in one: start the viewer with --rig FILE")
        return Rig.read(named)

    def _calibration(self) -> Calibration | None:
        try:
            return self.camera.calibration
        except DataError:
            return None
