"""Which calibrations a camera takes: sound ones, of its own frame size, that can be rectified."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from prismstereo_calibration import flash
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.errors import PrismStereoError

__all__ = ["accepts"]


def accepts(frame_size: tuple[int, int] | None) -> Callable[[bytes], str | None]:
    """Make the check of flash bytes for a sensor whose raw frames have this size (width, height; None: not known yet).

    The check gives None for what may become active, else the sentence that says why not, with the field.
    """

    def why_not(content: bytes) -> str | None:
        try:
            calibration = flash.unpack(content)
            made_for = calibration.frame_width, calibration.frame_height * calibration.left_view.exposures
            if frame_size is not None and made_for != frame_size:
                return (
                    f"frame_width_px and frame_height_px stand for frames of {made_for[0]}x{made_for[1]}, but this camera "
                    f"gives {frame_size[0]}x{frame_size[1]}: calibrate in this mode"
                )
            with np.errstate(all="ignore"):  # what overflows or is no number is refused by name where it matters
                rectification(calibration)
        except PrismStereoError as error:
            return str(error)
        except np.linalg.LinAlgError as error:
            return f"these cameras cannot be rectified ({error}): calibrate again"
        return None

    return why_not
