"""The calibration file that people keep: JSON, written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import msgspec

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.schema import MAX_BYTES, decode, encode
from prismstereo_hw.files import write_whole

__all__ = ["read", "write"]


def write(path: str | Path, calibration: Calibration) -> None:
    """Write a calibration file; on any failure the old file stays as it was and `DataError` says why."""
    write_whole(path, msgspec.json.format(encode(calibration), indent=2) + b"\n")


def read(path: str | Path) -> Calibration:
    """Read a calibration file; `CalibrationError` names the file and the field that is wrong."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise CalibrationError(f"there is no file {path}: make one with `prismstereo calibrate`") from error
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read: {error.strerror}") from error
    if len(text) > MAX_BYTES:
        raise CalibrationError(f"{path} has more than {MAX_BYTES} bytes: a calibration file is far smaller")
    return decode(text, str(path))
