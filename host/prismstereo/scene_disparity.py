"""Raw frame to disparity by a rectification from a scene: no scale, hence no depth and no cloud."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from prismstereo.picture import depth_picture
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import FilterChain
from prismstereo_device.match import DEFAULT, create
from prismstereo_device.match.base import Matcher
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import split
from prismstereo_hw import pfm
from prismstereo_hw.files import write_picture
from prismstereo_hw.frame import RawFrame

__all__ = ["SceneDisparity", "ScenePipeline"]


@dataclass(frozen=True, slots=True)
class SceneDisparity:
    """One frame's disparity, and how long splitting, rectifying and matching took."""

    disparity: DisparityMap
    milliseconds: float

    def write(self, folder: Path, name: str) -> list[Path]:
        """Write NAME_disparity.pfm and NAME_disparity.png (the picture, with a scale in pixels); return their paths."""
        paths = [folder / f"{name}_disparity{ending}" for ending in (".pfm", ".png")]
        pfm.write_disparity(paths[0], self.disparity.disparity_px)
        write_picture(paths[1], depth_picture(self.disparity))
        return paths


class ScenePipeline:
    """Raw frames in, disparities out; built for one rectification and matcher."""

    def __init__(
        self, rectification: SceneRectification, matcher: Matcher | None = None, filters: FilterChain | None = None
    ) -> None:
        self.rectifier = Rectifier(rectification)
        self._matcher = create(DEFAULT) if matcher is None else matcher
        self._filters = None if filters is None else filters.stream()

    def process(self, frame: RawFrame) -> SceneDisparity:
        """Split, rectify and match one raw frame; `CalibrationError` when it is of another size than the rectification."""
        made = self.rectifier.rectification
        size = made.frame_width, made.frame_height * made.left.view.exposures
        if (frame.width, frame.height) != size:
            raise CalibrationError(
                f"frame {frame.index} is {frame.width}x{frame.height}, but the rectification is for {size[0]}x{size[1]}: make "
                "one for this mode, or capture in the other"
            )
        begin = time.perf_counter()
        pair = self.rectifier.rectify(split(frame, made.views))
        disparity = self._matcher.match(pair)
        if self._filters is not None:
            disparity = self._filters.apply(disparity, pair.left)
        return SceneDisparity(disparity, 1e3 * (time.perf_counter() - begin))
