"""Every error this product raises on purpose, as one tree.

    PrismStereoError                what went wrong, in one sentence: the value, the rule, the mend
    |- UsageError          exit 2   a wish that cannot be granted (flags that contradict each other)
    |  `- RigError                  a rig that cannot be built
    |- DeviceError         exit 3   a port or a camera that is not there, or went away
    |  |- PortError                 (device) the port cannot be opened
    |  |- LinkLost                  (device) the other end fell silent in the middle
    |  |- OutcomeUnknown            (host) a request was under way when the session changed: it may have been run
    |  `- StorageError              (device) the camera's own storage is full or broken
    `- DataError           exit 4   a file, a frame or a message that is not what it says
       |- ImageError                an unreadable or truncated picture
       |- SessionError              a session folder with a part missing
       |- CalibrationError          (calibration) a calibration that does not belong, or cannot be solved
       |- WireError                 (device) bytes that do not follow the wire format
       `- RecordingError            (host) a file that is no recording, or one that could not be kept

The command line alone turns these into exit codes; a library user catches `PrismStereoError`.
"""

from __future__ import annotations

from typing import ClassVar

__all__ = ["DataError", "DeviceError", "ImageError", "PrismStereoError", "RigError", "SessionError", "UsageError"]


class PrismStereoError(Exception):
    """Anything that is wrong with the input or the world, and not with this program."""

    exit_code: ClassVar[int] = 4


class UsageError(PrismStereoError):
    """A wish that cannot be granted as it was put."""

    exit_code: ClassVar[int] = 2


class RigError(UsageError):
    """A rig file that does not describe a rig that can be built."""


class DeviceError(PrismStereoError):
    """A port or a camera that is absent, busy, or went away."""

    exit_code: ClassVar[int] = 3


class DataError(PrismStereoError):
    """A file or a message that is not what it claims to be."""


class ImageError(DataError):
    """A picture that cannot be read, or has the wrong size."""


class SessionError(DataError):
    """A session folder in which something is missing or contradicts itself."""
