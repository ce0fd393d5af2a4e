"""A frame as it reaches whoever iterates over a camera: its depth, its points, its age; and the count of those that did not."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from prismstereo.clock import ClockMapping
from prismstereo.frame_pictures import FramePictures
from prismstereo_device.protocol import PictureKind, ReceivedFrame, ReceivedPicture
from prismstereo_device.sensors.base import StampQuality
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.cloud import PointCloud
    from prismstereo_calibration.rectification import Rectification

__all__ = ["CameraFrame", "FrameCamera", "FrameCounter", "FrameCounts"]

_FRAME = 0xFFFF_FFFF
_HALF_RANGE = 1 << 31


class FrameCamera(Protocol):
    """What a frame asks the camera that it came from."""

    @property
    def clock(self) -> ClockMapping | None:
        """The device's clock as seen from here."""

    @property
    def session(self) -> int:
        """The session under way."""

    @property
    def stamp_quality(self) -> StampQuality | None:
        """What the frames' stamps mean; None where the camera does not tell."""

    @property
    def pictures(self) -> FramePictures:
        """What has arrived beside the frames."""

    def depth(self, frame: ReceivedFrame) -> NDArray[np.float32]:
        """Depth (height, width) in the calibration's unit, NaN where unmatched."""
        ...

    def rectification(self, frame: ReceivedFrame) -> Rectification:
        """Give the geometry of a frame's map."""
        ...


@dataclass(frozen=True)
class CameraFrame(ReceivedFrame):
    """A frame, and in which session with the camera it came: where `session` grows, there is a gap before the frame.

    Sessions count from 1; after a reboot of the camera `index` and `timestamp_us` begin anew. `heard_us` is the host's
    monotonic clock when the frame was whole, `clock` the camera's clock as it was known then. What is computed (`depth_mm`,
    `points`) is computed when it is first asked for; the calibration is fetched once. All of it may raise LinkLost where the
    camera does not answer, DataError where it no longer has the calibration that the frame was made with.
    """

    session: int = 1
    heard_us: int = 0
    clock: ClockMapping | None = None
    camera: FrameCamera | None = field(default=None, repr=False, compare=False)

    @classmethod
    def of(
        cls,
        frame: ReceivedFrame,
        session: int,
        *,
        heard_us: int = 0,
        clock: ClockMapping | None = None,
        camera: FrameCamera | None = None,
    ) -> CameraFrame:
        """Say in which session, when, and from which camera a frame came."""
        plain = {one.name: getattr(frame, one.name) for one in fields(ReceivedFrame)}
        return cls(**plain, session=session, heard_us=heard_us, clock=clock, camera=camera)

    @property
    def width(self) -> int:
        """Columns of the disparity map."""
        return int(self.disparity.disparity_px.shape[1])

    @property
    def height(self) -> int:
        """Rows of the disparity map."""
        return int(self.disparity.disparity_px.shape[0])

    @cached_property
    def depth_mm(self) -> NDArray[np.float32]:
        """Depth (height, width) along the rectified z axis in mm, NaN where unmatched, inf where beyond the far end.

        Raises UsageError where the calibration is not in mm: `camera.depth(frame)` has it in its own unit.
        """
        camera = self._its_camera
        if any(self.calibration_hash) and (unit := camera.rectification(self).unit) != "mm":
            raise UsageError(f"this camera's calibration is in {unit}, not in mm: use camera.depth(frame)")
        return camera.depth(self)

    @cached_property
    def points(self) -> NDArray[np.float32]:
        """Points (height, width, 3) in mm of the rectified left camera (x right, y down, z forward), NaN where none is."""
        depth_mm = self.depth_mm
        known = np.where(np.isfinite(depth_mm), depth_mm, np.float32(np.nan))
        return self._its_camera.rectification(self).points(known)

    def cloud(self) -> PointCloud:
        """Give the matched points as a cloud, painted with the preview where that has come."""
        from prismstereo.cloud import PointCloud

        points = self.points
        kept = np.isfinite(points[..., 2])
        painted = self._plane(PictureKind.PREVIEW)
        if painted is None:
            return PointCloud(points[kept])
        rgb = painted[..., ::-1] if painted.ndim == 3 else np.repeat(painted[..., None], 3, axis=2)
        return PointCloud(points[kept], np.ascontiguousarray(rgb[kept]))

    @property
    def host_time_us(self) -> int | None:
        """Mid-exposure by the host's `time.monotonic`, off by at most `host_time_bound_us`.

        None where the stamps come from no clock (a simulation, old pictures), or before the camera has answered a probe.
        """
        mapping = self._mapping
        return None if mapping is None else mapping.host_time_us(self.timestamp_us)

    @property
    def host_time_bound_us(self) -> float | None:
        """How far `host_time_us` can be off; None where that is."""
        mapping = self._mapping
        return None if mapping is None else mapping.bound_us

    @property
    def age_us(self) -> int:
        """Microseconds since mid-exposure; where `host_time_us` is not known, since the frame was whole here.

        It grows while a frame waits for its reader: a robot that asks it acts on nothing stale.
        """
        since_us = self.host_time_us
        return _clock_us() - (self.heard_us if since_us is None else since_us)

    @property
    def preview(self) -> NDArray[np.uint8] | None:
        """The rectified left picture (height, width[, 3]) uint8, BGR; None where it is not streamed, or not here yet."""
        picture = self.picture(PictureKind.PREVIEW)
        return None if picture is None else picture.pixels()

    @property
    def confidence(self) -> NDArray[np.uint8] | None:
        """How sure each match is, (height, width) uint8, told for every 4th pixel each way; None as for `preview`."""
        return self._plane(PictureKind.CONFIDENCE)

    @property
    def reasons(self) -> NDArray[np.uint8] | None:
        """Why pixels are unmatched, (height, width) uint8 `Reason`, told as `confidence` is; None as for `preview`."""
        return self._plane(PictureKind.REASONS)

    @property
    def zones(self) -> ZoneDistances | None:
        """The nearest distance in each zone of the picture; None as for `preview`."""
        return None if self.camera is None else self.camera.pictures.zones(self.session, self.index)

    def picture(self, kind: PictureKind, timeout_s: float = 0.0) -> ReceivedPicture | None:
        """Wait for what belongs to this frame; None when the time is over, or when a later frame's has come instead.

        Pictures are compressed beside the stream and come a little after their frame. Raw frames are not kept: see
        `StereoCamera.stream`.
        """
        if self.camera is None:
            return None
        return self.camera.pictures.picture(kind.channel, self.session, self.index, timeout_s)

    @property
    def _its_camera(self) -> FrameCamera:
        if self.camera is None:
            raise UsageError(f"frame {self.index} is of no open camera: only its disparity is known")
        return self.camera

    @property
    def _mapping(self) -> ClockMapping | None:
        camera = self.camera
        if camera is None:
            return self.clock
        if self.clock is None and camera.session != self.session:
            return None
        return None if camera.stamp_quality is StampQuality.MADE else self.clock or camera.clock

    def _plane(self, kind: PictureKind) -> NDArray[np.uint8] | None:
        """Give a picture of this view in the size of the map, each pixel from where it lies."""
        picture = self.picture(kind)
        if picture is None:
            return None
        _, _, whole_width, whole_height = picture.head.crop
        rows = np.arange(self.height) * whole_height // self.height // picture.head.step
        columns = np.arange(self.width) * whole_width // self.width // picture.head.step
        return picture.pixels()[rows][:, columns]


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Frames that arrived, of which `partial` lack stripes; `lost`: gaps in their numbers."""

    frames: int = 0
    partial: int = 0
    lost: int = 0


class FrameCounter:
    """Counts frames and the gaps in their numbers, which go on modulo 2^32 until the camera starts anew."""

    def __init__(self) -> None:
        self._newest: int | None = None
        self._counts = FrameCounts()

    @property
    def counts(self) -> FrameCounts:
        """The counters so far."""
        return self._counts

    def restart(self) -> None:
        """Expect any number next."""
        self._newest = None

    def count(self, frame: ReceivedFrame) -> None:
        """Count the newest frame."""
        gap = 0 if self._newest is None else (frame.index - self._newest - 1) & _FRAME
        counts = self._counts
        lost = counts.lost + (gap if gap < _HALF_RANGE else 0)
        self._counts = FrameCounts(counts.frames + 1, counts.partial + frame.partial, lost)
        self._newest = frame.index


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
