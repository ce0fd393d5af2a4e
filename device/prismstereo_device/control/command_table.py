"""What a host can ask by name, and who does it. Every answer comes at once; what takes longer is ordered and read later."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

from prismstereo_device.control.controls import Controls
from prismstereo_device.control.optics_watch import OpticsWatch
from prismstereo_device.control.stills import StillRequest, Stills
from prismstereo_device.objects import Progress, WriteStatus
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus, Value
from prismstereo_device.sensors.base import SensorMode
from prismstereo_hw.errors import UsageError

__all__ = ["ACTIONS", "CommandTable", "Machine"]

logger = logging.getLogger(__name__)

ACTIONS = {
    "still": "take a full-sensor still: [number] or [number, x, y, width, height]; `get still` tells when it is ready",
    "self_test": "let the camera look at itself; the findings are object 7",
    "optics": "look at lens, mirrors and prism now; the findings are object 8",
    "reboot": "end the service, to be started again",
    "restore_calibration": "make the factory calibration active again",
}


@dataclass(frozen=True, slots=True)
class Machine:
    """What the table needs of the program around it.

    `choose_bound` pins the coder's bound (None: automatic), `restore` makes the factory calibration active and may take a
    second, `reboot` ends the service, once the answer is out. `modes` are the sensor's, for the borders of a still.
    """

    boot_id: int
    temperature_c: Callable[[], float | None]
    choose_bound: Callable[[int | None], None]
    restore: Callable[[], Progress]
    reboot: Callable[[], None]
    modes: tuple[SensorMode, ...] = ()


class CommandTable:
    """Answers commands, one at a time and within a millisecond; what has to wait for a frame or a disk goes elsewhere."""

    def __init__(
        self, controls: Controls, stills: Stills, optics: OpticsWatch, machine: Machine, worker: Executor
    ) -> None:
        self._controls, self._stills, self._optics = controls, stills, optics
        self._machine, self._worker = machine, worker
        self._started_s = time.monotonic()
        self._restoring = threading.Event()
        self._told: Mapping[str, Callable[[], Value]] = {
            "still": lambda: stills.state,
            "uptime_s": lambda: round(time.monotonic() - self._started_s, 1),
            "temperature_c": machine.temperature_c,
            "boot_id": lambda: machine.boot_id,
        }
        self._actions: Mapping[str, Callable[[Value], CommandReply]] = {
            "still": self._still,
            "self_test": self._self_test,
            "optics": self._look,
            "reboot": self._reboot,
            "restore_calibration": self._restore,
        }

    def answer(self, command: Command) -> CommandReply:
        """Do what a command says, or say why not; never raises."""
        try:
            match command.verb:
                case "get":
                    return self._get(command.name)
                case "set":
                    return self._set(command.name, command.value)
                case "do":
                    return self._do(command.name, command.value)
        except UsageError as error:
            return CommandReply(CommandStatus.REFUSED, why=str(error))

    def _get(self, name: str) -> CommandReply:
        if name in self._controls.rules:
            return CommandReply(CommandStatus.OK, self._controls.settings.value(name))
        if name in self._told:
            return CommandReply(CommandStatus.OK, self._told[name]())
        return _unknown(name, (*self._controls.rules, *self._told))

    def _set(self, name: str, value: Value) -> CommandReply:
        if name in self._told:
            return CommandReply(CommandStatus.REFUSED, why=f"{name} can only be asked for: use get")
        if name not in self._controls.rules:
            return _unknown(name, tuple(self._controls.rules))
        settings = self._controls.change(name, value)
        if name == "bound":
            self._machine.choose_bound(None if isinstance(settings.bound, str) else settings.bound)
        return CommandReply(CommandStatus.OK, settings.value(name))

    def _do(self, name: str, value: Value) -> CommandReply:
        if name not in self._actions:
            return _unknown(name, tuple(self._actions))
        return self._actions[name](value)

    def _still(self, value: Value) -> CommandReply:
        request = StillRequest.of(value, self._machine.modes)
        if not self._stills.ask(request):
            return _busy("another still is being taken: ask for its state until it is ready")
        return CommandReply(CommandStatus.OK, request.number)

    def _self_test(self, value: Value) -> CommandReply:
        del value
        ordered = self._controls.order_self_test()
        return (
            CommandReply(CommandStatus.OK, value=True)
            if ordered
            else _busy("a self-test is under way: read its object")
        )

    def _look(self, value: Value) -> CommandReply:
        del value
        asked = self._optics.ask()
        return CommandReply(CommandStatus.OK, value=True) if asked else _busy("a look is being taken: read its object")

    def _reboot(self, value: Value) -> CommandReply:
        del value
        logger.warning("a host asks for a restart of the service")
        self._machine.reboot()
        return CommandReply(CommandStatus.OK, value=True)

    def _restore(self, value: Value) -> CommandReply:
        del value
        if self._restoring.is_set():
            return _busy("a calibration is being restored")
        self._restoring.set()
        self._worker.submit(self._restore_now)
        return CommandReply(CommandStatus.OK, value=True)

    def _restore_now(self) -> None:
        try:
            progress = self._machine.restore()
            if progress.status is not WriteStatus.OK:
                logger.error("the factory calibration was not restored: %s", progress.why)
        finally:
            self._restoring.clear()


def _unknown(name: str, names: tuple[str, ...]) -> CommandReply:
    return CommandReply(CommandStatus.UNKNOWN, why=f"there is no {name} here: {', '.join(names)}")


def _busy(why: str) -> CommandReply:
    return CommandReply(CommandStatus.BUSY, why=why)
