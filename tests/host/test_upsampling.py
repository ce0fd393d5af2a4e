"""Upsampling one map onto one still: planes, contours, holes, rims, threads, and what every method has in common."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from host.drawn_scenes import Disc
from host.fusion_scores import score
from prismstereo.fusion.upsampling import METHODS, EdgeSnap, Flag, Grid, Upsampled, upsample
from prismstereo.fusion.upsampling.majority_kernels import find_medians
from prismstereo_hw.errors import UsageError

STILL, SCALE = (144, 184), 4.0
LOW = (36, 46)
CHOOSING = ("edge-snap", "votes", "geodesic", "weighted-mode")


@pytest.fixture(scope="module")
def disc() -> Disc:
    return Disc()


@pytest.fixture(scope="module")
def low(disc: Disc) -> np.ndarray:
    return disc.low(LOW, Grid.between(LOW, STILL))


@pytest.fixture(scope="module")
def picture(disc: Disc) -> np.ndarray:
    return disc.picture(STILL)


def contour_error_px(found: np.ndarray, disc: Disc, size: tuple[int, int] = STILL) -> float:
    """Return how far a contour is off on average: the area on the wrong side over the contour's length."""
    truth = disc.truth(size)
    return float((np.abs(found - truth) > 8).sum() / (2 * np.pi * disc.radius))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("colour", [True, False])
def test_every_method_is_as_large_as_its_guide_and_keeps_to_the_disparities_there_are(
    method: str, colour: bool, low: np.ndarray, picture: np.ndarray
) -> None:
    guide = picture if colour else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)

    done = upsample(low, guide, method)

    assert done.disparity_px.shape == done.flags.shape == STILL
    assert done.disparity_px.dtype == np.float32
    assert np.isfinite(done.disparity_px).all()
    assert 4 * low.min() - 1 < done.disparity_px.min() <= done.disparity_px.max() < 4 * low.max() + 1


@pytest.mark.parametrize(
    ("method", "most_px"), [("edge-snap", 0.2), ("votes", 0.25), ("geodesic", 0.5), ("weighted-mode", 0.6)]
)
def test_a_disc_gets_its_round_contour(
    method: str, most_px: float, disc: Disc, low: np.ndarray, picture: np.ndarray
) -> None:
    blocky = cv2.resize(low * 4, STILL[::-1], interpolation=cv2.INTER_NEAREST)
    assert contour_error_px(blocky, disc) > 0.8

    assert contour_error_px(upsample(low, picture, method).disparity_px, disc) < most_px


@pytest.mark.parametrize("scale", [2.0, 3.7125, 5.0, 8.0])
@pytest.mark.parametrize("x", [80.0, 80.25, 80.5, 80.75])
def test_contours_lie_where_they_are_to_a_fraction_of_a_pixel_at_any_scale(scale: float, x: float) -> None:
    size = round(144 / scale), round(184 / scale)
    disc = Disc(x=x, y=70.0 + x / 80)
    grid = Grid.between(size, STILL)

    found = upsample(disc.low(size, grid), disc.picture(STILL)).disparity_px

    near = found > 45
    rows, columns = np.nonzero(near)
    assert abs(columns.mean() - disc.x) < 0.2
    assert abs(rows.mean() - disc.y) < 0.2
    assert np.sqrt(near.sum() / np.pi) == pytest.approx(disc.radius, abs=0.25)


def plane(size: tuple[int, int], grid: Grid, across: float, down: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the map of a plane, and its truth on a still three by three times and a bit as large."""
    high = round(size[0] * grid.scale_y), round(size[1] * grid.scale_x)
    v, u = np.mgrid[: size[0], : size[1]].astype(np.float64)
    y, x = np.mgrid[: high[0], : high[1]].astype(np.float64)
    there_u, there_v = (
        (x - grid.shift_x_px + 0.5) / grid.scale_x - 0.5,
        (y - grid.shift_y_px + 0.5) / grid.scale_y - 0.5,
    )
    truth = grid.scale_x * (20 + across * there_u + down * there_v)
    return (20 + across * u + down * v).astype(np.float32), truth.astype(np.float32)


@pytest.mark.parametrize("method", ["edge-snap", "geodesic", "weighted-mode"])
@pytest.mark.parametrize(("across", "down"), [(0.05, -0.1), (0.4, 0.0), (-0.3, 0.7)])
@pytest.mark.parametrize("shift_px", [0.0, 0.5])
def test_a_plane_is_exact_up_to_the_rim_however_steep(method: str, across: float, down: float, shift_px: float) -> None:
    grid = Grid(3.5, 3.5, shift_px, -shift_px)
    low, truth = plane((12, 16), grid, across, down)
    noise = np.random.default_rng(1).integers(0, 255, truth.shape).astype(np.uint8)

    done = upsample(low, noise, method, grid=grid)

    seen = (done.flags & Flag.NO_LOW_RESOLUTION) == 0
    assert seen.mean() > 0.97
    np.testing.assert_allclose(done.disparity_px[seen], truth[seen], atol=2e-4 * 60)


@pytest.mark.parametrize("method", METHODS)
def test_threads_change_no_bit(method: str, low: np.ndarray, picture: np.ndarray) -> None:
    one, two, five = (upsample(low, picture, method, threads=threads) for threads in (1, 2, 5))

    for other in (two, five):
        assert one.disparity_px.tobytes() == other.disparity_px.tobytes()
        assert one.flags.tobytes() == other.flags.tobytes()
        assert one.source.tobytes() == other.source.tobytes()


def test_an_upsampler_used_again_gives_the_same_bits_in_the_same_arrays(low: np.ndarray, picture: np.ndarray) -> None:
    snap = EdgeSnap(LOW, STILL, 3, Grid.between(LOW, STILL))
    first = snap.upsample(low, picture)
    bits = first.disparity_px.tobytes(), first.flags.tobytes()
    snap.upsample(low[::-1].copy(), picture, first)

    again = snap.upsample(low, picture, first)

    assert again.disparity_px is first.disparity_px
    assert (again.disparity_px.tobytes(), again.flags.tobytes()) == bits


@pytest.mark.parametrize("method", CHOOSING)
def test_rows_of_the_still_that_the_map_never_saw_are_empty_and_say_so(method: str) -> None:
    grid = Grid.centred((20, 24), (120, 89), 3.7125)
    flat = np.full((20, 24), 7.0, np.float32)

    done = upsample(flat, np.zeros((120, 89), np.uint8), method, grid=grid)

    unseen = np.isnan(done.disparity_px)
    assert grid.shift_y_px == pytest.approx((120 - 20 * 3.7125) / 2)
    assert unseen[:23].all()
    assert not unseen[23:97].any()
    assert unseen[97:].all()
    np.testing.assert_array_equal(unseen, (done.flags & Flag.NO_LOW_RESOLUTION) != 0)
    np.testing.assert_array_equal(unseen, done.source < 0)
    np.testing.assert_allclose(done.disparity_px[~unseen], 7 * 3.7125, rtol=1e-6)


@pytest.mark.parametrize("method", CHOOSING)
def test_holes_take_the_farther_side_and_are_flagged_or_stay_empty_on_request(
    method: str, disc: Disc, low: np.ndarray, picture: np.ndarray
) -> None:
    torn = low.copy()
    torn[10:26, 8:14] = np.nan  # beside the disc, over its left border

    filled, kept = upsample(torn, picture, method), upsample(torn, picture, method, fill=False)

    flagged = (filled.flags & Flag.FILLED) != 0
    inside = np.zeros(STILL, bool)
    inside[44:100, 36:52] = True
    assert flagged[48:96, 36:44].all()
    assert flagged[inside].mean() > 0.75
    assert not flagged[:36].any()
    assert np.isfinite(filled.disparity_px).all()
    np.testing.assert_array_equal(np.isnan(kept.disparity_px), flagged)
    x, y = np.meshgrid(np.arange(STILL[1]), np.arange(STILL[0]))
    wall = ~disc.near(x, y)
    error = np.abs(filled.disparity_px - disc.truth(STILL))[wall & flagged]
    assert np.median(error) < 1.0


@pytest.mark.parametrize("method", METHODS)
def test_a_map_without_a_single_match_stays_empty(method: str, picture: np.ndarray) -> None:
    done = upsample(np.full(LOW, np.nan, np.float32), picture, method)

    assert np.isnan(done.disparity_px).all()
    assert (done.source == -1).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("size", "high"),
    [((1, 1), (1, 1)), ((1, 1), (7, 5)), ((1, 9), (3, 31)), ((9, 1), (31, 3)), ((3, 5), (3, 5)), ((7, 5), (23, 21))],
)
def test_sizes_of_one_and_odd_ones_work(method: str, size: tuple[int, int], high: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    low = rng.choice([3.0, 9.0], size).astype(np.float32)
    guide = rng.integers(0, 255, (*high, 3)).astype(np.uint8)

    done = upsample(low, guide, method)

    assert done.disparity_px.shape == high
    scale = high[1] / size[1]
    assert done.disparity_px.min() >= 3 * scale - 1e-3 * scale
    assert done.disparity_px.max() <= 9 * scale + 1e-3 * scale
    assert done.source.max() < low.size


@pytest.mark.parametrize("method", ["edge-snap", "geodesic"])
def test_a_pixel_has_the_disparity_of_its_source(method: str, low: np.ndarray, picture: np.ndarray) -> None:
    done = upsample(low, picture, method)

    at_source = 4 * low.ravel()[done.source]
    assert np.abs(at_source - done.disparity_px).max() < 0.5  # slopes are 0.03 px a pixel, and sources 2 to 6 px away
    assert ((done.flags & Flag.BAND) != 0).sum() > 1000


def test_a_guide_that_is_off_costs_accuracy_step_by_step() -> None:
    size, high = (72, 92), (288, 368)
    disc = Disc(x=180.5, y=141.5, radius=90)
    low, truth = disc.low(size, Grid.between(size, high)), disc.truth(high)
    blocky = score(cv2.resize(low * 4, high[::-1], interpolation=cv2.INTER_NEAREST), truth, 4).edge_percent

    wrong = [
        score(upsample(low, np.roll(disc.picture(high), by, 1)).disparity_px, truth, 4).edge_percent for by in (0, 1, 2)
    ]

    assert wrong[0] < 0.1 * blocky
    assert wrong[0] < wrong[1] < wrong[2]
    assert wrong[1] < 0.6 * blocky


def test_a_small_thing_survives_where_a_still_is_hardly_larger() -> None:
    low = np.full((20, 20), 5.0, np.float32)
    low[10, 4:16] = 15.0  # one site wide
    guide = np.where(np.kron(low, np.ones((2, 2))) > 10, 200, 40).astype(np.uint8)

    found = upsample(low, guide).disparity_px

    np.testing.assert_allclose(found[20:22, 10:30], 30.0)
    assert ((found > 20) != (guide > 100)).mean() < 0.01


def test_the_medians_are_those_of_opencv(rng: np.random.Generator) -> None:
    values = np.rint(rng.normal(0, 3, (40, 50))).astype(np.float32)
    rows, columns = np.mgrid[2:38, 2:48]
    found = (rows * 50 + columns).ravel().astype(np.int32)
    medians = np.empty(found.size, np.float32)

    find_medians(values, found, medians)

    np.testing.assert_array_equal(medians, cv2.medianBlur(values, 5).ravel()[found])


def test_joint_bilateral_is_the_formula_of_the_paper(rng: np.random.Generator) -> None:
    low, guide = rng.uniform(5, 9, (6, 7)).astype(np.float32), rng.integers(90, 130, (18, 21)).astype(np.uint8)
    low[2, 3] = np.nan
    trust = rng.uniform(0.1, 1, low.shape).astype(np.float32)

    found = upsample(low, guide, "joint-bilateral", confidence=trust).disparity_px

    for y, x in ((8, 10), (0, 0), (17, 4), (5, 20)):
        v, u = (y + 0.5) / 3 - 0.5, (x + 0.5) / 3 - 0.5
        total = whole = 0.0
        for j in range(6):
            for i in range(7):
                if abs(j - np.floor(v + 0.5)) > 2 or abs(i - np.floor(u + 0.5)) > 2 or np.isnan(low[j, i]):
                    continue
                apart = float(guide[y, x]) - float(guide[3 * j + 1, 3 * i + 1])
                weight = trust[j, i] * np.exp(-((v - j) ** 2 + (u - i) ** 2) / 2) * np.exp(-(apart**2) / (2 * 12.0**2))
                total, whole = total + weight * low[j, i], whole + weight
        assert found[y, x] == pytest.approx(3 * total / whole, abs=0.02)  # distances come from a table of 1/32


@pytest.mark.parametrize("method", CHOOSING)
def test_methods_that_choose_put_nothing_between_two_surfaces(
    method: str, low: np.ndarray, picture: np.ndarray
) -> None:
    done = upsample(low, picture, method).disparity_px

    assert ((done > 36) & (done < 54)).sum() == 0
    assert ((upsample(low, picture, "joint-bilateral").disparity_px > 36) & (done < 54)).any()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"method": "magic"}, "there is no method 'magic': choose one of edge-snap"),
        ({"guide": np.zeros((9, 9), np.uint16)}, "a guide is an 8-bit picture, grey or BGR, not uint16"),
        ({"guide": np.zeros((9, 9, 4), np.uint8)}, r"not uint8 \(9, 9, 4\)"),
        ({"disparity_px": np.zeros((3, 3), np.int32)}, "float, not int32"),
        ({"guide": np.zeros((2, 2), np.uint8)}, "scale_x is 0.666667: a still has 1 to 64 pixels for each"),
        ({"confidence": np.ones((3, 3), np.float32)}, "edge-snap does not weigh by confidence"),
        ({"method": "joint-bilateral", "confidence": np.ones((2, 3), np.float32)}, r"confidence is \(2, 3\), the map \(3, 3\)"),
        ({"threads": 0}, "0 threads cannot work"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said(change: dict[str, Any], complaint: str) -> None:
    wish: dict[str, Any] = {"disparity_px": np.zeros((3, 3), np.float32), "guide": np.zeros((9, 9), np.uint8)}

    with pytest.raises(UsageError, match=complaint):
        upsample(**{**wish, **change})


def test_the_source_is_made_from_flags_when_it_is_asked_for(low: np.ndarray, picture: np.ndarray) -> None:
    done = upsample(low, picture)

    assert isinstance(done, Upsampled)
    assert done.sources is None
    flat = (done.flags & Flag.BAND) == 0
    rows, columns = np.mgrid[: STILL[0], : STILL[1]]
    nearest = np.floor((rows + 0.5) / 4).astype(int) * LOW[1] + np.floor((columns + 0.5) / 4).astype(int)
    np.testing.assert_array_equal(done.source[flat], nearest[flat])
