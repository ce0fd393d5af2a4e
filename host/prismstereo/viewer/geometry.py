"""What a page needs to make points of disparities: one pinhole, one scale, and what glass before the lens adds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.rig import RangeWish

__all__ = ["Geometry"]

_SAME = 1e-6  # windows travel as 32-bit floats
_JUST_WITHIN = 1.0005  # the near end is a border: rounding may not push it out


@dataclass(frozen=True, slots=True)
class Geometry:
    """The rectified left view that frames of one window and one size are seen in."""

    calibration: Calibration
    made: Rectification

    @classmethod
    def of(cls, calibration: Calibration, window: DisparityWindow) -> Geometry:
        """Derive the geometry of frames with a window; `UsageError` where the calibration cannot have such a window."""
        own = rectification(calibration)
        if own.window.labels == window.labels and abs(own.window.offset_px - window.offset_px) < _SAME * max(
            1.0, abs(window.offset_px)
        ):
            return cls(calibration, own)
        full = replace(window, scale_px=own.window.scale_px)
        wish = RangeWish(near_mm=full.nearest * _JUST_WITHIN, far_mm=full.farthest, labels=full.labels)
        return cls(calibration, rectification(calibration, wish, full.labels))

    def projection(self, width: int, height: int) -> dict[str, object]:
        """Tell focal length and principal point in pixels of a picture of that size, and whether glass is still in it."""
        scale = width / self.made.width
        whole = (width, height) == (self.made.width, self.made.height)
        return {
            "focal_px": self.made.focal_px * scale,
            "cx_px": scale * (self.made.left.cx_px + 0.5) - 0.5,
            "cy_px": scale * (self.made.cy_px + 0.5) - 0.5,
            "glass": whole and self.made.window.glass is not None,  # a smaller picture was freed of it on the camera
        }

    def told(self) -> dict[str, object]:
        """Tell the page everything that does not change from frame to frame."""
        calibration, made = self.calibration, self.made
        size = calibration.frame_width, calibration.frame_height
        glass = made.window.glass
        return {
            "unit": made.unit,
            "rig": calibration.rig,
            "baseline": calibration.baseline,
            "near": made.window.nearest,
            "far": made.window.farthest if made.window.farthest < float("inf") else None,
            "rms_px": calibration.rms_px,
            "raw": {
                "width": size[0],
                "height": size[1] * calibration.left_view.exposures,
                "left": calibration.left_view.rectangle(*size),
                "right": calibration.right_view.rectangle(*size),
            },
            "glass": None
            if glass is None
            else {"factors": glass.factors.tolist(), "middle_px": glass.middle_px, "half_px": glass.half_px},
        }
