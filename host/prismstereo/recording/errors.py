"""What can be wrong with a recording."""

from __future__ import annotations

from prismstereo_hw.errors import DataError

__all__ = ["RecordingError"]


class RecordingError(DataError):
    """A file that is no recording of a prism stereo sensor, or a recording that could not be kept."""
