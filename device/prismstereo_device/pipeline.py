"""The camera's work on one frame: split, rectify, match."""

from __future__ import annotations

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.match import DEFAULT, create
from prismstereo_device.match.base import Matcher
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import StereoPair, split
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import RangeWish

__all__ = ["Pipeline"]


class Pipeline:
    """Raw frames in, disparity maps out; built for one calibration, range and matcher."""

    def __init__(
        self,
        calibration: Calibration,
        matcher: Matcher | None = None,
        *,
        wish: RangeWish | None = None,
        labels: int | None = None,
    ) -> None:
        self.calibration = calibration
        self.rectifier = Rectifier(rectification(calibration, wish, labels))
        self._matcher = create(DEFAULT) if matcher is None else matcher

    def split(self, frame: RawFrame) -> StereoPair:
        """Cut a frame into its views; `CalibrationError` when it is not of this calibration's size or focus."""
        self.calibration.require_frame(frame)
        return split(frame, self.calibration.views)

    def disparity(self, pair: StereoPair) -> DisparityMap:
        """Rectify and match one pair."""
        return self._matcher.match(self.rectifier.rectify(pair))

    def process(self, frame: RawFrame) -> DisparityMap:
        """Do the whole of it: the disparity map of one raw frame."""
        return self.disparity(self.split(frame))
