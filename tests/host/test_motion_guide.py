"""The guide for a frame: objects where they are, the video where nobody knows, never worse than the video alone."""

from __future__ import annotations

import numpy as np
import pytest

from host.motion_compositions import Recipe, leaves, variant
from host.motion_scores import edge_percent, enlarged_frame, followed, outline_errors_px, overlap, prepared
from prismstereo.fusion.flags import Flag
from prismstereo.fusion.motion import Background, PreparedStill, guide_for
from prismstereo_hw.errors import DataError

SMALL = {"video": (240, 320), "size": 0.35, "shift_px": (60.0, 12.0)}
BASE = variant(**SMALL)
RECIPES = {
    "base": BASE,
    "blur 8": variant(**SMALL, blur_px=8.0),
    "tilt": variant(**SMALL, tilt=0.25),
    "two": variant(**SMALL, second=True),
    "hidden in part": variant(**SMALL, occluder=True, blur_px=2.0),
}


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_an_object_is_shown_where_the_frame_has_it(recipe: Recipe) -> None:
    made, guide = followed(recipe)
    assert len(guide.objects) == len(made.movers)
    for found in guide.objects:
        assert found.trusted, found.why
        errors = outline_errors_px(made, found)
        assert float(errors.mean()) <= 0.5
        assert float(errors.max()) <= 1.0
    assert overlap(guide.moving, made.object_in_frame()) >= 0.9
    assert edge_percent(made, guide.picture) < edge_percent(made, enlarged_frame(made))


def test_an_object_at_rest_is_known_to_rest() -> None:
    made, guide = followed(variant(**{**SMALL, "shift_px": (0.0, 0.0)}, turn_deg=0.0, grow=1.0, blur_px=0.0))
    (found,) = guide.objects
    assert found.model is not None
    assert found.model.kind == "still"
    assert edge_percent(made, guide.picture) < 0.75 * edge_percent(made, enlarged_frame(made))


def test_a_textureless_object_is_not_guessed_but_shown_from_the_video_and_flagged() -> None:
    made, guide = followed(variant(**SMALL, textured=False))
    assert not any(found.trusted for found in guide.objects)
    assert "too few matches" in guide.objects[0].why
    true = made.object_in_frame()
    assert float(guide.from_video[true].mean()) > 0.99
    inside = made.movers[0].in_frame > 0.5
    assert float((guide.flags[inside] == Flag.GUIDE_IS_VIDEO).mean()) > 0.97
    assert edge_percent(made, guide.picture) <= edge_percent(made, enlarged_frame(made))


def test_an_object_that_only_the_still_shows_leaves_no_trace() -> None:
    made, background, still = prepared(BASE)
    guide = guide_for(made.background_video, still, background)
    away = np.abs(guide.picture.astype(np.float64) - made.background_still).mean()
    assert float(away) < 1.0
    assert not guide.moving.any()


def test_an_object_that_only_the_frame_shows_comes_from_the_video() -> None:
    made, background, _ = prepared(BASE)
    guide = guide_for(made.frame, PreparedStill.of(made.background_still, background), background)
    assert guide.objects == ()
    assert float(guide.from_video[made.object_in_frame()].mean()) > 0.97


def test_without_a_background_still_what_an_object_uncovers_comes_from_the_video() -> None:
    made, _, _ = prepared(BASE)
    background = Background.of(made.background_video, None, made.grid)
    guide = guide_for(made.frame, PreparedStill.of(made.still, background), background)
    uncovered = (made.movers[0].in_still > 0.9) & (made.movers[0].in_frame < 0.1)
    assert float((guide.flags[uncovered] == Flag.GUIDE_IS_VIDEO).mean()) > 0.97
    assert guide.objects[0].trusted


def test_without_any_still_the_video_is_the_guide() -> None:
    made, _, _ = prepared(BASE)
    background = Background.of(made.background_video, None, made.grid)
    guide = guide_for(made.frame, None, background, size=made.still.shape)
    assert (guide.flags == Flag.GUIDE_IS_VIDEO).all()
    np.testing.assert_array_equal(guide.picture, enlarged_frame(made))
    with pytest.raises(DataError, match="say the size"):
        guide_for(made.frame, None, background)


def test_grey_pictures_do_as_well() -> None:
    made, _, _ = prepared(BASE)
    video, still, later, frame = (
        np.ascontiguousarray(p[..., 1]) for p in (made.background_video, made.background_still, made.still, made.frame)
    )
    background = Background.of(video, still, made.grid)
    guide = guide_for(frame, PreparedStill.of(later, background), background)
    assert float(outline_errors_px(made, guide.objects[0]).max()) <= 1.0
    assert overlap(guide.moving, made.object_in_frame()) >= 0.85


@pytest.mark.parametrize("kind", ["noise", "another scene", "black"])
def test_a_frame_that_shows_something_else_is_its_own_guide(kind: str) -> None:
    made, background, still = prepared(BASE)
    frame = {
        "noise": np.random.default_rng(0).integers(0, 255, made.frame.shape, np.uint8),
        "another scene": leaves(*made.frame.shape[:2], 77).astype(np.uint8),
        "black": np.zeros_like(made.frame),
    }[kind]
    guide = guide_for(frame, still, background)
    assert float(guide.from_video.mean()) > 0.99
    assert not any(found.trusted for found in guide.objects)


def test_the_same_pictures_give_the_same_bits() -> None:
    made, first = followed(BASE)
    background = Background.of(made.background_video, made.background_still, made.grid)
    again = guide_for(made.frame, PreparedStill.of(made.still, background), background)
    np.testing.assert_array_equal(first.picture, again.picture)
    np.testing.assert_array_equal(first.flags, again.flags)


def test_pictures_that_do_not_go_together_are_refused_by_name() -> None:
    made, background, _ = prepared(BASE)
    with pytest.raises(DataError, match="the still is black"):
        PreparedStill.of(np.zeros_like(made.still), background)
    with pytest.raises(DataError, match="give one size"):
        PreparedStill.of(made.still[:-4], background)
    with pytest.raises(DataError, match="give one camera mode"):
        guide_for(made.frame[:-1], None, background)
    with pytest.raises(DataError, match="in the same way"):
        PreparedStill.of(np.ascontiguousarray(made.still[..., 0]), background)
    with pytest.raises(DataError, match="8 bits"):
        guide_for(made.frame.astype(np.uint16), None, background)
