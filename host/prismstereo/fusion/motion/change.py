"""What of a picture is not background: dense SIFT and colour say where, what light cannot explain says how far it goes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.background import Background
from prismstereo.fusion.motion.dense_sift import DenseSift
from prismstereo.fusion.motion.features import Features
from prismstereo.fusion.motion.gain import Gain
from prismstereo.fusion.motion.likeness import SHADED, noise_level, unlikeness
from prismstereo.fusion.motion.picture import channels, grey
from prismstereo.fusion.motion.stabilisation import shake

__all__ = ["ChangeMask", "change_mask", "filled"]

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]
UNEXPLAINED = 2.5  # times noise: the light alone does not make that of the background
_OTHER_SIFT = 0.5  # distance of descriptors
_TEXTURE = 40.0  # below that a descriptor is noise
_OTHER_COLOUR = 12.0  # in the a, b plane of Lab
_SMALLEST_SHARE = 2.5e-4  # of the picture
_SEEN_SHARE = 0.15  # of a part that dense SIFT or colour must find changed, too


@dataclass(frozen=True, slots=True)
class ChangeMask:
    """What a picture (height, width) shows that the background does not.

    `changed` (height, width) bool are its objects, without their shadows. `background` (height, width, c) float32 is the
    background in the picture's own place and light, `pose` (3, 3) the way there from the background picture's pixels, `gain`
    the factors of light. `unlike` (height, width) is how many times more than `noise` (grey levels) they differ.
    """

    changed: Mask
    unlike: Float
    background: Float
    pose: NDArray[np.float64]
    gain: Gain
    noise: float


def change_mask(picture: Picture, background: Background) -> ChangeMask:
    """Compare a picture (height, width[, 3]) uint8 of the background's size with it."""
    flat = grey(picture)
    pose = shake(background.features, Features.of_scene(flat), picture.shape)
    moved = background.video
    sift = background.sift
    if not np.array_equal(pose, np.eye(3)):
        size = picture.shape[1::-1]
        moved = np.asarray(
            cv2.warpPerspective(moved, pose, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8
        )
        sift = DenseSift.of(grey(moved))
    gain = Gain.between(moved, picture)
    lit = np.minimum(channels(gain.applied(moved)), np.float32(255))  # as the sensor would clip it
    ours = channels(picture)
    noise = noise_level(ours, lit)
    unlike = unlikeness(ours, lit, SHADED, noise=noise)
    own = DenseSift.of(flat)
    distance = np.where(np.maximum(own.texture, sift.texture) > _TEXTURE, own.distances(sift), np.float32(0))
    seen = DenseSift.spread(distance, flat.shape) > _OTHER_SIFT
    if picture.ndim == 3:
        seen |= _colour_distance(ours, lit) > _OTHER_COLOUR
    return ChangeMask(_parts(unlike, seen), unlike, lit, pose, gain, noise)


def filled(mask: Mask) -> Mask:
    """Return a mask (height, width) with its holes filled."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    drawn = np.zeros(mask.shape, np.uint8)
    cv2.drawContours(drawn, contours, -1, 1, cv2.FILLED)
    return drawn.astype(bool)


def _parts(unlike: Float, seen: Mask) -> Mask:
    """Keep what light cannot explain where dense SIFT or colour see a change, too: whole parts, their holes filled."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    small = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    raw = cv2.morphologyEx((unlike > UNEXPLAINED).astype(np.uint8), cv2.MORPH_OPEN, small)
    whole = cv2.morphologyEx(
        filled(cv2.morphologyEx(raw, cv2.MORPH_CLOSE, disc) > 0).astype(np.uint8), cv2.MORPH_OPEN, disc
    )
    count, labels, figures, _ = cv2.connectedComponentsWithStats(whole, connectivity=4)
    told = np.bincount(labels[seen], minlength=count)
    area = figures[:, cv2.CC_STAT_AREA]
    kept = (area >= max(40, _SMALLEST_SHARE * unlike.size)) & (told >= _SEEN_SHARE * area)
    kept[0] = False
    return np.asarray(kept[labels])


def _colour_distance(ours: Float, theirs: Float) -> Float:
    ab = [cv2.cvtColor(cv2.blur(p, (5, 5)) / np.float32(255), cv2.COLOR_BGR2Lab)[..., 1:] for p in (ours, theirs)]
    return np.asarray(np.hypot(*np.moveaxis(ab[0] - ab[1], -1, 0)), np.float32)
