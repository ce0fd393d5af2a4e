"""What of a picture is background in another light, and what is an object."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from host.motion_compositions import compose, leaves, variant
from host.motion_scores import overlap
from prismstereo.fusion.motion.background import Background
from prismstereo.fusion.motion.change import change_mask
from prismstereo.fusion.motion.gain import Gain
from prismstereo.fusion.motion.likeness import SHADED, unlikeness
from prismstereo.fusion.motion.picture import high_from_low, reduced
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo_hw.errors import DataError

SMALL = {"video": (240, 320), "size": 0.35, "shift_px": (60.0, 12.0)}
GROUND = leaves(120, 160, 8)


def test_the_gain_is_found_beside_an_object_and_a_shadow() -> None:
    ours = 0.8 * GROUND
    ours[:, :60] = 240  # more than a third of the picture is something else
    ours[80:, 60:] *= 0.5
    factors = Gain.between(ours.astype(np.uint8), GROUND.astype(np.uint8)).factors
    assert factors == pytest.approx((1.25, 1.25, 1.25), rel=0.01)


def test_a_shadow_is_explained_and_an_object_is_not() -> None:
    shaded = GROUND.copy()
    shaded[:, 80:] *= 0.55
    seen = shaded.copy()
    seen[40:80, 20:60] = leaves(40, 40, 12)
    score = unlikeness(seen, GROUND, SHADED, noise=1.0)
    assert float(score[:, 80:].max()) < 1.0
    found = score > 2.5
    true = np.zeros(found.shape, bool)
    true[40:80, 20:60] = True
    assert overlap(found, true) > 0.9
    assert not found[~cv2.dilate(true.astype(np.uint8), np.ones((3, 3))).astype(bool)].any()  # no halo


@pytest.mark.parametrize(
    "changes",
    [{}, {"shadow": 0.6, "gain": 0.7}, {"textured": False}, {"shake_px": 1.5}],
    ids=["shadow and gain", "darker", "textureless", "shaken"],
)
def test_an_object_is_found_to_its_outline(changes: dict[str, object]) -> None:
    made = compose(variant(**SMALL, **changes))
    background = Background.of(made.background_video, made.background_still, made.grid)
    found = change_mask(made.frame, background)
    assert overlap(found.changed, made.object_in_frame()) >= 0.9
    shift = np.array([1.5, -0.9]) if "shake_px" in changes else np.zeros(2)
    centre = found.pose @ [160, 120, 1]
    np.testing.assert_allclose(centre[:2] / centre[2] - [160, 120], shift, atol=0.08)


def test_an_empty_scene_in_another_light_has_no_object() -> None:
    made = compose(variant(**SMALL))
    background = Background.of(made.background_video, made.background_still, made.grid)
    assert not change_mask((0.6 * made.background_video).astype(np.uint8), background).changed.any()


def test_frames_with_a_moving_object_tell_the_background() -> None:
    frames = []
    for step in range(5):
        frame = GROUND.copy()
        frame[30:60, 25 * step : 25 * step + 25] = 255
        frames.append(frame.astype(np.uint8))
    background = Background.from_frames(frames, [], Grid(2, 2))
    np.testing.assert_array_equal(background.video, GROUND.astype(np.uint8))
    assert background.still is None


def test_two_frames_tell_no_background() -> None:
    with pytest.raises(DataError, match="give three at least"):
        Background.from_frames([GROUND.astype(np.uint8)] * 2, [], Grid(2, 2))


def test_a_still_is_reduced_to_where_the_video_s_pixels_are() -> None:
    grid = Grid(3.7125, 3.7125, 10.0, 31.5)
    columns = np.mgrid[:450, :500][1]
    M = np.linalg.inv(high_from_low(grid))
    still = np.clip(20 + (M[0, 0] * columns + M[0, 2]), 0, 255).astype(np.uint8)
    small = reduced(still, grid, (110, 120))
    np.testing.assert_allclose(small[10:100, 10:110], np.broadcast_to(20 + np.arange(10, 110), (90, 100)), atol=1)
