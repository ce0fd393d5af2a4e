"""From a raw frame to what was asked for of it: disparity, preview, raw pixels, zones; now and then a look at the optics."""

from __future__ import annotations

import logging
from dataclasses import replace

from prismstereo_device.control.optics_watch import OpticsWatch
from prismstereo_device.control.settings import Settings
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.matching import Matching
from prismstereo_device.rectify import RectifiedPair
from prismstereo_device.source import ProducedFrame
from prismstereo_device.timing import Timing
from prismstereo_hw.errors import DataError, PrismStereoError, UsageError
from prismstereo_hw.frame import RawFrame

__all__ = ["FrameMaker"]

logger = logging.getLogger(__name__)


class FrameMaker:
    """Makes frames of one camera; used by the frame loop alone.

    A frame that does not fit the calibration goes out unmatched: the log says so once, and `unfit` says why until one fits.
    Previews come `preview_hz` times a second of the frames' stamps at most; `filter_set` goes into every frame's head.
    """

    def __init__(
        self, matching: Matching, optics: OpticsWatch, timing: Timing, *, filter_set: int, preview_hz: float
    ) -> None:
        self._matching, self._optics, self._timing = matching, optics, timing
        self._filter_set, self._preview_us = filter_set, round(1e6 / preview_hz)
        self._preview_due_us = 0
        self._fitted = False
        self.unfit: PrismStereoError | None = None

    @property
    def never_fitted(self) -> PrismStereoError | None:
        """Why not a single frame could be matched; None where one was, or none had to be."""
        return None if self._fitted else self.unfit

    def make(self, frame: RawFrame, settings: Settings) -> ProducedFrame:
        """Make of a frame exactly what the settings ask for; never raises for a frame that does not fit."""
        made = ProducedFrame(
            frame.index,
            frame.timestamp_us,
            frame.lens_position,
            None,
            calibration_hash=self._matching.calibration_hash,
            filter_set=self._filter_set,
            raw=frame.pixels if settings.raw else None,
        )
        looks, preview = self._optics.due(), settings.preview and self._preview_is_due(frame.timestamp_us)
        if not (settings.matches or looks or preview):
            return made
        try:
            return self._seen(frame, made, settings, looks=looks, preview=preview)
        except (DataError, UsageError) as error:
            if settings.matches or preview:
                self._say_unfit(error)
            return made

    def _preview_is_due(self, timestamp_us: int) -> bool:
        """Tell whether a preview is due; those that were late do not shift the next, and a clock that jumped begins anew."""
        ahead_us = self._preview_due_us - timestamp_us
        if not -self._preview_us < ahead_us <= self._preview_us:
            self._preview_due_us = timestamp_us
        if timestamp_us < self._preview_due_us:
            return False
        self._preview_due_us += self._preview_us
        return True

    def _seen(
        self, frame: RawFrame, made: ProducedFrame, settings: Settings, *, looks: bool, preview: bool
    ) -> ProducedFrame:
        """Do everything that needs the rectified pair."""
        pipeline = self._matching.pipeline
        views = pipeline.split(frame)
        pair = pipeline.rectifier.rectify(views)
        disparity = self._matched(pair) if settings.matches else None
        if preview:
            made = replace(made, preview=pipeline.rectifier.left_picture(views))
        if disparity is not None and settings.zones:
            made = replace(made, zones=self._matching.zones.find(disparity, frame.index, frame.timestamp_us))
        if disparity is not None and settings.stream:
            made = replace(made, disparity=_asked(disparity, settings))
        if looks:
            self._optics.look(self._matching.calibration_hash, frame.pixels, pair, disparity)
        return made

    def _matched(self, pair: RectifiedPair) -> DisparityMap:
        with self._timing.matching():
            disparity = self._matching.pipeline.match(pair)
        if self.unfit is not None:
            logger.warning("frames fit the calibration again")
        self.unfit, self._fitted = None, True
        return disparity

    def _say_unfit(self, error: PrismStereoError) -> None:
        if self.unfit is None:  # once, not once a frame
            logger.error("a frame was not matched: %s", error)
        self.unfit = error


def _asked(disparity: DisparityMap, settings: Settings) -> DisparityMap:
    """Leave out the planes that nobody asked for."""
    return replace(
        disparity,
        confidence=disparity.confidence if settings.confidence else None,
        reasons=disparity.reasons if settings.reasons else None,
    )
