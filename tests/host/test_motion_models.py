"""Which motion matches speak for: no more freedom than is needed, one model after the other, none by chance."""

from __future__ import annotations

import cv2
import numpy as np

from host.motion_compositions import moved
from prismstereo.fusion.motion.features import Matches
from prismstereo.fusion.motion.models import FlatMotion, Relief, RigidMotion
from prismstereo.fusion.motion.selection import best_fit, peeled

CENTRE = np.array([150.0, 110.0])


def matches(M: np.ndarray, count: int = 80, noise: float = 0.15, wrong: int = 0, seed: int = 1) -> Matches:
    rng = np.random.default_rng(seed)
    ours = rng.uniform([100, 70], [200, 150], (count, 2))
    theirs = cv2.perspectiveTransform(ours[:, None], M)[:, 0] + rng.normal(0, noise, (count, 2))
    theirs[:wrong] = rng.uniform([0, 0], [320, 240], (wrong, 2))
    return Matches(ours, theirs)


def test_a_turn_and_a_shift_are_a_similarity_although_a_homography_would_fit_closer() -> None:
    M = moved((40.0, -12.0), 14.0, 1.05, CENTRE, 0.0)
    fit = best_fit(matches(M, wrong=25))
    assert fit is not None
    assert fit.model.kind == "similarity"
    assert isinstance(fit.model, FlatMotion)
    corners = np.array([[100.0, 70], [200, 70], [200, 150], [100, 150]])
    away = fit.model.in_frame(corners) - cv2.perspectiveTransform(corners[:, None], M)[:, 0]
    assert float(np.hypot(*away.T).max()) < 0.15
    assert 50 <= fit.support <= 60


def test_a_slanted_view_is_a_homography() -> None:
    fit = best_fit(matches(moved((40.0, -12.0), 5.0, 1.0, CENTRE, 0.0025)))
    assert fit is not None
    assert fit.model.kind == "homography"


def test_a_thing_with_relief_that_turns_is_a_motion_in_space() -> None:
    rng = np.random.default_rng(5)
    height, width, focal = 240, 320, 500.0
    rows, columns = np.mgrid[:height, :width]
    disparity = (20 + 6 * np.hypot((columns - 150) / 50, (rows - 110) / 40) ** 2).clip(20, 30).astype(np.float32)
    relief = Relief(disparity, focal, 160.0, 120.0)
    turn, t = cv2.Rodrigues(np.radians([3.0, 12.0, 4.0]))[0], np.array([-0.9, 0.2, 0.4])
    true = RigidMotion(turn, t, relief)
    theirs = rng.uniform([100, 70], [200, 150], (120, 2))
    seen = Matches(true.in_still(theirs) + rng.normal(0, 0.1, (120, 2)), theirs)
    fit = best_fit(seen, relief)
    assert fit is not None
    assert fit.model.kind == "rigid"
    away = fit.model.in_still(theirs) - true.in_still(theirs)
    assert float(np.hypot(*away.T).max()) < 0.15
    flat = best_fit(seen)
    assert flat is None or flat.support < 100  # no plane moves like that


def test_two_things_in_one_part_are_peeled_one_after_the_other() -> None:
    first, second = moved((40.0, -12.0), 14.0, 1.05, CENTRE, 0.0), moved((-30.0, 25.0), -8.0, 0.97, CENTRE, 0.0)
    one, other = matches(first, 60), matches(second, 40, seed=2)
    fits = peeled(Matches(np.vstack([one.ours, other.ours]), np.vstack([one.theirs, other.theirs])))
    assert [fit.support for fit in fits[:2]] == [60, 40]
    for fit, M in zip(fits, (first, second), strict=False):
        assert isinstance(fit.model, FlatMotion)
        np.testing.assert_allclose(
            fit.model.in_frame(CENTRE[None]), cv2.perspectiveTransform(CENTRE[None, None], M)[0], atol=0.1
        )


def test_matches_by_chance_give_no_model() -> None:
    for seed in range(5):
        assert best_fit(matches(np.eye(3), 30, wrong=30, seed=seed)) is None


def test_off_the_thing_its_relief_goes_on_as_at_its_rim() -> None:
    disparity = np.full((40, 40), 5.0, np.float32)
    disparity[10:30, 10:30] = 20.0
    inside = np.zeros((40, 40), bool)
    inside[12:28, 12:28] = True
    assert (Relief(disparity, 300.0, 20.0, 20.0).continued(inside).disparity_px == 20.0).all()


def test_the_relief_of_many_points_and_of_none_is_told() -> None:
    relief = Relief(np.full((200, 300), 8.0, np.float32), 400.0, 150.0, 100.0)
    rows, columns = np.mgrid[:200, :300]
    points = relief.points(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64))
    np.testing.assert_allclose(points[:, 2], 50.0)  # baselines: 400 / 8
    np.testing.assert_allclose(points[0, :2], [-150 / 8, -100 / 8])
    assert relief.points(np.zeros((0, 2))).shape == (0, 3)
