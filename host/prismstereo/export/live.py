"""Frames of a camera that is there, as they come: for whoever passes them on while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from prismstereo.driver import StereoCamera
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.export.pairing import Pairing
from prismstereo_device.protocol import ReceivedFrame, calibration_hash
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DataError

__all__ = ["LiveFrames"]

_PICTURES_KEPT = 16


class LiveFrames:
    """What a camera sends, with its previews where these are streamed; the camera is its owner's.

    `clock_ns` stamps a frame. A frame waits for its picture while at most `late` newer ones arrive: with 0 it does not wait.
    """

    def __init__(self, camera: StereoCamera, clock_ns: Callable[[ReceivedFrame], int], late: Callable[[], int]) -> None:
        self._camera = camera
        self._clock_ns = clock_ns
        self._late = late
        self._previews = camera.stream(Channel.IMG, newest=_PICTURES_KEPT)
        self._held: tuple[bytes, Geometries] | None = None

    def __iter__(self) -> Iterator[ExportFrame]:
        """Give frames until the stream ends.

        Raises LinkLost as the camera's own iteration does, and DataError where the camera's calibration was replaced between a
        frame and the question for it: begin to iterate anew then.
        """
        pairing = Pairing()
        for received in self._camera:
            pairing.frame(received)
            while (picture := self._previews.take(0.0)) is not None:
                pairing.picture(picture)
            for frame, left in pairing.ready(self._late()):
                stamp_ns = self._clock_ns(frame)
                yield ExportFrame.of(frame.index, stamp_ns, frame.disparity, left, self._geometries(frame))

    def _geometries(self, frame: ReceivedFrame) -> Geometries:
        named = frame.calibration_hash
        if self._held is None or self._held[0] != named:
            from prismstereo_calibration import flash

            content = self._camera.calibration_bytes
            if not calibration_hash(content).startswith(named):
                raise DataError(
                    f"frame {frame.index} was made with calibration {named.hex()}, which the camera no longer has: take a "
                    "newer frame"
                )
            self._held = named, Geometries(flash.unpack(content))
        return self._held[1]
