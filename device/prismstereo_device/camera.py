"""The camera as the service sees it: sensor and pipeline behind one verb, with what a host changes applied between frames."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from prismstereo_device.control.controls import Controls
from prismstereo_device.control.optics_watch import OpticsWatch
from prismstereo_device.control.self_test import Facts
from prismstereo_device.control.sensor_settings import focus, put, put_changed
from prismstereo_device.control.settings import AUTO, SettingRules, Settings
from prismstereo_device.control.stills import Stills
from prismstereo_device.frame_maker import FrameMaker
from prismstereo_device.matching import Matching
from prismstereo_device.reopening import Patience, ReopeningSensor
from prismstereo_device.sensors.base import Sensor
from prismstereo_device.source import ProducedFrame
from prismstereo_device.timing import Timing
from prismstereo_hw.errors import DataError, DeviceError, PrismStereoError, UsageError

__all__ = ["CameraDesk", "CameraSource"]

logger = logging.getLogger(__name__)

_TEMPERATURE_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True)
class CameraDesk:
    """Whoever a camera works for: who orders, who gets its stills, looks and facts. Everything is called in the frame loop.

    `tell` takes what the frame loop knows for a self-test that was ordered; `alive` is called while a camera that went away is
    waited for, so that nobody takes the loop for dead.
    """

    controls: Controls
    stills: Stills
    optics: OpticsWatch
    tell: Callable[[Facts], None]
    alive: Callable[[], None]


class CameraSource:
    """Reads a sensor and makes of its frames what the settings ask for, no more.

    The lens is driven to where the calibration was made, where both are known. A frame that does not fit the calibration goes
    out unmatched, and the log says why; if no frame ever fitted, that is raised at the end. `reopen` opens a camera that went
    away; `filter_set` numbers the filters; previews come `preview_hz` times a second at most.
    """

    def __init__(
        self,
        sensor: Sensor,
        matching: Matching,
        desk: CameraDesk,
        *,
        reopen: Callable[[], Sensor] | None = None,
        patience: Patience | None = None,
        filter_set: int = 0,
        preview_hz: float = 5.0,
    ) -> None:
        self._matching, self._desk = matching, desk
        self._controls = desk.controls
        self._settings = self._controls.settings
        self._first_matcher = self._settings.matcher
        self._timing = Timing()
        self._maker = FrameMaker(matching, desk.optics, self._timing, filter_set=filter_set, preview_hz=preview_hz)
        self._away = ""
        self._temperature_c: float | None = None
        self._asked_temperature_s = -_TEMPERATURE_PERIOD_S
        if self._settings.lens_position == AUTO:
            self._lock_lens(sensor)
        put(sensor, self._settings)
        self._controls.adopt(self._rules(sensor))
        self._reader = ReopeningSensor(
            sensor, reopen, patience=patience, prepare=self._prepare_again, waiting=self._wait_for_camera
        )

    @property
    def sensor(self) -> Sensor:
        """The sensor that is read now; its controls are the frame loop's."""
        return self._reader.sensor

    @property
    def frame_size(self) -> tuple[int, int] | None:
        """Width and height of the newest frame; None before the first."""
        return self._timing.frame_size

    @property
    def temperature_c(self) -> float | None:
        """The sensor's temperature, a second ago at most while frames come; None where it does not tell."""
        return self._temperature_c

    def read(self) -> ProducedFrame | None:
        """Make the next frame, stamped at mid-exposure; None after the sensor's last, or once stopped.

        `DeviceError` when the camera went away and does not come back; whatever no frame could be matched for, at the end.
        """
        self._between_frames()
        frame = self._reader.read()
        self._away = ""
        if frame is None:
            if self._maker.never_fitted is not None and not self._reader.stopped:
                raise self._maker.never_fitted
            return None
        self._timing.frame(frame)
        self._ask_temperature()
        return self._maker.make(frame, self._settings)

    def _ask_temperature(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._asked_temperature_s + _TEMPERATURE_PERIOD_S:
            self._asked_temperature_s = now_s
            self._temperature_c = self._reader.sensor.temperature_c

    def stop(self) -> None:
        """Wait no longer for a camera that is away; from any thread."""
        self._reader.stop()

    def close(self) -> None:
        """Let go of the camera; after the last `read`."""
        self._reader.close()

    # ---- between frames

    def _between_frames(self) -> None:
        orders = self._controls.take()
        if orders.settings is not None:
            self._apply(orders.settings)
        if orders.calibration is not None:
            self._calibrate(orders.calibration)
        self._advance()
        self._desk.stills.serve(self._reader.sensor)
        if orders.self_test:
            self._desk.tell(self._facts())

    def _wait_for_camera(self, why: str) -> None:
        """Show that the loop lives although no frame comes, and do what needs none."""
        self._away = why
        self._desk.alive()
        self._desk.stills.fail("the camera is away")
        orders = self._controls.take()
        if orders.settings is not None:
            self._settings = orders.settings  # the sensor gets them when it is back
            self._choose(orders.settings)
        if orders.calibration is not None:
            self._calibrate(orders.calibration)
        if orders.self_test:
            self._desk.tell(self._facts())

    def _facts(self) -> Facts:
        unfit = self._maker.unfit
        timing, calibration = self._timing, self._matching.calibration
        rate_hz = self._settings.rate_hz
        return Facts(
            frames=timing.frames,
            away=self._away,
            losses=self._reader.losses,
            rate_hz=timing.rate_hz,
            wished_rate_hz=0.0 if isinstance(rate_hz, str) else rate_hz,
            backward_stamps=timing.backward,
            unfit="" if unfit is None else str(unfit),
            frame_size=timing.frame_size,
            calibrated_size=(calibration.frame_width, calibration.frame_height * calibration.left_view.exposures),
            match_ms=timing.match_ms,
            temperature_c=self.temperature_c,
        )

    # ---- settings

    def _apply(self, wished: Settings) -> None:
        sensor, before = self._reader.sensor, self._settings
        self._settings = wished
        try:
            for names, error in put_changed(sensor, before, wished):
                self._give_back(names, before, error)
        except DeviceError as error:  # the next frame will tell, and a camera that comes back is set anew
            logger.warning("%s", error)
        self._controls.adopt(self._rules(sensor))  # a rate may change what exposures there are
        self._choose(self._settings)

    def _choose(self, wished: Settings) -> None:
        try:
            self._matching.choose(wished)
        except (DataError, UsageError) as error:
            self._keep_matching(error)

    def _advance(self) -> None:
        try:
            self._matching.advance()
        except (DataError, UsageError) as error:
            self._keep_matching(error)

    def _keep_matching(self, error: PrismStereoError) -> None:
        kept = self._matching.chosen
        self._give_back(("matcher", "region", "reasons"), kept, error)

    def _give_back(self, names: tuple[str, ...], before: Settings, error: PrismStereoError) -> None:
        logger.error("%s stays as it was: %s", " and ".join(names), error)
        for name in names:
            self._controls.give_back(name, self._settings.value(name), before.value(name))
            self._settings = msgspec.structs.replace(self._settings, **{name: getattr(before, name)})

    def _calibrate(self, content: bytes) -> None:
        region = self._matching.chosen.region
        try:
            self._matching.calibrate(content)
        except (DataError, UsageError):
            logger.exception("the calibration stays as it was")
            return
        self._maker.unfit = None
        if self._matching.chosen.region != region:
            logger.warning("the region does not fit the new calibration's pictures: all of them are matched")
            self._settings = msgspec.structs.replace(self._settings, region=AUTO)
            self._controls.adopt(self._controls.rules, region=AUTO)
        self._lock_lens(self._reader.sensor)

    def _lock_lens(self, sensor: Sensor) -> None:
        """Drive the lens to where the calibration was made, if the sensor has a motor."""
        calibrated = self._matching.calibration.lens_position
        if calibrated is None or sensor.limits.lens_position is None:
            self._controls.adopt(self._rules(sensor))
            return
        self._settings = msgspec.structs.replace(self._settings, lens_position=calibrated)
        if not self._away:  # else the camera that comes back is driven there
            try:
                focus(sensor, self._settings)
            except (UsageError, DeviceError):
                logger.exception("the lens is not where the calibration was made")
        self._controls.adopt(self._rules(sensor), lens_position=calibrated)

    def _rules(self, sensor: Sensor) -> SettingRules:
        return SettingRules.of(
            sensor.limits,
            self._matching.picture,
            matcher=self._first_matcher,
            calibrated_lens=self._matching.calibration.lens_position,
        )

    def _prepare_again(self, sensor: Sensor) -> None:
        try:
            put(sensor, self._settings)
        except UsageError:
            logger.exception("the camera that came back does not take its settings")
