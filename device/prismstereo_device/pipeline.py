"""The camera's work on one frame: split, rectify, match, say why not, filter."""

from __future__ import annotations

import copy

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.rectified_reasons import rectified_reasons
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import FilterChain, explained
from prismstereo_device.match import DEFAULT, create
from prismstereo_device.match.base import Matcher
from prismstereo_device.rectify import RectifiedPair, Rectifier
from prismstereo_device.split import StereoPair, split
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import RangeWish

__all__ = ["Pipeline"]


class Pipeline:
    """Raw frames in, disparity maps out; built for one calibration, range and matcher.

    `filters` keep what they remember of earlier frames in here. With `explain` every unmatched pixel says why.
    """

    def __init__(
        self,
        calibration: Calibration,
        matcher: Matcher | None = None,
        *,
        wish: RangeWish | None = None,
        labels: int | None = None,
        filters: FilterChain | None = None,
        explain: bool = False,
    ) -> None:
        self.calibration = calibration
        made = rectification(calibration, wish, labels)
        self.rectifier = Rectifier(made)
        self._matcher = create(DEFAULT) if matcher is None else matcher
        self._filters = None if filters is None else filters.stream()
        self._explain = explain
        mask = calibration.mask
        self._static = None if mask is None or not explain else rectified_reasons(mask, made, "left")

    def with_matcher(self, matcher: Matcher, *, explain: bool) -> Pipeline:
        """Give a pipeline that matches so from the next frame on; maps, and what filters remember, are shared with this one."""
        other = copy.copy(self)
        other._matcher, other._explain = matcher, explain
        if explain and self._static is None and self.calibration.mask is not None:
            other._static = rectified_reasons(self.calibration.mask, self.rectifier.rectification, "left")
        return other

    def split(self, frame: RawFrame) -> StereoPair:
        """Cut a frame into its views; `CalibrationError` when it is not of this calibration's size or focus."""
        self.calibration.require_frame(frame)
        return split(frame, self.calibration.views)

    def disparity(self, pair: StereoPair) -> DisparityMap:
        """Rectify and match one pair; give unmatched pixels their reasons if that was asked for, and filter."""
        return self.match(self.rectifier.rectify(pair))

    def match(self, rectified: RectifiedPair) -> DisparityMap:
        """Do what `disparity` does after rectifying."""
        found = self._matcher.match(rectified)
        if self._explain:
            found = explained(found, rectified.left, rectified.right, rectified.left_seen, self._static)
        return found if self._filters is None else self._filters.apply(found, rectified.left)

    def process(self, frame: RawFrame) -> DisparityMap:
        """Do the whole of it: the disparity map of one raw frame."""
        return self.disparity(self.split(frame))
