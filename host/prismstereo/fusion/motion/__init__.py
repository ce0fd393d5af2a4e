"""What moves: the guide that a still would have been at the instant of a video frame.

    background = Background.of(empty_video, empty_still, grid)
    still = PreparedStill.of(picture, background)          once for each still
    guide = guide_for(frame, still, background)            for each frame: guide.picture, guide.flags, guide.objects

All pictures are rectified; nothing is remembered from frame to frame: any frame can be made at any time,
with the same bits.
"""

from __future__ import annotations

from prismstereo.fusion.motion.background import Background
from prismstereo.fusion.motion.change import ChangeMask, change_mask
from prismstereo.fusion.motion.guide import GuideForFrame, guide_for
from prismstereo.fusion.motion.models import MotionModel, Relief
from prismstereo.fusion.motion.objects import MovingObject
from prismstereo.fusion.motion.prepared_still import PreparedStill

__all__ = [
    "Background", "ChangeMask", "GuideForFrame", "MotionModel", "MovingObject", "PreparedStill", "Relief", "change_mask",
    "guide_for",
]  # fmt: skip
