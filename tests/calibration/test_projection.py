"""The derivatives of the solver, against differences, against OpenCV, and against a dense solver that knows no arrow."""

from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_calibration.solving.arrow import Linearised, minimise
from prismstereo_calibration.solving.poses import angle_deg, rotation, rotations
from prismstereo_calibration.solving.projection import lens_of, numbers_of, project

NUMBERS = np.array([900.0, 905.0, 640.0, 350.0, -0.06, 0.03, 1e-3, -2e-3, 0.01])
POINTS = np.random.default_rng(4).uniform([-150, -150, 300], [150, 150, 600], (40, 3))


def test_projection_is_that_of_the_lens_itself() -> None:
    np.testing.assert_allclose(project(NUMBERS, POINTS).pixels, lens_of(NUMBERS).project(POINTS), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(numbers_of(lens_of(NUMBERS)), NUMBERS)


def test_derivatives_agree_with_opencv() -> None:
    K = np.array([[NUMBERS[0], 0, NUMBERS[2]], [0, NUMBERS[1], NUMBERS[3]], [0, 0, 1]])
    pixels, jacobian = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, NUMBERS[4:])
    found = project(NUMBERS, POINTS)
    np.testing.assert_allclose(found.pixels, pixels.reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(found.by_point, jacobian[:, 3:6].reshape(-1, 2, 3), atol=1e-9)  # by translation
    np.testing.assert_allclose(found.by_lens, jacobian[:, 6:15].reshape(-1, 2, 9), rtol=1e-9, atol=1e-9)


def test_derivatives_agree_with_differences() -> None:
    found = project(NUMBERS, POINTS)
    for index, step in enumerate([1e-3] * 4 + [1e-5] * 5):
        change = step * np.eye(9)[index]
        rise = (project(NUMBERS + change, POINTS).pixels - project(NUMBERS - change, POINTS).pixels) / (2 * step)
        np.testing.assert_allclose(found.by_lens[..., index], rise, rtol=1e-6, atol=1e-6)


turns = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(turns)
def test_rotations_are_rotations_and_those_of_opencv(turn: np.ndarray) -> None:
    R = rotations(turn)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R, cv2.Rodrigues(turn)[0], atol=1e-9)
    np.testing.assert_allclose(rotation(R + 1e-7), R, atol=1e-6)


@given(turns)
def test_the_angle_between_rotations_is_the_length_of_the_turn(turn: np.ndarray) -> None:
    length = np.degrees(np.linalg.norm(turn)) % 360
    assert abs(angle_deg(np.eye(3), rotations(turn)) - min(length, 360 - length)) < 1e-5


def test_the_arrow_finds_the_minimum_that_a_dense_solver_finds() -> None:
    """Curves y = (a + own) exp(-b x): two shared numbers, one own number for each of five curves."""
    from scipy.optimize import least_squares

    x = np.linspace(0, 3, 12)
    rng = np.random.default_rng(5)
    y = (2.0 + rng.normal(0, 1, (5, 1))) * np.exp(-0.7 * x) + rng.normal(0, 0.05, (5, 12))
    weight = np.array([1.0, -1.0, 1.0, -1.0, 0.0])  # ties the own numbers to the shared one: without it a is free

    def residual(shared: np.ndarray, own: np.ndarray) -> np.ndarray:
        return (shared[0] * weight[:, None] + own[:, None]) * np.exp(-shared[1] * x) - y

    def linearise(state: tuple[np.ndarray, np.ndarray]) -> Linearised:
        shared, own = state
        decay = np.exp(-shared[1] * x)
        off = residual(shared, own)
        by_own = np.broadcast_to(decay, off.shape)[..., None]
        with_x = -x * (shared[0] * weight[:, None] + own[:, None]) * decay
        extra = np.concatenate([off, 0.1 * own[:, None]], axis=1)  # a weak wish that own numbers be small
        by_shared = np.stack([np.broadcast_to(weight[:, None] * decay, off.shape), with_x], axis=-1)
        by_shared = np.concatenate([by_shared, np.zeros((5, 1, 2))], axis=1)
        by_own = np.concatenate([by_own, np.full((5, 1, 1), 0.1)], axis=1)
        return Linearised(float(np.sum(extra**2)), extra.size, extra, by_shared, by_own)

    found = minimise(
        (np.array([1.0, 0.2]), np.zeros(5)), linearise, lambda s, shared, own: (s[0] + shared, s[1] + own[:, 0])
    )
    dense = least_squares(
        lambda p: linearise((p[:2], p[2:])).residual.ravel(), np.r_[1.0, 0.2, np.zeros(5)], xtol=1e-14
    )
    np.testing.assert_allclose(found.state[0], dense.x[:2], rtol=1e-6)
    np.testing.assert_allclose(found.state[1], dense.x[2:], rtol=1e-6, atol=1e-8)
    J = dense.jac
    variance = 2 * dense.cost / (J.shape[0] - J.shape[1])
    np.testing.assert_allclose(found.covariance, (variance * np.linalg.inv(J.T @ J))[:2, :2], rtol=1e-4)
