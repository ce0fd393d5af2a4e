"""The two slots of a calibration that was refined: the file in use, and beside it the former one, to go back to.

The former calibration of `unit.json` is `unit.former.json`. Each file is written whole or not at all, in an order that loses
neither content wherever the power fails.
"""

from __future__ import annotations

from pathlib import Path

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import read, write
from prismstereo_hw.files import write_whole

__all__ = ["former_of", "keep_and_write", "restore"]


def former_of(path: str | Path) -> Path:
    """Return where the former calibration of a file is kept."""
    path = Path(path)
    return path.with_name(f"{path.stem}.former{path.suffix}")


def keep_and_write(path: str | Path, calibration: Calibration, former: str | Path) -> Path:
    """Write a calibration to `path`, and what it replaces beside it: the file there, or else the file `former`.

    Returns the former slot. On any failure `path` stays as it was, and `DataError` says why.
    """
    path = Path(path)
    replaced = path if path.is_file() else Path(former)
    read(replaced)  # what cannot be read cannot be gone back to
    kept = former_of(path)
    write_whole(kept, replaced.read_bytes())
    write(path, calibration)
    return kept


def restore(path: str | Path) -> Calibration:
    """Exchange a calibration file and its former one; return the one that is now in use.

    `CalibrationError` where there is no former one, or where it cannot be read: then nothing is changed.
    """
    path = Path(path)
    former = former_of(path)
    if not former.is_file():
        raise CalibrationError(f"there is no {former}: only a file that was refined has a former calibration")
    back = read(former)
    if not path.is_file():
        write_whole(path, former.read_bytes())
        return back
    given_up = path.read_bytes()
    waiting = path.with_name(f"{path.stem}.given-up{path.suffix}")
    write_whole(waiting, given_up)
    write_whole(path, former.read_bytes())
    waiting.replace(former)
    return back
