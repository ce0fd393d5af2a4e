"""How right a guide is: the outline's place, the object's mask, and what an upsampler makes of it."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from host.fusion_scores import edge_distance_px, score
from host.motion_compositions import Composition, Recipe, compose
from prismstereo.fusion.motion import Background, GuideForFrame, MovingObject, PreparedStill, guide_for
from prismstereo.fusion.motion.models import FlatMotion
from prismstereo.fusion.motion.picture import high_from_low
from prismstereo.fusion.upsampling.edge_snap import EdgeSnap

Picture = NDArray[np.uint8]
_FAR_PX, _NEAR_PX = 30.0, 45.0


@cache
def prepared(recipe: Recipe) -> tuple[Composition, Background, PreparedStill]:
    """Compose the pictures of a recipe and make background and still ready."""
    made = compose(recipe)
    background = Background.of(made.background_video, made.background_still, made.grid)
    return made, background, PreparedStill.of(made.still, background)


@cache
def followed(recipe: Recipe) -> tuple[Composition, GuideForFrame]:
    """Compose the pictures of a recipe and make the guide for their frame."""
    made, background, still = prepared(recipe)
    return made, guide_for(made.frame, still, background)


def overlap(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
    """Return intersection over union."""
    return float((found & true).sum() / (found | true).sum())


def outline_errors_px(made: Composition, found: MovingObject) -> NDArray[np.float64]:
    """Return how far off, in still pixels, an object's model puts the points of the true outline."""
    model = found.model
    assert isinstance(model, FlatMotion)
    size = made.frame.shape[1::-1]
    shares = [cv2.resize(m.in_still, size, interpolation=cv2.INTER_AREA)[found.in_still].sum() for m in made.movers]
    mover = made.movers[int(np.argmax(shares))]
    outlines, _ = cv2.findContours((mover.in_still > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = max(outlines, key=len).astype(np.float64)
    S = high_from_low(made.grid)
    ours = cv2.perspectiveTransform(points, S @ model.frame_from_still @ np.linalg.inv(S))
    return np.asarray(np.linalg.norm(ours - cv2.perspectiveTransform(points, mover.frame_from_still), axis=2).ravel())


def enlarged_frame(made: Composition) -> Picture:
    """Return the video frame at the still's size: the guide of those who have no still."""
    size = made.still.shape[1::-1]
    M = high_from_low(made.grid)[:2]
    return np.asarray(
        cv2.warpAffine(made.frame, M, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def edge_percent(made: Composition, guide: Picture) -> float:
    """Return the share of wrong pixels beside the objects' outlines when a guide makes the map finer: objects before a wall."""
    scale = made.grid.scale_x
    truth = np.full(made.still.shape[:2], _FAR_PX * scale, np.float32)
    for mover in made.movers:
        truth[mover.in_frame > 0.5] = _NEAR_PX * scale
    S = high_from_low(made.grid)
    low = cv2.warpAffine(truth, S[:2], made.frame.shape[1::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) / scale
    high = (truth.shape[0], truth.shape[1])
    planes = 1 if guide.ndim == 2 else guide.shape[2]
    upsampler = EdgeSnap((low.shape[0], low.shape[1]), high, planes, made.grid)
    found = upsampler.upsample(low.astype(np.float32), np.ascontiguousarray(guide.reshape(*high, planes)))
    return score(found.disparity_px, truth, scale, edge_distance_px(truth)).edge_percent
