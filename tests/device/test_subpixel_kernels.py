"""The compiled sub-pixel loops: bit for bit what plain numpy finds, with any number of threads and on any shape."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise
from prismstereo_device.match.subpixel import refine_steps, symmetric_mean, warm_up

ONE = np.float32(1)
FAR = np.float32(-1e6)


def refined_by_numpy(left: np.ndarray, right: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """One step of least squares over 7x7 windows that follow the surface, in the kernel's own order of additions."""
    height, width = steps.shape
    x = np.arange(width)
    column = x - ((steps.astype(int) + 15) >> 4)
    known = (steps >= 0) & (column >= 1) & (column < width - 2) & (x >= 2) & (x < width - 2)
    at = np.clip(column, 1, width - 3)
    a, b, c, d = (np.take_along_axis(right, at + k, 1).astype(np.float32) for k in (-1, 0, 1, 2))
    part = ((-steps.astype(int)) & 15).astype(np.float32) / np.float32(16)
    cubic = part * (d - a + np.float32(3) * (b - c))
    square = part * (np.float32(3) * (a + c) - np.float32(6) * b + cubic)
    seen = b + np.float32(1 / 6) * part * (np.float32(6) * c - np.float32(2) * a - np.float32(3) * b - d + square)
    gap = seen - left.astype(np.float32)
    wide = np.pad(left.astype(int), ((0, 0), (2, 2)))
    rise = 8 * (wide[:, 3:-1] - wide[:, 1:-3]) - (wide[:, 4:] - wide[:, :-4])
    slope = rise.astype(np.float32) * np.float32(1 / 12)
    own = np.where(known, steps.astype(np.float32) / np.float32(16), FAR)

    def beside(plane: np.ndarray, i: int, outside: np.float32) -> np.ndarray:
        return np.pad(plane, ((0, 0), (3, 3)), constant_values=outside)[:, 3 + i : 3 + i + width]

    many, slopes, gaps, powers, pulls = (np.zeros((height, width), np.float32) for _ in range(5))
    for i in range(-3, 4):
        other = beside(own, i, FAR) - own
        same = (np.abs(other) <= 1) & known
        g = np.where(same, beside(slope, i, 0), np.float32(0))
        e = np.where(same, beside(gap, i, 0) + g * other, np.float32(0))
        many, slopes, gaps = many + same, slopes + g, gaps + e
        powers, pulls = powers + g * g, pulls + g * e
    mean = slopes / np.maximum(many, ONE).astype(np.float32)
    power, pull = powers - mean * slopes, pulls - mean * gaps

    def below(plane: np.ndarray, j: int, outside: float) -> np.ndarray:
        return np.pad(plane, ((3, 3), (0, 0)), constant_values=outside)[3 + j : 3 + j + height]

    powers, pulls = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    for j in range(-3, 4):
        other = below(own, j, FAR) - own
        same = (np.abs(other) <= 1) & known
        p = np.where(same, below(power, j, 0), np.float32(0))
        powers, pulls = powers + p, pulls + np.where(same, below(pull, j, 0) + p * other, np.float32(0))
    move = np.clip(pulls / (powers + np.float32(10)), np.float32(-0.5), np.float32(0.5))
    moved = np.floor(move * np.float32(16) + np.float32(64.5)).astype(int) - 64 + steps
    return np.where(known, np.maximum(moved, 0), steps).astype(np.int16)


def levelled_by_numpy(steps: np.ndarray) -> np.ndarray:
    height, width = steps.shape
    result = steps.copy()
    for y in range(2, height - 2):
        for x in range(2, width - 2):
            if (own := int(steps[y, x])) >= 0:
                window = steps[y - 2 : y + 3, x - 2 : x + 3].astype(int) - own
                pairs = [(p, q) for p, q in zip(window.ravel(), window[::-1, ::-1].ravel(), strict=True)][:12]
                kept = [p + q for p, q in pairs if abs(p) <= 16 and abs(q) <= 16]
                result[y, x] = max(0, own + int(np.floor(sum(kept) / (2 * len(kept) + 1) + 0.5)))
    return result


def rough_pair(rng: np.random.Generator, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two pictures of anything, and a map with holes, edges, slopes, zeros, and partners outside of the picture."""
    left, right = (rng.integers(0, 256, (height, width), np.uint8) for _ in range(2))
    steps = cv2.resize(rng.integers(-40, 160, (-(-height // 9), -(-width // 11)), np.int16), (width, height))
    steps = steps + rng.integers(-12, 12, (height, width))
    return left, right, np.where(steps < 0, -16, steps).astype(np.int16)


SHAPES = [(1, 8), (2, 9), (7, 11), (40, 127), (33, 128), (37, 131), (50, 270)]


@pytest.mark.parametrize("shape", SHAPES)
def test_refining_does_bit_for_bit_what_numpy_does(shape: tuple[int, int], rng: np.random.Generator) -> None:
    left, right, steps = rough_pair(rng, *shape)
    np.testing.assert_array_equal(refine_steps(left, right, steps, threads=1), refined_by_numpy(left, right, steps))


@pytest.mark.parametrize("shape", [*SHAPES[:6], (1, 1), (3, 2), (5, 5)])
def test_levelling_does_bit_for_bit_what_numpy_does(shape: tuple[int, int], rng: np.random.Generator) -> None:
    steps = rough_pair(rng, *shape)[2]
    np.testing.assert_array_equal(symmetric_mean(steps, threads=1), levelled_by_numpy(steps))


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_any_number_of_threads_gives_the_same_bits(threads: int, rng: np.random.Generator) -> None:
    left, right, steps = rough_pair(rng, 97, 200)
    np.testing.assert_array_equal(refine_steps(left, right, steps, threads), refine_steps(left, right, steps, 1))
    np.testing.assert_array_equal(symmetric_mean(steps, threads), symmetric_mean(steps, 1))


@pytest.mark.parametrize("width", [1, 2, 7])
def test_a_picture_too_narrow_to_compare_stays_as_it_is(width: int, rng: np.random.Generator) -> None:
    left, right, steps = rough_pair(rng, 20, width)
    np.testing.assert_array_equal(refine_steps(left, right, steps), steps)


def test_pictures_need_not_lie_straight_in_memory(rng: np.random.Generator) -> None:
    left, right, steps = rough_pair(rng, 30, 60)
    found = refine_steps(np.asfortranarray(left), np.repeat(right, 2, axis=1)[:, ::2], np.asfortranarray(steps))
    np.testing.assert_array_equal(found, refine_steps(left, right, steps))
    np.testing.assert_array_equal(symmetric_mean(np.asfortranarray(steps)), symmetric_mean(steps))


def test_two_surfaces_at_an_edge_do_not_mix(rng: np.random.Generator) -> None:
    # a near half at 20 px before a far one at 8 px; each is moved to its own truth, up to the very edge
    left = noise(rng, 60, 200)
    steps = np.full((60, 200), 8 * 16, np.int16)
    steps[:, 100:] = 20 * 16
    right = np.zeros_like(left)
    right[:, :-8] = left[:, 8:]
    right[:, 80:-20] = left[:, 100:]
    found = refine_steps(grey(left), grey(right), steps + np.int16(5)) / 16
    assert np.abs(found[8:-8, 20:80] - 8).mean() < 0.04
    assert np.abs(found[8:-8, 100:104] - 20).mean() < 0.08


def test_levelling_keeps_a_slanted_surface_and_takes_off_its_noise(rng: np.random.Generator) -> None:
    columns, rows = np.meshgrid(np.arange(80), np.arange(50))
    true_steps = 200 + 2 * columns + 3 * rows
    levelled = symmetric_mean(true_steps.astype(np.int16))
    np.testing.assert_array_equal(levelled, true_steps)
    noisy = (true_steps + np.rint(rng.normal(0, 3, true_steps.shape))).astype(np.int16)
    error = (symmetric_mean(noisy) - true_steps)[2:-2, 2:-2]
    assert error.std() < 0.4 * 3


def test_the_kernels_can_be_made_ready_in_the_background(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        thread = warm_up()
    thread.join(60)
    assert not thread.is_alive()
    assert len(caplog.messages) == 1
    assert "sub-pixel kernels" in caplog.messages[0]
