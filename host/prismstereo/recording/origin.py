"""Where a recording comes from: the camera, its calibration, and both in a form that people can read."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from prismstereo.recording.notes import SessionNote
from prismstereo_hw.errors import DataError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera
    from prismstereo.meeting import CameraIdentity

__all__ = ["objects_of", "readable", "rig_of", "session_note"]


def objects_of(camera: StereoCamera) -> tuple[bytes, dict[str, object]]:
    """Fetch what every recording begins with: the calibration and what the camera says of itself, as far as it has them."""
    calibration, details = b"", dict[str, object]()
    with suppress(DataError):
        calibration = camera.calibration_bytes
    with suppress(DataError):
        details = camera.identity_details
    return calibration, details


def session_note(identity: CameraIdentity, session: int, host_us: int) -> SessionNote:
    """Say who the camera is in a session."""
    return SessionNote(
        session=session,
        device_id=identity.device_id.hex(),
        boot_id=identity.boot_id,
        calibration_hash=identity.calibration_hash.hex(),
        capabilities=int(identity.capabilities),
        version=identity.version,
        host_us=host_us,
    )


def rig_of(calibration: bytes) -> str:
    """Name the rig that a calibration is of; empty where the bytes are not those of one."""
    from prismstereo_calibration import flash

    try:
        return flash.unpack(calibration).rig
    except DataError:
        return ""


def readable(calibration: bytes) -> bytes:
    """Give the calibration as the JSON that people keep; nothing where the bytes are not those of one."""
    from prismstereo_calibration import flash
    from prismstereo_calibration.schema import encode

    try:
        return encode(flash.unpack(calibration))
    except DataError:
        return b""
