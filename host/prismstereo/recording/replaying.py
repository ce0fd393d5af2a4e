"""A recording opened as a camera.

    with replay("20260101-120000-0011223344556677.mcap") as camera:
        for frame in camera:
            depth_mm = camera.depth(frame)

The loop ends where the recording does.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from prismstereo.recording.recording_link import RecordingLink
from prismstereo_device.link import Link, PortError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera

__all__ = ["no_other", "replay"]


def replay(path: str | Path, *, pace: float | None = 1.0, start_s: float = 0.0, **options: Any) -> StereoCamera:
    """Open a recording as a camera, `start_s` seconds from its beginning; `options` are those of `StereoCamera`."""
    from prismstereo.driver import StereoCamera

    link = RecordingLink(path, pace=pace, start_s=start_s)
    try:
        return StereoCamera(link, reopen=no_other, **options)
    except BaseException:
        link.close()
        raise


def no_other() -> Link:
    """Say that a recording cannot be plugged in again; a camera that is given this goes on where the recorded one rebooted."""
    raise PortError("a recording has no port to open again")
