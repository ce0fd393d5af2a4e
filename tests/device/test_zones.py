from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import chain
from prismstereo_device.zones import ZoneFinder
from prismstereo_hw.rig import Rig

Depth = NDArray[np.float64]
FAR_WALL_MM = 4000.0


@pytest.fixture(scope="module")
def how() -> Rectification:
    return rectification(Calibration.nominal(Rig.read("oak-1")))


def rays(how: Rectification) -> tuple[Depth, Depth]:
    """Slopes across and down of every pixel."""
    columns, rows = np.meshgrid(np.arange(how.width), np.arange(how.height))
    return (columns - how.left.cx_px) / how.focal_px, (rows - how.cy_px) / how.focal_px


def floor_depth(how: Rectification, height_mm: float, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Depth:
    """Depth of a floor `height_mm` below a camera that looks down by `pitch_deg`; the far wall where no floor is."""
    across, down = rays(how)
    pitch, roll = np.radians(pitch_deg), np.radians(roll_deg)
    normal = np.array([np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch), np.sin(pitch)])
    towards = across * normal[0] + down * normal[1] + normal[2]
    with np.errstate(divide="ignore"):
        depth = np.where(towards > 1e-9, height_mm / towards, np.inf)
    return np.minimum(depth, FAR_WALL_MM)


def matched(how: Rectification, depth: Depth, noise_px: float = 0.15, outliers: float = 0.001) -> DisparityMap:
    """What a good matcher makes of true depth: noise, one pixel in a thousand anywhere, a tenth unmatched."""
    random = np.random.default_rng(3)
    window = how.window
    found = window.scale_px / depth - window.offset_px + random.normal(0, noise_px, depth.shape)
    wild = random.random(depth.shape) < outliers
    found[wild] = random.uniform(1, window.labels, np.count_nonzero(wild))
    found[(random.random(depth.shape) < 0.1) | (found > window.labels - 1)] = np.nan
    return DisparityMap(found.astype(np.float32), window)


def put(depth: Depth, zone: tuple[int, int], distance_mm: float, size_px: int = 40) -> tuple[slice, slice]:
    """Stand a square thing into the middle of a zone of 4 x 8."""
    height, width = depth.shape
    middle = round((zone[0] + 0.5) * height / 4), round((zone[1] + 0.5) * width / 8)
    part = (
        slice(middle[0] - size_px // 2, middle[0] + size_px // 2),
        slice(middle[1] - size_px // 2, middle[1] + size_px // 2),
    )
    depth[part] = distance_mm
    return part


@pytest.mark.parametrize(("height_mm", "pitch_deg", "roll_deg"), [(250, 0, 0), (400, 20, 3), (600, 35, -8)])
def test_a_floor_is_no_obstacle_and_what_stands_on_it_is(
    how: Rectification, height_mm: float, pitch_deg: float, roll_deg: float
) -> None:
    depth = floor_depth(how, height_mm, pitch_deg, roll_deg)
    behind = float(depth[round(3.5 * how.height / 4), round(2.5 * how.width / 8)])
    put(depth, (3, 2), 0.8 * behind)
    zones = ZoneFinder(how).find(matched(how, depth), 7, 1234)
    assert zones.floor_removed
    assert (zones.index, zones.timestamp_us) == (7, 1234)
    assert zones.nearest_mm[3, 2] == pytest.approx(0.8 * behind, rel=0.02)
    others = np.delete(zones.nearest_mm[3], 2)
    assert np.all(others == 65535), "bare floor, nothing on it"


def test_a_wall_that_fills_the_picture_is_an_obstacle_and_no_floor(how: Rectification) -> None:
    zones = ZoneFinder(how).find(matched(how, np.full((how.height, how.width), 900.0)), 0, 0)
    assert not zones.floor_removed
    np.testing.assert_allclose(zones.nearest_mm, 900, rtol=0.02)


def test_a_ceiling_is_an_obstacle_and_no_floor(how: Rectification) -> None:
    depth = floor_depth(how, 400)[::-1].copy()
    zones = ZoneFinder(how).find(matched(how, depth), 0, 0)
    assert not zones.floor_removed
    assert np.all(zones.nearest_mm[0] < 2000)


def test_every_zone_tells_its_own_nearest_thing(how: Rectification) -> None:
    depth = np.full((how.height, how.width), FAR_WALL_MM)
    placed = {(0, 0): 600.0, (1, 5): 1500.0, (2, 7): 450.0, (3, 3): 2500.0}
    for zone, distance_mm in placed.items():
        put(depth, zone, distance_mm)
    zones = ZoneFinder(how).find(matched(how, depth), 0, 0)
    for zone, distance_mm in placed.items():
        assert zones.nearest_mm[zone] == pytest.approx(distance_mm, rel=0.03)
    empty = [zones.nearest_mm[row, column] for row in range(4) for column in range(8) if (row, column) not in placed]
    np.testing.assert_allclose(empty, FAR_WALL_MM, rtol=0.1)


def test_single_wrong_matches_are_no_obstacle(how: Rectification) -> None:
    depth = np.full((how.height, how.width), 2000.0)
    zones = ZoneFinder(how).find(matched(how, depth, outliers=0.005), 0, 0)
    np.testing.assert_allclose(zones.nearest_mm, 2000, rtol=0.05)


def test_a_zone_in_which_nothing_was_matched_says_so(how: Rectification) -> None:
    found = matched(how, np.full((how.height, how.width), 2000.0))
    found.disparity_px[: how.height // 4, : how.width // 8] = np.nan
    zones = ZoneFinder(how).find(found, 0, 0)
    assert zones.nearest_mm[0, 0] == 0
    assert np.count_nonzero(zones.nearest_mm == 0) == 1


def test_a_decimated_map_has_the_same_zones(how: Rectification) -> None:
    depth = floor_depth(how, 300, 10)
    put(depth, (2, 4), 550.0, 80)
    whole = matched(how, depth, outliers=0.0)
    decimated = chain("robot").stream().apply(whole, np.zeros(depth.shape, np.uint8))
    assert decimated.disparity_px.shape[0] < depth.shape[0]
    zones = ZoneFinder(how).find(decimated, 0, 0)
    assert zones.floor_removed
    assert zones.nearest_mm[2, 4] == pytest.approx(550, rel=0.03)


def test_grids_of_other_sizes_cover_the_whole_picture(how: Rectification) -> None:
    zones = ZoneFinder(how, rows=3, columns=5).find(matched(how, np.full((how.height, how.width), 1000.0)), 0, 0)
    assert zones.nearest_mm.shape == (3, 5)
    np.testing.assert_allclose(zones.nearest_mm, 1000, rtol=0.02)
