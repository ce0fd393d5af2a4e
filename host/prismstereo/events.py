"""What happens to the connection with a sensor, told to whoever wants to know."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["CameraEvent", "CameraState", "EventKind"]


class CameraState(Enum):
    """How things stand with the sensor."""

    CONNECTED = "connected"
    SILENT = "silent"  # nothing was heard for half a second: it is being called
    SEARCHING = "searching"  # the port or the session is gone: it is being opened, or met, anew
    ENDED = "ended"  # closed, or lost for good


class EventKind(Enum):
    """What has happened."""

    SILENT = "silent"  # nothing was heard for half a second
    HEARD = "heard"  # ... and now it is, in the same session: nothing is lost but frames
    LOST = "lost"  # the port or the session is gone
    REPLUGGED = "replugged"  # a new session on a port that was opened again
    REBOOTED = "rebooted"  # a new session with a device that has started anew: its clock and frame numbers begin anew
    RENEWED = "renewed"  # a new session on the same port, with a device that was there all the time
    ENDED = "ended"  # lost for good


@dataclass(frozen=True, slots=True)
class CameraEvent:
    """Something that happened to the connection; `session` counts from 1, `host_us` is the host's monotonic clock."""

    kind: EventKind
    session: int
    host_us: int
    text: str
