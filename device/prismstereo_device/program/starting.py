"""From a configuration to a running service, and to the end of it."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path

from prismstereo_device.control.chores import Chores
from prismstereo_device.control.identity import program_version
from prismstereo_device.link import Link
from prismstereo_device.match import create
from prismstereo_device.program.assembly import (
    Assembly,
    Program,
    Source,
    assembled,
    calibration_file,
    disk_of,
    filters_of,
    opened_sensor,
)
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.self_matching import matches_by_itself, self_matching
from prismstereo_device.serving.log_ring import LogRing
from prismstereo_device.serving.service import Service
from prismstereo_device.serving.status_led import FolderLed, NoLed
from prismstereo_device.serving.watchdog import Notifier
from prismstereo_device.state import Disk
from prismstereo_device.update import read_public_key
from prismstereo_hw.errors import UsageError

__all__ = ["opened_link", "serve", "what_would_run"]

logger = logging.getLogger(__name__)

_SOON_S = 1.0  # reading compiled kernels back from disk takes less
_GOODBYE_S = 0.5  # so that the answer to whoever asked for a restart is on the line before the service ends
_STOPPED_BY = (signal.SIGTERM, signal.SIGINT)


def serve(configuration: Configuration, log: LogRing, tell: Callable[[dict[str, object]], None]) -> bool:
    """Run until the link or the sensor ends, or it is told to stop; True: a host asked for a restart.

    `tell` is given where it listens, and at the end the counters. Raises whatever kept it from starting, or ended it.
    """
    rebooting, ending = threading.Event(), threading.Event()

    def reboot() -> None:
        rebooting.set()
        ending.set()

    with ExitStack() as stack:
        notifier = stack.enter_context(Notifier.from_environment())
        worker = stack.enter_context(Chores())
        disk = disk_of(configuration.state_folder)
        camera = _camera(configuration, disk, Program(worker, log, notifier.kick, reboot))
        stack.callback(camera.source.close)
        _wait_for_compilers(camera.compiling)
        link = stack.enter_context(opened_link(configuration))
        service = Service(
            camera.source,
            link,
            camera.who,
            objects=camera.shelf,
            commands=camera.commands,
            rate_control=camera.rate_control,
            lossless=configuration.lossless,
            offers=camera.offers,
            temperature_c=camera.temperature_c,
            last_error=lambda: log.last_error,
            notifier=notifier,
            led=FolderLed(Path(configuration.led)) if configuration.led else NoLed(),
        )
        tell({"listening": link.name})
        try:
            with _stopped_by_signals(ending):
                _run(service, camera.source, ending, rebooting)
        finally:
            tell({"statistics": asdict(service.statistics)})
    return rebooting.is_set()


def _run(service: Service, source: Source, ending: threading.Event, rebooting: threading.Event) -> None:
    """Serve until the service has ended by itself or `ending` is set."""

    def end() -> None:
        ending.wait()
        if rebooting.is_set():
            time.sleep(_GOODBYE_S)
        source.stop()
        service.stop()

    ender = threading.Thread(target=end, name="prismstereo-end", daemon=True)
    ender.start()
    try:
        service.run()
    finally:
        ending.set()
        ender.join()


def opened_link(configuration: Configuration) -> Link:
    """Open the configured link; `UsageError` for an address of no kind, `PortError` where it cannot be opened."""
    where = configuration.link
    if where == "pty":
        from prismstereo_device.link.pty_port import PtyPort

        return PtyPort(Path(configuration.symlink) if configuration.symlink else None, baud=configuration.baud)
    if where.startswith("tcp:"):
        from prismstereo_device.link.tcp import TcpServer

        host, _, port = where.removeprefix("tcp:").removeprefix("//").rpartition(":")
        if not (port.isascii() and port.isdigit()) or int(port) > 65535:
            raise UsageError(f"--link {where}: give tcp:HOST:PORT, e.g. tcp:127.0.0.1:4000; port 0 takes a free one")
        return TcpServer(host or "127.0.0.1", int(port))
    from prismstereo_device.link.serial_port import SerialPort

    return SerialPort(where, configuration.baud, rtscts=configuration.rtscts)


def what_would_run(configuration: Configuration) -> dict[str, object]:
    """Say what a configuration would start, without opening sensor, link or state; raises what would keep it from starting."""
    if not configuration.sensor:
        raise UsageError('no sensor is given: say --sensor KIND:..., or sensor = "..." in the configuration')
    create(configuration.settings.matcher)
    filters = filters_of(configuration)
    if configuration.update_key:
        read_public_key(Path(configuration.update_key))
    if configuration.calibration:
        calibration_file(Path(configuration.calibration))
    folder = configuration.state_folder
    return {
        "version": program_version(),
        "configuration": configuration.shown(),
        "state": None if folder is None else str(folder),
        "filters": 0 if filters is None else len(filters.filters),
    }


def _camera(configuration: Configuration, disk: Disk, program: Program) -> Assembly:
    if matches_by_itself(configuration.sensor):
        return self_matching(configuration, disk, program)
    sensor = opened_sensor(configuration)
    try:
        return assembled(configuration, sensor, disk, program)
    except BaseException:
        sensor.close()
        raise


def _wait_for_compilers(compiling: tuple[threading.Thread, ...]) -> None:
    """Let matcher and filters be read from disk, and say so if they have to be compiled, which takes longer."""
    until_s = time.monotonic() + _SOON_S
    for thread in compiling:
        thread.join(max(0.0, until_s - time.monotonic()))
    if any(thread.is_alive() for thread in compiling):
        logger.warning("compiling the matcher for this processor: some seconds, this once")


@contextmanager
def _stopped_by_signals(ending: threading.Event) -> Iterator[None]:
    """Let SIGTERM and SIGINT end the service instead of the process."""

    def stop(number: int, frame: object) -> None:
        del number, frame
        ending.set()

    before = {number: signal.signal(number, stop) for number in _STOPPED_BY}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
