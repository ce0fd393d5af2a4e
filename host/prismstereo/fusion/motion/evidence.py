"""What a frame says about a model: where the still, shown as the model says, explains it, and where the background does."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.change import UNEXPLAINED, ChangeMask
from prismstereo.fusion.motion.likeness import TURNED, unlikeness
from prismstereo.fusion.motion.models import MotionModel, RigidMotion
from prismstereo.fusion.motion.picture import HALF_STEP, channels, grey
from prismstereo.fusion.motion.streak import Streak, streak_of
from prismstereo.fusion.motion.warp import Box, box_of, places_in_still, shown_fine, shown_low

__all__ = ["Evidence", "weigh"]

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]
_ROOM_PX = 10
_CAP = 20.0
_RIM = np.ones((5, 5), np.uint8)
_FEWEST_TO_JUDGE = 12
_SHARE_EXPLAINED = 0.6


@dataclass(frozen=True, slots=True)
class Evidence:
    """A model held against the frame, in a `box` of it: every map is (rows, columns) of the box.

    `visible`: where the object's part of the still would be seen. `hidden`: of those, what the background explains and the
    object does not: something at rest stands before it. `unlike`: times noise that the shown still differs from the frame.
    `fine` is the still as shown, (2 rows, 2 columns) float32 grey. `explained` is the share of what is not hidden that the
    model explains.
    """

    model: MotionModel
    box: Box
    visible: Mask
    hidden: Mask
    unlike: Float
    streak: Streak
    fine: Float
    explained: float

    @property
    def support(self) -> float:
        """How many pixels speak for the model, less those against it."""
        seen = int((self.visible & ~self.hidden).sum())
        return seen * (2 * self.explained - 1)

    @property
    def convincing(self) -> bool:
        """Tell whether the model explains most of what it shows, and shows a good part of the object."""
        seen = int((self.visible & ~self.hidden).sum())
        return bool(
            seen >= _FEWEST_TO_JUDGE and self.explained >= _SHARE_EXPLAINED and seen >= 0.25 * int(self.visible.sum())
        )


def weigh(
    model: MotionModel, mask: Mask, fine: Picture, frame: Picture, change: ChangeMask, streak: Streak | None = None
) -> Evidence | None:
    """Hold a model against the frame; None where it shows nothing of the object in it.

    `mask` (height, width) is the object in the still, `fine` the still at two pixels for one; `frame` (height, width[, c])
    and what changed in it. The streak is looked for unless it is given.
    """
    box = box_of(mask, model, _ROOM_PX, change.changed)
    if box.empty():
        return None
    places = places_in_still(model, box)
    visible = shown_low(mask, places)
    if isinstance(model, RigidMotion) and visible.sum() >= _FEWEST_TO_JUDGE:
        inside = np.zeros(mask.shape, np.uint8)
        inside[box.cut] = visible
        model = replace(model, relief=model.relief.continued(cv2.erode(inside, np.ones((3, 3), np.uint8)) > 0))
        places = places_in_still(model, box)
        visible = shown_low(mask, places)
    if visible.sum() < _FEWEST_TO_JUDGE:
        return None
    warped = shown_fine(fine, places)
    rows, columns = box.shape
    small = channels(np.asarray(cv2.resize(warped, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8))
    ours = channels(frame[box.cut])
    core = cv2.erode(visible.astype(np.uint8), _RIM) > 0
    if streak is None:
        streak = streak_of(ours, small, core, change.noise)
    unlike = unlikeness(ours, streak.over(small), TURNED, noise=change.noise)
    behind = change.unlike[box.cut]
    hidden = _hidden(visible, unlike, behind)
    shown = (core if core.sum() >= _FEWEST_TO_JUDGE else visible) & ~hidden
    explained = float((unlike[shown] < UNEXPLAINED).mean()) if shown.any() else 0.0
    return Evidence(model, box, visible, hidden, unlike, streak, grey(warped), explained)


def fine_frame(frame: Picture, box: Box) -> Float:
    """Return a box of the frame at two pixels for one, grey, (2 rows, 2 columns) float32."""
    rows, columns = box.shape
    cut = grey(frame[box.cut])
    return np.asarray(
        cv2.resize(cut, (columns * HALF_STEP, rows * HALF_STEP), interpolation=cv2.INTER_CUBIC), np.float32
    )


def _hidden(visible: Mask, unlike: Float, behind: Float) -> Mask:
    """Tell where the background clearly explains the frame better than the object does."""
    lead = np.minimum(unlike, _CAP) - np.minimum(behind, _CAP)
    smooth = cv2.GaussianBlur(np.asarray(lead, np.float32), (0, 0), 1.5)
    hidden = visible & (smooth > 0.5) & (behind < UNEXPLAINED)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    return np.asarray(cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0)
