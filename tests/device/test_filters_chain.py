"""Chains of filters: files and presets, what each filter does to known planes and edges, and laws that none may break."""

from __future__ import annotations

import dataclasses
import logging
import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import PRESETS, FilterChain, chain, warm_up
from prismstereo_device.filters.clean import Clean
from prismstereo_device.filters.decimate import Decimate
from prismstereo_device.filters.holes import Holes
from prismstereo_device.filters.range_gate import RangeGate
from prismstereo_device.filters.spatial import Spatial
from prismstereo_device.filters.speckle import Speckle
from prismstereo_device.filters.temporal import Temporal
from prismstereo_device.match import create
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin
from sgbm_anchor import sgbm_anchor

WINDOW = DisparityWindow(labels=128, offset_px=-1.0, scale_px=50_000.0)
EVERY = (Speckle(largest_pixels=3), Clean(), Spatial(), Temporal(), Holes(), Decimate())


def disparity_map(disparity: object, **more: object) -> DisparityMap:
    return DisparityMap(np.atleast_2d(np.asarray(disparity, np.float32)), WINDOW, **more)  # type: ignore[arg-type]


def by(*filters: object) -> FilterChain:
    return FilterChain(tuple(filters))  # type: ignore[arg-type]


def two_surfaces(rng: np.random.Generator, noise_px: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A near half (60 px) beside a far one (20 px), without and with noise."""
    true = np.where(np.arange(80) < 40, 60.0, 20.0) * np.ones((60, 1))
    return true.astype(np.float32), (true + rng.normal(0, noise_px, true.shape)).astype(np.float32)


# ---- files and presets


def test_a_chain_of_nothing_gives_the_very_map_back() -> None:
    given_map = disparity_map([[1, np.nan, 3]])
    assert FilterChain().apply(given_map) is given_map


def test_presets_come_with_the_product_and_say_why() -> None:
    kinds = {name: [type(each).__name__ for each in chain(name).filters] for name in PRESETS}
    assert kinds["robot"] == [
        "RangeGate",
        "Speckle",
        "Decimate",
    ]  # late means or filled gaps would be free space nobody saw
    assert kinds["measure"] == ["Speckle"]  # nothing averaged or moved
    assert set(kinds) == {"near", "robot", "face", "outdoor", "measure"}


def test_a_file_makes_a_chain_in_its_order(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('[[filters]]\nkind = "range"\nfar_mm = 900\n[[filters]]\nkind = "decimate"\nfactor = 4\n')
    assert chain(file).filters == (RangeGate(near_mm=0.0, far_mm=900.0), Decimate(factor=4))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[filters]]\nkind = "speckle"\nsize = 3', "unknown field `size` - at `\\$.filters\\[0\\]`: the kinds of filters are"),
        ('[[filter]]\nkind = "speckle"', "unknown field `filter`"),
        ('[[filters]]\nkind = "blur"', "Invalid value 'blur'.*clean, decimate, holes, range, spatial, speckle, temporal"),
        ('[[filters]]\nkind = "decimate"\nfactor = 1', "`int` >= 2 - at `\\$.filters\\[0\\].factor`"),
        ('[[filters]]\nkind = "range"\nnear_mm = 9\nfar_mm = 5', "the gate 9:5 mm is empty"),
        ('[[filters]]\nkind = "holes"\n[[filters]]\nkind = "spatial"', "spatial stands behind holes .* put holes last"),
        ("[[filters", "own.toml: "),
    ],
)  # fmt: skip
def test_what_no_filter_has_is_refused_by_name(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(text)
    with pytest.raises(UsageError, match=words):
        chain(file)


def test_what_is_no_preset_and_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match="no filters 'magic': give one of near, robot, face, outdoor, measure, or the path"
    ):
        chain("magic")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot be read as UTF-8"):
        chain(tmp_path / "binary.toml")
    (tmp_path / "huge.toml").write_text("#" * 70_000)
    with pytest.raises(UsageError, match="70000 bytes: a filter file has at most 65536"):
        chain(tmp_path / "huge.toml")


def test_numbers_given_in_a_program_are_checked_as_those_of_a_file() -> None:
    with pytest.raises(UsageError, match="`int` >= 2"):
        by(Decimate(factor=0))
    with pytest.raises(UsageError, match="0 threads: give 1 to 64"):
        FilterChain((), threads=0)
    with pytest.raises(UsageError, match="33 filters: a chain has at most 32"):
        by(*[Speckle()] * 33)


@pytest.mark.parametrize(
    "picture", [np.zeros((2, 3), np.uint8), np.zeros((1, 3), np.float32), np.zeros((1, 3, 4), np.uint8)]
)
def test_a_picture_that_does_not_fit_is_refused(picture: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"but the disparity map \(1, 3\)"):
        by(Clean()).apply(disparity_map([[1, 2, 3]]), picture)


# ---- each filter on what is known


def test_the_range_gate_says_too_near_and_too_far() -> None:
    given_map = disparity_map(
        [[11, 51, 101, np.nan]], confidence=np.array([[9, 9, 9, 0]], np.uint8)
    )  # 5000, 1000, 500 mm
    found = by(RangeGate(near_mm=600, far_mm=3000)).apply(given_map)
    np.testing.assert_array_equal(found.disparity_px, [[np.nan, 51, np.nan, np.nan]])
    np.testing.assert_array_equal(found.reasons, [[Reason.TOO_FAR, Reason.MATCHED, Reason.TOO_NEAR, Reason.UNMATCHED]])
    np.testing.assert_array_equal(found.confidence, [[0, 9, 0, 0]])


def test_a_range_gate_needs_depth() -> None:
    flat = DisparityMap(np.ones((2, 2), np.float32), DisparityWindow(16))
    with pytest.raises(
        UsageError, match="needs depth, but this pair has no focal length and baseline: leave the filter out"
    ):
        by(RangeGate(near_mm=600)).apply(flat)


def test_speckles_go_and_say_that_they_were_filtered(rng: np.random.Generator) -> None:
    _, disparity = two_surfaces(rng)
    disparity[10:14, 60:65] = 90.0  # 20 pixels of something else
    found = by(Speckle(largest_pixels=20)).apply(disparity_map(disparity))
    assert (found.reasons == Reason.FILTERED).sum() == 20
    assert np.isnan(found.disparity_px[10:14, 60:65]).all()
    assert by(Speckle(largest_pixels=19)).apply(disparity_map(disparity)).density == 1.0


def test_levelling_takes_the_noise_of_surfaces_and_leaves_their_edge(rng: np.random.Generator) -> None:
    true, noisy = two_surfaces(rng)
    error = by(Spatial(radius_px=2, edge_percent=5.0)).apply(disparity_map(noisy)).disparity_px - true
    assert np.sqrt((error**2).mean()) < 0.4 * 0.2  # 25 pixels: a fifth, less at the rims
    assert np.abs(error).max() < 1.0


def test_levelling_keeps_the_slope_of_a_plane_up_to_its_rim() -> None:
    plane = np.fromfunction(lambda y, x: 30 + 0.05 * x - 0.03 * y, (40, 50)).astype(np.float32)
    found = by(Spatial(radius_px=3)).apply(disparity_map(plane))
    np.testing.assert_allclose(found.disparity_px, plane, atol=1e-4)


def test_time_levels_what_stands_still(rng: np.random.Generator) -> None:
    stream, true = by(Temporal(time_constant_ms=300)).stream(), np.full((40, 50), 40.0, np.float32)
    for index in range(20):
        noisy = (true + rng.normal(0, 0.15, true.shape)).astype(np.float32)
        found = stream.apply(disparity_map(noisy), time_us=33_333 * index)
    assert (found.disparity_px - true).std() < 0.4 * 0.15


def test_what_moves_is_not_late() -> None:
    stream = by(Temporal()).stream()
    picture = np.full((1, 3), 100, np.uint8)
    for disparity in ([[20, 40, 40.0]], [[20, 40, 60.0]]):
        found = stream.apply(disparity_map(disparity), picture)
    np.testing.assert_array_equal(found.disparity_px, [[20, 40, 60]])  # a jump begins anew
    found = stream.apply(disparity_map([[20, 40.5, 60]]), np.full((1, 3), 120, np.uint8))
    np.testing.assert_array_equal(found.disparity_px, [[20, 40.5, 60]])  # so does a change of the picture
    found = stream.apply(disparity_map([[20, np.nan, 60.5]]), np.full((1, 3), 120, np.uint8))
    assert np.isnan(found.disparity_px[0, 1])  # nothing is held where nothing is matched
    assert found.disparity_px[0, 2] == pytest.approx(60.25)  # the second of a young mean counts half


@pytest.mark.parametrize("speed_px", [0.05, 0.2, 0.5])
def test_what_comes_closer_slowly_is_late_by_less_than_noise_at_most(speed_px: float) -> None:
    stream = by(Temporal(time_constant_ms=300)).stream()
    for index in range(40):
        true = 10.0 + speed_px * index
        found = stream.apply(disparity_map([[true]]), time_us=33_333 * index)
        tolerance = max(0.25, 0.02 * (true + WINDOW.offset_px))
        assert 0 <= true - found.disparity_px[0, 0] <= tolerance + 1e-4


@pytest.mark.parametrize("elapsed_us", [600_000, -1])
def test_a_pause_or_a_new_clock_forgets_all(elapsed_us: int) -> None:
    stream = by(Temporal()).stream()
    stream.apply(disparity_map([[20.0]]), time_us=10_000_000)
    found = stream.apply(disparity_map([[20.2]]), time_us=10_000_000 + elapsed_us)
    assert found.disparity_px == np.float32(20.2)


def test_streams_of_one_chain_know_nothing_of_each_other() -> None:
    filters = by(Temporal())
    one, other = filters.stream(), filters.stream()
    one.apply(disparity_map([[20.0]]))
    assert other.apply(disparity_map([[20.2]])).disparity_px == np.float32(20.2)
    assert one.apply(disparity_map([[20.2]])).disparity_px == pytest.approx(20.1)


@pytest.mark.parametrize("factor", [2, 3, 8])
def test_decimation_keeps_the_closest_and_its_depth(factor: int, rng: np.random.Generator) -> None:
    disparity = rng.uniform(2, 126, (45, 70)).astype(np.float32)
    disparity[rng.random(disparity.shape) < 0.3] = np.nan
    given_map = disparity_map(disparity)
    small = by(Decimate(factor=factor)).apply(given_map)
    depth = given_map.depth()
    for y, x in np.ndindex(*small.disparity_px.shape):
        block = depth[y * factor : (y + 1) * factor, x * factor : (x + 1) * factor]
        closest_mm = np.nan if np.isnan(block).all() else np.nanmin(block)
        np.testing.assert_allclose(small.depth()[y, x], closest_mm, rtol=1e-5)
    assert small.disparity_px.shape == (math.ceil(45 / factor), math.ceil(70 / factor))
    assert small.window.nearest <= given_map.window.nearest * (1 + 1e-9)
    assert np.nanmax(small.disparity_px) <= small.window.labels - 1


def test_filling_is_marked_and_says_still_why_there_was_no_match() -> None:
    reasons = np.array([[0, 6, 6, 0, 13, 13, 13, 0, 5, 0, 13]], np.uint8)
    given_map = disparity_map(
        [[60, np.nan, np.nan, 20, np.nan, np.nan, np.nan, 30, np.nan, 30, np.nan]], reasons=reasons
    )
    found, filled = by(Holes(widest_px=2)).stream().filtered(given_map)
    np.testing.assert_array_equal(  # too wide; known to be too far; at the rim: three gaps stay
        found.disparity_px, [[60, 20, 20, 20, np.nan, np.nan, np.nan, 30, np.nan, 30, np.nan]]
    )
    np.testing.assert_array_equal(np.flatnonzero(filled), [1, 2])
    np.testing.assert_array_equal(found.reasons, reasons)


def test_cleaning_puts_a_fattened_edge_back_to_where_the_picture_has_it(rng: np.random.Generator) -> None:
    true, disparity = two_surfaces(rng, noise_px=0.05)
    disparity[:, 40:42] = 60.0  # two columns of the far side were matched with the near one
    picture = np.where(true > 40, 180, 60) + rng.integers(-8, 9, true.shape)
    confidence = np.full(true.shape, 200, np.uint8)
    confidence[:, 40:42] = 60
    given_map = disparity_map(disparity, confidence=confidence)
    cleaned = by(Clean()).apply(given_map, picture.astype(np.uint8))
    assert np.abs(cleaned.disparity_px - true)[:, 36:44].max() < 0.5
    np.testing.assert_array_equal(cleaned.disparity_px[:, :36], disparity[:, :36])  # what was right is as it was
    assert cleaned.confidence is not None
    assert cleaned.confidence[:, 40:42].max() == 60


def test_no_filter_makes_a_depth_between_two_surfaces(rng: np.random.Generator) -> None:
    _, noisy = two_surfaces(rng)
    noisy[rng.random(noisy.shape) < 0.2] = np.nan
    for each in EVERY:
        found = by(each).apply(disparity_map(noisy))
        values = found.disparity_px[found.valid] * (2 if isinstance(each, Decimate) else 1)
        assert np.all((np.abs(values - 20) < 2) | (np.abs(values - 60) < 2))


# ---- laws

MAPS = arrays.arrays(
    np.float32,
    st.tuples(st.integers(1, 9), st.integers(1, 11)),
    elements=st.integers(0, 640).map(lambda steps: np.float32(steps / 16)) | st.just(np.float32(np.nan)),
)


@settings(deadline=None, max_examples=60)
@given(MAPS, st.sampled_from(EVERY), st.booleans())
def test_no_filter_invents_a_disparity_or_loses_count_of_what_is_unmatched(
    disparity: np.ndarray, each: object, told: bool
) -> None:
    confidence = np.where(np.isnan(disparity), 0, 77).astype(np.uint8) if told else None
    found, filled = by(each).stream().filtered(disparity_map(disparity, confidence=confidence))
    scale = 2 if isinstance(each, Decimate) else 1
    if found.valid.any():
        assert np.nanmin(found.disparity_px) * scale >= np.nanmin(disparity) - 1e-4
        assert np.nanmax(found.disparity_px) * scale <= np.nanmax(disparity) + 1e-4
    unmatched, before = np.isnan(found.disparity_px), np.isnan(disparity)
    if isinstance(each, Holes):
        np.testing.assert_array_equal(filled, before & ~unmatched)
    elif not isinstance(each, Decimate):
        assert filled is None
        assert unmatched[before].all()
        assert isinstance(each, Speckle) or (unmatched == before).all()
    assert found.reasons is not None
    assert (found.reasons[unmatched] != Reason.MATCHED).all()
    assert (found.confidence is not None) == told
    if found.confidence is not None:
        assert (found.confidence[unmatched] == 0).all()
        assert (found.confidence[~unmatched & (~filled if filled is not None else True)] > 0).all()


def test_the_map_that_was_given_stays_as_it_was_and_threads_change_nothing(rng: np.random.Generator) -> None:
    _, noisy = two_surfaces(rng)
    noisy = np.tile(noisy, (5, 1))  # 300 rows: bands of them
    noisy[rng.random(noisy.shape) < 0.2] = np.nan
    picture = rng.integers(0, 256, noisy.shape, np.uint8)
    confidence = np.where(np.isnan(noisy), 0, rng.integers(1, 256, noisy.shape)).astype(np.uint8)
    given_map = disparity_map(noisy.copy(), confidence=confidence.copy())
    filters = (RangeGate(near_mm=420), *EVERY)
    one, two, three = (FilterChain(filters, threads).apply(given_map, picture) for threads in (1, 2, 3))
    for other in (two, three):
        for name in ("disparity_px", "confidence", "reasons"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(given_map.disparity_px, noisy)
    np.testing.assert_array_equal(given_map.confidence, confidence)
    assert given_map.reasons is None


# ---- from the sensor


@pytest.fixture(scope="module")
def half_size(oak: Rig) -> tuple[DisparityMap, np.ndarray]:
    """A plane at 700 mm before an OAK-1 that is read out at half its size: what was matched, and the left picture."""
    video = Mode(width=640, height=360, rate_hz=30.0)
    rig = msgspec.structs.replace(oak, camera=msgspec.structs.replace(oak.camera, video=video))
    pipeline = Pipeline(Calibration.nominal(rig), create("sgbm"))
    pair = pipeline.split(Twin(rig, facing_plane(rig, 700.0)).frame())
    return pipeline.disparity(pair), pipeline.rectifier.rectify(pair).left


@pytest.mark.parametrize("name", PRESETS)
def test_a_plane_keeps_its_depth_through_every_preset(name: str, half_size: tuple[DisparityMap, np.ndarray]) -> None:
    found, picture = half_size
    filtered = chain(name).apply(found, picture)
    assert found.window.glass is not None  # what the prism bends stays known, in the decimated map too
    assert np.nanmedian(filtered.depth()) == pytest.approx(np.nanmedian(found.depth()), rel=0.001)
    assert np.nanpercentile(np.abs(filtered.depth() - np.nanmedian(found.depth())), 99) < 6.0
    assert filtered.density > 0.99 * found.density


def test_levelling_halves_the_noise_of_a_seen_plane(half_size: tuple[DisparityMap, np.ndarray]) -> None:
    found, _ = half_size
    rough = dataclasses.replace(
        found, disparity_px=found.disparity_px + np.random.default_rng(7).normal(0, 0.2, found.disparity_px.shape)
    )
    before, after = (np.nanstd(each.depth()) for each in (rough, by(Spatial(edge_percent=5.0)).apply(rough)))
    assert after < 0.55 * before


# ---- real pictures with known truth


@pytest.mark.parametrize(
    ("name", "files", "scale", "labels"),
    [
        ("teddy", ("im2.png", "im6.png", "disp2.png"), 4, 64),
        ("tsukuba", ("im3.png", "im4.png", "disp3.pgm"), 16, 16),
        ("moebius_third", ("view1.png", "view5.png", "disp1.png"), 3, 80),
    ],
)
def test_cleaning_takes_a_twentieth_of_the_errors_at_real_edges(
    name: str, files: tuple[str, str, str], scale: int, labels: int, data: Path
) -> None:
    folder = data / "gt-middlebury" / name
    if not folder.is_dir():
        pytest.skip(f"real data: {folder} is not there")
    left, right, truth = (cv2.imread(str(folder / file), cv2.IMREAD_GRAYSCALE) for file in files)
    anchor = sgbm_anchor(labels)
    disparity = anchor.compute(left, right).astype(np.float32) / 16
    disparity[disparity < 0] = np.nan
    true = truth.astype(np.float32) / scale
    near = np.ones((9, 9), np.uint8)
    edge = (cv2.dilate(true, near) - cv2.erode(true, near) > 2) & (cv2.erode(truth, near) > 0)
    found = by(Clean()).apply(disparity_map(disparity), left)
    before, after = ((np.abs(each - true) > 2)[edge & found.valid].mean() for each in (disparity, found.disparity_px))
    assert after < 0.96 * before


def test_warming_up_compiles_what_a_chain_needs_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "prismstereo_device.filters"):
        warm_up(chain("robot")).join(60)
        warm_up().join(60)
    assert [record.message for record in caplog.records if record.levelno == logging.INFO] == [
        "compiling the disparity filters in the background (seconds once, then from the cache)"
    ] * 2
