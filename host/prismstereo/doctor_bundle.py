"""What a bug report needs, in one file: versions, findings, the sensor's own words, its calibration, some seconds of recording.

Everything is gathered first, so that it can be shown before it is written; nothing is sent anywhere. Names, home folders and
passwords are taken out of every text.
"""

from __future__ import annotations

import io
import json
import platform
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from prismstereo.veil import Veil
from prismstereo_hw.errors import DataError, PrismStereoError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera

__all__ = ["BundlePart", "installation_parts", "packed", "sensor_parts"]

_OWN = "prismstereo"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of no use to anybody, and the same bytes each time


@dataclass(frozen=True, slots=True)
class BundlePart:
    """One file of the bundle: its name there, its bytes, and what it is."""

    name: str
    content: bytes
    about: str


def installation_parts(checks: Sequence[dict[str, object]], veil: Veil) -> list[BundlePart]:
    """Say what is installed here, and what `prismstereo doctor` found."""
    versions = {
        "prismstereo": _version(_OWN),
        "python": sys.version.split()[0],
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "packages": {name: _version(name) for name in _required()},
    }
    return [
        BundlePart("versions.json", _json(versions, veil), "versions of Python, the system and the libraries"),
        BundlePart("checks.json", _json(list(checks), veil), "what prismstereo doctor found here"),
    ]


def sensor_parts(camera: StereoCamera, seconds: float, veil: Veil) -> list[BundlePart]:
    """Ask a sensor for everything that tells how it is, and record it for some seconds.

    What it does not give is named, with its reason, in sensor/missing.json. Raises nothing of ours.
    """
    missing: dict[str, str] = {}
    parts: list[BundlePart] = []

    def gather(name: str, about: str, make: Callable[[], bytes]) -> None:
        try:
            parts.append(BundlePart(f"sensor/{name}", make(), about))
        except PrismStereoError as error:
            missing[name] = str(error)

    gather(
        "recording.mcap",
        f"{seconds:g} s of what it sends; pictures only if they are on",
        lambda: _recording(camera, seconds, veil),
    )
    gather("identity.json", "who it is and what it can do", lambda: _json(camera.identity_details, veil))
    gather("settings.json", "its settings", lambda: _json(_settings(camera), veil))
    gather("self_test.json", "what it finds of itself", lambda: _json(camera.self_test(), veil))
    gather("optics.json", "what it finds of its lens, mirrors and prism", lambda: _json(camera.optics(), veil))
    gather("log.txt", "the last lines of its log", lambda: veil.text(camera.log()).encode())
    gather("calibration.bin", "its calibration, as it holds it", camera.read_calibration)
    gather("calibration.json", "the same, to be read", lambda: _calibration(camera))
    gather("statistics.json", "what happened on the line", lambda: _json(_statistics(camera), veil))
    if missing:
        parts.append(BundlePart("sensor/missing.json", _json(missing, veil), "what it did not give, and why"))
    return parts


def packed(parts: Sequence[BundlePart]) -> bytes:
    """Give the bundle as the bytes of a ZIP file, with a table of contents in front."""
    told = "".join(f"{part.name:28} {len(part.content):10} bytes  {part.about}\n" for part in parts)
    contents = (
        f"Gathered by `prismstereo doctor --bundle`. It was sent nowhere: whoever has it got it from you.\n\n{told}"
    )
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as bundle:
        for part in (BundlePart("README.txt", contents.encode(), ""), *parts):
            bundle.writestr(zipfile.ZipInfo(part.name, _EPOCH), part.content, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _required() -> list[str]:
    """Name what this product says that it needs, extras included."""
    try:
        lines = metadata.requires(_OWN) or []
    except metadata.PackageNotFoundError:
        return []
    return sorted(
        {line.split(";")[0].strip().split("[")[0].split(">")[0].split("<")[0].split("=")[0] for line in lines}
    )


def _json(value: object, veil: Veil) -> bytes:
    return (json.dumps(veil.plain(value), indent=2, default=str) + "\n").encode()


def _settings(camera: StereoCamera) -> dict[str, object]:
    return {name: asdict(setting) for name, setting in camera.settings.items()}


def _statistics(camera: StereoCamera) -> dict[str, object]:
    clock, identity = camera.clock, camera.identity
    return {
        "statistics": asdict(camera.statistics),
        "clock": None if clock is None else asdict(clock),
        "device_id": identity.device_id.hex(),
        "boot_id": identity.boot_id,
        "protocol_version": identity.version,
        "mtu": identity.mtu,
        "can": [able.name for able in identity.capabilities],
        "calibration_hash": identity.calibration_hash.hex(),
    }


def _calibration(camera: StereoCamera) -> bytes:
    from prismstereo_calibration import flash
    from prismstereo_calibration.schema import encode

    return encode(flash.unpack(camera.read_calibration()))


def _recording(camera: StereoCamera, seconds: float, veil: Veil) -> bytes:
    """Record to a folder of our own, and look into the file before it is taken."""
    from prismstereo.recording import Recorder

    with tempfile.TemporaryDirectory(prefix="prismstereo-") as folder:
        with Recorder(camera, folder, label="doctor", views_hz=0.0) as recorder:
            recorder.wait(seconds)
        if recorder.reason:
            raise DataError(f"the recording ended early: {recorder.reason}")
        _require_discreet(recorder.path, veil)
        return recorder.path.read_bytes()


def _require_discreet(path: Path, veil: Veil) -> None:
    """Refuse a recording that names a home folder: packed as it is, it cannot be taken out."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        reader = make_reader(file)
        inside = [message.data for _, _, message in reader.iter_messages()]
        inside += [entry.data for entry in reader.iter_attachments()]
        inside += [json.dumps(entry.metadata).encode() for entry in reader.iter_metadata()]
    if any(veil.betrayed_by(data) for data in inside):
        raise DataError(
            "the recording holds the name of a home folder, and is left out: open the sensor by its port's own name"
        )
