"""depthai itself: imported late, kept quiet, and kept from rewriting a camera's calibration."""

from __future__ import annotations

import importlib
import os
from types import ModuleType

from prismstereo_hw.errors import DeviceError

__all__ = ["load_depthai"]

_SAID_BEFORE_IMPORT = {  # what a user has set is left as it is
    "DEPTHAI_LEVEL": "off",  # its warnings go to standard output, where ours is read by programs
    "DEPTHAI_AUTOCALIBRATION": "OFF",  # is on by default, and flashes what it finds
    "DEPTHAI_INSTALL_SIGNAL_HANDLER": "0",  # signals are the program's
}


def load_depthai() -> ModuleType:
    """Import depthai, a second and 100 MB the first time; `DeviceError` where it is not installed."""
    for name, value in _SAID_BEFORE_IMPORT.items():
        os.environ.setdefault(name, value)
    try:
        return importlib.import_module("depthai")
    except ImportError as error:
        raise DeviceError(
            f"an OAK camera needs depthai, which cannot be imported ({error}): install it with `pip install 'depthai>=3'`"
        ) from error
