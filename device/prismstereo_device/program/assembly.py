"""The camera put together: what a configuration asks for, as the objects that a service serves."""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

from prismstereo_calibration import flash, schema
from prismstereo_calibration.model import Calibration
from prismstereo_device.camera import CameraDesk, CameraSource
from prismstereo_device.control.command_table import CommandTable, Machine
from prismstereo_device.control.controls import Controls
from prismstereo_device.control.identity import Names, board_temperature_c, device_id, identity_json, program_version
from prismstereo_device.control.optics_watch import OpticsWatch
from prismstereo_device.control.self_test import SelfTest
from prismstereo_device.control.settings import AUTO, SettingRules
from prismstereo_device.control.stills import Stills
from prismstereo_device.filters import FilterChain, chain
from prismstereo_device.filters import warm_up as warm_up_filters
from prismstereo_device.match import warm_up
from prismstereo_device.matching import Matching, filter_set
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.protocol.hello import Capability
from prismstereo_device.reopening import Patience
from prismstereo_device.sensors import Sensor, open_sensor
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.serving.log_ring import LogRing
from prismstereo_device.serving.rate_control import RateControl
from prismstereo_device.source import FrameSource
from prismstereo_device.state import CalibrationSlots, Disk, MemoryDisk, RealDisk, Shelf, Staging, accepts
from prismstereo_device.update import UpdateInbox, read_public_key
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

__all__ = [
    "Assembly",
    "Program",
    "Source",
    "assembled",
    "calibration_file",
    "disk_of",
    "filters_of",
    "first_calibration",
    "opened_sensor",
    "rate_control_of",
    "shelf_of",
]

logger = logging.getLogger(__name__)

_MOST_CALIBRATION_BYTES = 256 * 1024
_BYTES_PER_BAUD = 0.097  # 10 bits a byte, and a little spare


@dataclass(frozen=True, slots=True)
class Program:
    """What the program lends to the camera: a thread for chores, the log, a sign of life, and the way to end it."""

    worker: Executor
    log: LogRing
    alive: Callable[[], None]
    reboot: Callable[[], None]


class Source(FrameSource, Protocol):
    """A source of frames that holds a camera."""

    def stop(self) -> None:
        """Make no more frames and wait for none; from any thread."""
        ...

    def close(self) -> None:
        """Let go of the camera; after the last `read`."""
        ...


@dataclass(frozen=True, slots=True)
class Assembly:
    """Everything that a service needs of a camera; `compiling` are the threads that compile what its frames need."""

    source: Source
    who: DeviceIdentity
    shelf: Shelf
    commands: CommandTable | None
    rate_control: RateControl
    compiling: tuple[threading.Thread, ...]
    offers: Capability
    temperature_c: Callable[[], float | None]


def assembled(configuration: Configuration, sensor: Sensor, disk: Disk, program: Program) -> Assembly:
    """Put a camera together; the sensor is the source's to close from then on.

    `UsageError` for settings that this sensor cannot have, `DataError` for a calibration or a model that cannot be read.
    """
    wished, filters = configuration.settings, filters_of(configuration)
    if sensor.limits.rate_hz is None:  # it was opened with this rate, and keeps it
        wished = msgspec.structs.replace(wished, rate_hz=AUTO)
    slots = CalibrationSlots(disk)
    first = first_calibration(configuration, slots, sensor.rig)
    matching = Matching(first, wished, filters=filters)
    lens = matching.calibration.lens_position
    rules = SettingRules.of(sensor.limits, matching.picture, matcher=wished.matcher, calibrated_lens=lens)
    controls = Controls(wished.checked(rules), rules)
    who = DeviceIdentity(device_id(disk), secrets.randbits(32))
    source: CameraSource
    made = {
        ObjectNumber.LOG: program.log.content,
        ObjectNumber.IDENTITY: lambda: _identity(configuration, who, source, matching, controls),
    }
    shelf = shelf_of(configuration, disk, slots, first, controls.order_calibration, made, lambda: source.frame_size)
    desk = _desk(configuration, disk, shelf, controls, program)
    source = CameraSource(
        sensor,
        matching,
        desk,
        reopen=lambda: opened_sensor(configuration),
        patience=Patience(give_up_s=configuration.give_up_s),
        filter_set=filter_set(configuration.filters or None),
        preview_hz=configuration.preview_hz,
    )
    control, warmth = rate_control_of(configuration), _Warmth(source)
    machine = Machine(who.boot_id, warmth, control.choose, shelf.restore_factory, program.reboot, sensor.modes)
    commands = CommandTable(controls, desk.stills, desk.optics, machine, program.worker)
    begun = [warm_up(wished.matcher, matching.labels), None if filters is None else warm_up_filters(filters)]
    compiling = tuple(thread for thread in begun if thread is not None)
    return Assembly(source, who, shelf, commands, control, compiling, _OFFERS, warmth)


def _desk(configuration: Configuration, disk: Disk, shelf: Shelf, controls: Controls, program: Program) -> CameraDesk:
    """Make those whom the frame loop works for; what they find goes on the shelf."""

    def kept_as(number: ObjectNumber) -> Callable[[Held], None]:
        return lambda held: shelf.put(number, held)

    test = SelfTest(
        program.worker,
        disk,
        factory_copy=lambda: shelf.read(ObjectNumber.FACTORY_CALIBRATION) is not None,
        keep=kept_as(ObjectNumber.SELF_TEST),
        done=controls.tested,
    )
    return CameraDesk(
        controls,
        Stills(kept_as(ObjectNumber.STILL), program.worker, configuration.still_encoding),
        OpticsWatch(program.worker, disk, kept_as(ObjectNumber.OPTICS)),
        test.run,
        program.alive,
    )


_OFFERS = (
    Capability.WRITE
    | Capability.STILL
    | Capability.RAW
    | Capability.PREVIEW
    | Capability.ZONES
    | Capability.PLANES
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Warmth:
    """The sensor's temperature, else the board's."""

    source: CameraSource

    def __call__(self) -> float | None:
        own = self.source.temperature_c
        return board_temperature_c() if own is None else own


def opened_sensor(configuration: Configuration) -> Sensor:
    """Open the configured sensor; the errors of `open_sensor`, and `UsageError` where none is configured."""
    if not configuration.sensor:
        raise UsageError('no sensor is given: say --sensor KIND:..., or sensor = "..." in the configuration')
    rate_hz = configuration.settings.rate_hz
    return open_sensor(
        configuration.sensor, frames=configuration.frames, rate_hz=None if isinstance(rate_hz, str) else rate_hz
    )


def disk_of(folder: Path | None) -> Disk:
    """Open the folder for what outlives a restart; without one, memory, which the log says once."""
    if folder is None:
        logger.warning("nothing is kept over a restart: give --state DIR to keep calibrations and this unit's number")
        return MemoryDisk()
    return RealDisk(folder)


def filters_of(configuration: Configuration) -> FilterChain | None:
    """Read the configured filters; None where there are none."""
    return chain(configuration.filters) if configuration.filters else None


def calibration_file(path: Path) -> Calibration:
    """Read a calibration from JSON or flash bytes; `UsageError` where there is no such file, `DataError` for its content."""
    try:
        if path.stat().st_size > _MOST_CALIBRATION_BYTES:
            raise UsageError(
                f"{path} has {path.stat().st_size} bytes: a calibration has at most {_MOST_CALIBRATION_BYTES}"
            )
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(f"cannot read the calibration {path}: {error.strerror}") from error
    return schema.decode(content, str(path)) if content.lstrip()[:1] == b"{" else flash.unpack(content)


def first_calibration(configuration: Configuration, slots: CalibrationSlots, rig: Rig | None) -> bytes:
    """Give the flash bytes to begin with: what a host wrote, else the configured file, else what the rig promises."""
    if slots.active is not None:
        if configuration.calibration:
            logger.warning("the calibration that was written to this camera holds, not %s", configuration.calibration)
        return slots.active
    if configuration.calibration:
        return flash.pack(calibration_file(Path(configuration.calibration)))
    if rig is None:
        raise UsageError("this sensor does not know its rig: give the unit's calibration with --calibration FILE")
    return flash.pack(Calibration.nominal(rig))


def shelf_of(
    configuration: Configuration,
    disk: Disk,
    slots: CalibrationSlots,
    first: bytes,
    changed: Callable[[bytes], None],
    made: dict[ObjectNumber, Callable[[], bytes]],
    frame_size: Callable[[], tuple[int, int] | None],
) -> Shelf:
    """Make the shelf, with the `first` calibration on it as long as no other is written; `UsageError` for a bad update key."""

    def why_not(content: bytes) -> str | None:
        return accepts(frame_size())(content)  # the size is known once a frame has come

    updates = None
    if configuration.update_key:
        key = read_public_key(Path(configuration.update_key))
        updates = UpdateInbox(disk, key, product=configuration.product, installed_version=program_version())
    shelf = Shelf(
        slots,
        Staging(disk),
        accepts=why_not,
        changed=changed,
        made=made,
        updates=updates,
    )
    if slots.active is None:
        shelf.put(ObjectNumber.CALIBRATION, _held(first))
    return shelf


def _held(content: bytes) -> Held:
    """Give a calibration that no host wrote the version that it would have if one had: the start of its hash."""
    return Held(int.from_bytes(flash.digest(content)[:4], "little") or 1, content)


def _identity(
    configuration: Configuration, who: DeviceIdentity, source: CameraSource, matching: Matching, controls: Controls
) -> bytes:
    names = Names(configuration.product, configuration.serial, configuration.name)
    return identity_json(
        names, who, address=configuration.sensor, sensor=source.sensor, matching=matching, rules=controls.rules
    )


def rate_control_of(configuration: Configuration) -> RateControl:
    """Let the line decide how fine frames are, unless the settings say it; a lossless camera sends them exact."""
    bound = configuration.settings.bound
    exact = 0 if configuration.lossless else None
    return RateControl(
        configuration.target_hz,
        bound=exact if isinstance(bound, str) else bound,
        line_bytes_per_s=None if configuration.baud is None else configuration.baud * _BYTES_PER_BAUD,
    )
