"""`prismstereo record`: everything that a camera sends, into a file that survives a power cut."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import click

from prismstereo.cli.baud import baud_option
from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera
    from prismstereo.recording import Recorder

_FIRST_FRAME_S = 20.0  # to the first frame, while a matcher is compiled; a stream of raw frames alone has none
_LOOK_EVERY_S = 0.1
_MEET_S = 10.0


@click.command("record", epilog="Example:  prismstereo record /dev/ttyACM0 --seconds 60 --out recordings")
@click.argument("target", required=False)
@click.option("--port", metavar="TARGET", help="The same as TARGET.")
@click.option("--simulated", metavar="RIG[:SCENE]", help="The same as TARGET simulated:RIG[:SCENE].")
@baud_option
@click.option("--seconds", type=click.FloatRange(min=0.1), help="Stop so long after the first frame; else on Ctrl-C.")
@click.option("--raw", is_flag=True, help="Keep the sensor's own frames too, so that depth can be computed anew.")
@click.option("--preview", is_flag=True, help="Keep the rectified left picture too.")
@click.option("--label", default="", help="What you want to say; it stands inside of the file.")
@click.option("--views-hz", default=2.0, show_default=True, type=click.FloatRange(0, 100),
              help="Depth and preview pictures a second for other programs; 0: none.")  # fmt: skip
@click.option("--keep-free-mb", type=click.FloatRange(min=0),
              help="Stop when less is left on the disk. Default: 5 % of it or 500 MB, whichever is less.")  # fmt: skip
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for the recording.")
@json_option
def command(
    target: str | None, port: str | None, simulated: str | None, baud: int | None, seconds: float | None, raw: bool,
    preview: bool, label: str, views_hz: float, keep_free_mb: float | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Record the sensor at TARGET (see `prismstereo devices --help`; default: the one on USB) into a new MCAP file in a folder.

    The file is named by time (UTC) and device. It holds every packet of the device with check sums, the calibration, events,
    and pictures in standard schemas for other programs. It is made safe every second; on Ctrl-C, SIGTERM, or when the disk
    gets full, it is ended in good order.
    """
    from prismstereo.opening import open_camera
    from prismstereo.recording import Recorder

    least = None if keep_free_mb is None else round(keep_free_mb * 1e6)
    with (
        _stop_signals() as stopping,
        open_camera(_target(target, port, simulated), baud=baud, timeout_s=_MEET_S) as camera,
        _switched_on(camera, raw=raw, preview=preview),
    ):
        with Recorder(camera, out, label=label, views_hz=views_hz, least_free_bytes=least) as recorder:
            click.echo(f"recording {camera.identity.device_id.hex()} into {recorder.path}", err=True)
            _wait(camera, recorder, stopping, seconds)
        _tell(camera, recorder, as_json=as_json)


def _wait(camera: StereoCamera, recorder: Recorder, stopping: threading.Event, seconds: float | None) -> None:
    """Wait for whatever ends the recording first: the time, a signal, the disk, the camera."""
    from prismstereo.events import CameraState
    from prismstereo_device.protocol import HealthFlag

    begun_s = time.monotonic()
    end_s: float | None = None
    while not (stopping.is_set() or recorder.wait(_LOOK_EVERY_S)):
        seen, now_s = camera.statistics, time.monotonic()
        if seen.health is not None and HealthFlag.END_OF_STREAM in seen.health.flags:
            return
        if seconds is not None and end_s is None and (seen.frames or now_s - begun_s > _FIRST_FRAME_S):
            end_s = now_s + seconds
        if camera.state is CameraState.ENDED or (end_s is not None and now_s >= end_s):
            return


def _tell(camera: StereoCamera, recorder: Recorder, *, as_json: bool) -> None:
    from prismstereo.events import CameraState
    from prismstereo.recording import RecordingError
    from prismstereo_device.link import LinkLost

    written, seen = recorder.statistics, camera.statistics
    result: dict[str, object] = {
        "file": recorder.path,
        "seconds": written.seconds,
        "bytes": written.bytes,
        "packets": written.packets,
        "packets_dropped": written.dropped,
        "sessions": written.sessions,
        "frames": seen.frames,
        "frames_partial": seen.partial,
        "frames_lost": seen.lost,
        "pictures_dropped": 0 if seen.health is None else seen.health.pictures_dropped,
        "reason": recorder.reason or None,
    }
    lines = [
        f"{recorder.path}: {written.seconds:.1f} s, {written.bytes / 1e6:.1f} MB, {written.packets} packets, "
        f"{seen.frames} frames ({seen.partial} partial, {seen.lost} lost on the way)",
        f"{written.dropped} packets dropped because the disk was slow, {result['pictures_dropped']} pictures by the camera",
    ]
    say(result, lines, as_json=as_json)
    if recorder.reason:
        raise RecordingError(f"the recording ended early, and is readable up to there: {recorder.reason}")
    if camera.state is CameraState.ENDED:
        raise LinkLost("the sensor went away for good: what came before is recorded")


def _target(target: str | None, port: str | None, simulated: str | None) -> str | None:
    """Return what to record: said once, in whichever way."""
    said = [
        name for name in (target, port, None if simulated is None else f"simulated:{simulated}") if name is not None
    ]
    if len(said) > 1:
        raise UsageError(f"{len(said)} sensors to record ({', '.join(said)}): say one")
    return said[0] if said else None


@contextmanager
def _switched_on(camera: StereoCamera, *, raw: bool, preview: bool) -> Iterator[None]:
    """Let the camera send what else is to be recorded, and leave it afterwards as it was."""
    from prismstereo_hw.errors import DeviceError

    wanted = [name for name, on in (("raw", raw), ("preview", preview)) if on]
    before = {name: camera.get(name) for name in wanted}
    for name in wanted:
        camera.set(name, value=True)
    try:
        yield
    finally:
        for name, value in before.items():
            with suppress(DeviceError):  # where it is gone, its settings are gone with it
                camera.set(name, value)


@contextmanager
def _stop_signals() -> Iterator[threading.Event]:
    """Take SIGINT and SIGTERM as the wish to stop in good order."""
    stopping = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        stopping.set()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
