"""Both views show one thing equally bright, once a flat field or an ordinary scene has told how their light differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.light.flat_field import measure
from prismstereo_calibration.light.matched_gain import gain_between
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.photometry import (
    GainMap,
    Photometry,
    PhotometryPart,
    ViewLight,
    of_part,
    part_of,
)
from prismstereo_calibration.seam import Seam
from prismstereo_hw.errors import ImageError
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin
from prismstereo_hw.view import LAYOUTS

HEIGHT, WIDTH = 360, 640
VIEWS = LAYOUTS["swapped"]  # as behind a prism: the right half of the frame is the left view
RIGHT_LIGHT = 0.8  # of the left view's
BLACK_GREY = 6.0
Grey = NDArray[np.float64]


def falloff(height: int = HEIGHT, width: int = WIDTH) -> Grey:
    """What a lens leaves towards its corners, a mirror in the right view takes a fifth of."""
    rows, columns = np.mgrid[:height, :width]
    away = ((columns - width / 2) ** 2 + (rows - height / 2) ** 2) / (width / 2) ** 2
    return np.where(columns < width // 2, RIGHT_LIGHT, 1.0) * (1 - 0.25 * away)


def exposed(grey: Grey, seed: int = 1, noise: float = 2.0, black_grey: float = 0.0) -> NDArray[np.uint8]:
    noisy = grey + black_grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def walls(level: float = 170.0, count: int = 3, black_grey: float = 0.0) -> list[NamedFrame]:
    return [
        NamedFrame(f"wall{seed}.png", exposed(level * falloff(), seed, black_grey=black_grey)) for seed in range(count)
    ]


def test_a_flat_field_becomes_flat_and_both_views_equal() -> None:
    flat = measure(walls(), VIEWS)

    for light, view in zip((flat.photometry.left, flat.photometry.right), VIEWS, strict=True):
        gain = light.spread(WIDTH // 2, HEIGHT).gain
        even = gain * view.cut(falloff())
        assert even.std() / even.mean() < 0.002
        assert np.abs(even / even.mean() - 1).max() < 0.015  # the very corners are held by few blocks
    left = flat.photometry.left.spread(WIDTH // 2, HEIGHT).gain
    assert left[HEIGHT // 2, WIDTH // 4] == pytest.approx(1.0, abs=0.001)
    assert flat.right_gain == pytest.approx(1 / RIGHT_LIGHT, rel=0.003)


def test_black_frames_take_the_black_level_out() -> None:
    dark = [NamedFrame("cap.png", exposed(np.zeros((HEIGHT, WIDTH)), 9, black_grey=BLACK_GREY))]
    flat = measure(walls(black_grey=BLACK_GREY), VIEWS, dark=dark)

    assert flat.photometry.right.black_grey == BLACK_GREY
    assert flat.right_gain == pytest.approx(1 / RIGHT_LIGHT, rel=0.003)


def test_the_band_at_the_seam_and_dark_rims_say_nothing() -> None:
    clean = measure(walls(), VIEWS)
    spoilt = []
    for wall in walls():
        pixels = wall.pixels.copy()
        pixels[:, WIDTH // 2 - 15 : WIDTH // 2 + 15] = 60
        pixels[:, :40] = 3  # no total reflection there
        spoilt.append(NamedFrame(wall.name, pixels))
    flat = measure(spoilt, VIEWS, Seam((WIDTH - 1) / 2, 0.0, 30.0, 2.0))

    for one, other in ((clean.photometry.left, flat.photometry.left), (clean.photometry.right, flat.photometry.right)):
        ratio = one.spread(WIDTH // 2, HEIGHT).gain / other.spread(WIDTH // 2, HEIGHT).gain
        assert np.abs(ratio[:, 48:-48] - 1).max() < 0.01
        assert np.abs(ratio - 1).max() < 0.08  # carried on smoothly where nothing is known


def test_the_same_thing_is_equally_bright_in_both_views(small: Rig) -> None:
    twin = Twin(small, facing_plane(small, 700.0), noise=0.0)
    video = small.camera.video
    light = falloff(video.height, video.width)
    wall = NamedFrame("wall.png", exposed(190 * light, noise=0.5))
    raw = exposed(twin.frame().pixels * light, noise=0.0)

    photometry = measure([wall], small.views).photometry
    left, right = (
        light.spread(*view.upright_size(video.width, video.height)).apply(view.cut(raw))
        for light, view in zip((photometry.left, photometry.right), small.views, strict=True)
    )
    match = twin.truth().match_px
    raw_views = [view.cut(raw) for view in small.views]
    before, after = differences(match, *raw_views), differences(match, left, right)
    assert np.nanmedian(before) > 12  # grey levels
    assert abs(np.nanmedian(after)) < 0.6
    parts = [part for rows in np.array_split(after, 3, axis=0) for part in np.array_split(rows, 3, axis=1)]
    assert max(abs(np.nanmedian(part)) for part in parts) < 1.5  # top, bottom and sides alike


def differences(match_px: NDArray[np.float32], left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Grey:
    """Left minus right grey levels (height, width) of the same thing, NaN where only the left view sees it."""
    seen = np.isfinite(match_px[..., 0])  # the right view begins at raw column 0
    at = np.rint(match_px[seen]).astype(int)
    found = np.full(left.shape, np.nan)
    found[seen] = left[seen].astype(float) - right[at[:, 1], at[:, 0]]
    return found


def test_applying_is_gain_times_what_is_above_black_for_grey_and_colour() -> None:
    random = np.random.default_rng(3)
    grid = random.uniform(0.7, 1.6, (9, 16)).astype(np.float32)
    spread = ViewLight(grid, 4.0).spread(60, 50)
    picture = random.integers(0, 256, (50, 60, 3)).astype(np.uint8)

    wanted = np.clip(spread.gain[..., None] * (picture.astype(float) - 4), 0, 255)
    assert np.abs(spread.apply(picture) - wanted).max() <= 0.501
    np.testing.assert_array_equal(spread.apply(picture[..., 0]), spread.apply(picture)[..., 0])
    assert spread.gain[0, 0] == grid[0, 0]
    assert spread.gain[-1, -1] == grid[-1, -1]
    with pytest.raises(ImageError, match="60x49 pixels, but its gain map is for 60x50"):
        spread.apply(picture[:-1])
    unchanged = GainMap(np.ones((50, 60), np.float32), 0.0)
    np.testing.assert_array_equal(unchanged.apply(picture), picture)


def _saturated(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pixels[:30, -80:] = 255
    return pixels


def _sized(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return pixels[:-2]


def _dim(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return pixels // 6


def _shaded(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pixels[:, 400:480] -= 20
    return pixels


def _covered(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.where(np.indices(pixels.shape).sum(axis=0) % 16 < 6, 0, pixels).astype(np.uint8)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (_saturated, r"wall1.png is saturated: 2\.\d % of its left view"),
        (_dim, r"wall1.png is dark: its left view has 2\d grey levels"),
        (_sized, "wall1.png is 640x358, but wall0.png is 640x360"),
        (_shaded, r"wall0.png and 2 more: no flat field, the light differs by [0-9.]+ % within a few pixels"),
        (_covered, r"only 0 % of the left view is lit"),
    ],
)
def test_what_is_no_flat_field_is_refused_by_name(
    spoil: Callable[[NDArray[np.uint8]], NDArray[np.uint8]], complaint: str
) -> None:
    frames = walls()
    every = spoil in (_shaded, _covered)
    spoilt = [replace(one, pixels=spoil(one.pixels.copy())) if every or i == 1 else one for i, one in enumerate(frames)]
    with pytest.raises(ImageError, match=complaint):
        measure(spoilt, VIEWS)


def test_an_ordinary_scene_is_no_flat_field_and_none_at_all_neither(oak: Rig) -> None:
    little = halved(oak)
    scene = Twin(little, facing_plane(little, 700.0)).frame().pixels
    with pytest.raises(ImageError, match=r"plane.png: no flat field"):
        measure([NamedFrame("plane.png", np.maximum(scene, 60))], little.views)
    with pytest.raises(ImageError, match="0 frames"):
        measure([], VIEWS)


def halved(rig: Rig) -> Rig:
    video = Mode(width=640, height=360, rate_hz=30.0)
    return msgspec.structs.replace(rig, camera=msgspec.structs.replace(rig.camera, video=video))


def test_an_ordinary_scene_tells_the_gain_between_the_views_to_half_a_percent(oak: Rig) -> None:
    little = halved(oak)
    pixels = Twin(little, facing_plane(little, 600.0)).frame().pixels.astype(float)
    pixels[:, : WIDTH // 2] *= RIGHT_LIGHT
    frame = NamedFrame("scene.png", exposed(pixels, noise=0.0))
    found = gain_between([frame], Calibration.nominal(little))

    assert found.right_gain == pytest.approx(1 / RIGHT_LIGHT, rel=0.005)
    assert found.votes >= 60
    assert found.sigma < 0.003
    assert Photometry.even(found.right_gain).right.spread(4, 3).gain == pytest.approx(found.right_gain)


def test_a_blank_wall_tells_no_gain(oak: Rig) -> None:
    with pytest.raises(CalibrationError, match="0 patches of 3 frames"):
        gain_between(walls(), Calibration.nominal(halved(oak)))


def test_a_photometry_comes_back_from_its_file_exactly() -> None:
    photometry = measure(walls(count=1), VIEWS).photometry
    text = msgspec.json.encode(part_of(photometry))
    back = of_part(msgspec.json.decode(text, type=PhotometryPart))

    assert len(text) < 4096
    for one, other in ((photometry.left, back.left), (photometry.right, back.right)):
        np.testing.assert_array_equal(one.gain, other.gain)
        assert (one.black_grey, other.gain.dtype) == (other.black_grey, np.float32)
    assert msgspec.json.encode(part_of(back)) == text


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("gain", [1.0] * 5, "has 5 numbers for 2 rows and 2 columns"),
        ("gain", [1.0, 1.0, 1.0, 0.0], "gain"),
        ("gain", [1.0, 1.0, 1.0, 1e9], "gain"),
        ("gain", "1111", "gain"),
        ("black_grey", -1.0, "black_grey"),
        ("rows", 1, "rows"),
        ("note", "hello", "note"),
    ],
)
def test_a_damaged_photometry_is_refused_by_its_field(key: str, value: object, complaint: str) -> None:
    content = msgspec.to_builtins(part_of(Photometry.even(1.25)))
    content["right"][key] = value
    with pytest.raises((msgspec.ValidationError, CalibrationError), match=complaint):
        of_part(msgspec.json.decode(msgspec.json.encode(content), type=PhotometryPart))


@pytest.mark.parametrize("gain", [np.full((2, 2), np.nan), np.zeros((2, 2)), np.ones(4), np.ones((1, 4))])
def test_a_gain_that_no_optics_have_is_refused(gain: Grey) -> None:
    with pytest.raises(CalibrationError, match="gain"):
        ViewLight(gain.astype(np.float32))
