"""The error of this folder; the whole tree is drawn in `prismstereo_hw.errors`."""

from __future__ import annotations

from prismstereo_hw.errors import DataError

__all__ = ["CalibrationError"]


class CalibrationError(DataError):
    """A calibration that cannot be solved, is not sane, or does not belong to the frames at hand."""
