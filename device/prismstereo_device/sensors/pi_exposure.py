"""Exposure in libcamera's words, which changed: one switch for all, or a mode for time and another for gain."""

from __future__ import annotations

from collections.abc import Collection

from prismstereo_device.sensors.base import Exposure

__all__ = ["exposure_controls"]

_AUTOMATIC, _BY_HAND = 0, 1


def exposure_controls(exposure: Exposure, known: Collection[str]) -> dict[str, object]:
    """Return the controls that ask for an exposure, in the words that this camera knows.

    With the old words, a time or gain of 0 gives that one back to the automatic.
    """
    by_hand = exposure.exposure_us is not None and exposure.gain is not None
    controls: dict[str, object] = {}
    if {"ExposureTimeMode", "AnalogueGainMode"} <= set(known):
        controls["ExposureTimeMode"] = _AUTOMATIC if exposure.exposure_us is None else _BY_HAND
        controls["AnalogueGainMode"] = _AUTOMATIC if exposure.gain is None else _BY_HAND
        if exposure.exposure_us is not None:
            controls["ExposureTime"] = round(exposure.exposure_us)
        if exposure.gain is not None:
            controls["AnalogueGain"] = float(exposure.gain)
    else:
        controls["AeEnable"] = not by_hand
        controls["ExposureTime"] = round(exposure.exposure_us or 0)
        controls["AnalogueGain"] = float(exposure.gain or 0.0)
    if "AwbEnable" in known and not by_hand:
        controls["AwbEnable"] = True
    return controls
