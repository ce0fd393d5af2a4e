"""What lies between commands and the frame loop: the settings in force, and one place for each thing that waits to be done.

Commands come in one thread and are answered at once; the frame loop takes what was ordered between two frames. Nothing queues
up: newer settings take the place of older ones, and one still and one self-test wait at a time.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import msgspec

from prismstereo_device.control.settings import SettingRules, Settings
from prismstereo_device.protocol.command import Value

__all__ = ["Controls", "Orders"]


@dataclass(frozen=True, slots=True)
class Orders:
    """What the frame loop is to do before its next frame; None and False: nothing."""

    settings: Settings | None = None
    calibration: bytes | None = None
    self_test: bool = False


class Controls:
    """Settings as they are accepted, and orders to the frame loop; every call is safe from any thread and quick."""

    def __init__(self, settings: Settings, rules: SettingRules) -> None:
        self._lock = threading.Lock()
        self._settings, self._rules = settings, rules
        self._changed = self._to_test = self._testing = False
        self._calibration: bytes | None = None

    @property
    def settings(self) -> Settings:
        """The settings in force: accepted, and not yet found impossible."""
        return self._settings

    @property
    def rules(self) -> SettingRules:
        """What each setting can be now; a new calibration may change it."""
        return self._rules

    def change(self, name: str, value: Value) -> Settings:
        """Accept a new value of a setting; `UsageError` where its rule forbids it, `KeyError` for a name without a rule."""
        with self._lock:
            self._settings = self._settings.with_value(name, value, self._rules)
            self._changed = True
            return self._settings

    def order_calibration(self, content: bytes) -> None:
        """Let the frame loop go on with this calibration (flash bytes)."""
        with self._lock:
            self._calibration = content

    def order_self_test(self) -> bool:
        """Let the frame loop test the device; False where it is still at the last one."""
        with self._lock:
            ordered = not self._testing
            self._to_test, self._testing = self._to_test or ordered, True
            return ordered

    def take(self) -> Orders:
        """Take what was ordered since the last time: the frame loop's side."""
        with self._lock:
            settings = self._settings if self._changed else None
            orders = Orders(settings, self._calibration, self._to_test)
            self._changed, self._calibration, self._to_test = False, None, False
            return orders

    def tested(self) -> None:
        """Say that the self-test that was taken is done."""
        with self._lock:
            self._testing = False

    def give_back(self, name: str, wished: Value, in_force: Value) -> None:
        """Say that a wish could not be had after all; a newer one stays."""
        with self._lock:
            if self._settings.value(name) == wished:
                self._settings = _put(self._settings, name, in_force)

    def adopt(self, rules: SettingRules, **changed: Value) -> None:
        """Go on by other rules, and with settings that the frame loop had to change for them."""
        with self._lock:
            self._rules = rules
            for name, value in changed.items():
                self._settings = _put(self._settings, name, value)


def _put(settings: Settings, name: str, value: Value) -> Settings:
    kept = tuple(value) if isinstance(value, list) else value
    return msgspec.structs.replace(settings, **{name: kept})
