"""Those settings that are the sensor's own: put into it where they differ from what it has."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from prismstereo_device.control.settings import Settings
from prismstereo_device.sensors.base import Exposure, Sensor
from prismstereo_hw.errors import UsageError

__all__ = ["focus", "put", "put_changed"]


def put(sensor: Sensor, settings: Settings) -> None:
    """Put every setting that is not `auto` into a sensor; UsageError where it cannot be, DeviceError where it went away."""
    for _, error in put_changed(sensor, Settings(), settings):
        raise error


def put_changed(sensor: Sensor, before: Settings, wished: Settings) -> Iterator[tuple[tuple[str, ...], UsageError]]:
    """Put what differs into a sensor, and yield the names of those that it does not take, with its reason.

    Raises DeviceError where the sensor went away.
    """
    for names, put_one in _CONTROLS:
        if any(wished.value(name) != before.value(name) for name in names):
            try:
                put_one(sensor, wished)
            except UsageError as error:
                yield names, error


def focus(sensor: Sensor, settings: Settings) -> None:
    """Drive the lens to its setting; `auto` leaves it where it is. UsageError and DeviceError as the sensor raises them."""
    if not isinstance(settings.lens_position, str):
        sensor.set_lens(settings.lens_position)


def _expose(sensor: Sensor, settings: Settings) -> None:
    exposure_us, gain = (None if isinstance(value, str) else value for value in (settings.exposure_us, settings.gain))
    sensor.set_exposure(Exposure(exposure_us, gain))


def _pace(sensor: Sensor, settings: Settings) -> None:
    if not isinstance(settings.rate_hz, str):
        sensor.set_rate(settings.rate_hz)


_CONTROLS: tuple[tuple[tuple[str, ...], Callable[[Sensor, Settings], None]], ...] = (
    (("exposure_us", "gain"), _expose),
    (("rate_hz",), _pace),
    (("lens_position",), focus),
)
