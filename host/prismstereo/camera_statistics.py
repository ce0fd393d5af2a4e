"""What has happened on the line to a camera, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

from prismstereo_device.framing import LineStatistics
from prismstereo_device.protocol import Health

__all__ = ["CameraStatistics"]


@dataclass(frozen=True, slots=True)
class CameraStatistics:
    """What has happened on the line since it was opened.

    `frames` arrived, of which `partial` lack stripes; `lost` never arrived (gaps in their numbers: dropped by the camera
    or on the line); `not_taken` arrived but were pushed out before they were read. `malformed` messages came in good
    packets. `health` is the camera's last report. There were so many `sessions`, because the camera started anew (`reboots`)
    or its port was opened again (`replugs`); `repeated` requests were sent more than once.
    """

    frames: int
    partial: int
    lost: int
    not_taken: int
    malformed: int
    line: LineStatistics
    round_trip_us: int | None
    health: Health | None
    sessions: int = 1
    reboots: int = 0
    replugs: int = 0
    repeated: int = 0
