"""The static mask: every pixel that can never be matched is known beforehand, with its reason, in a few kilobytes."""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.common_field import common_field
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.light.flat_field import measure
from prismstereo_calibration.light.measured_mask import measured_mask
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.rectified_reasons import rectified_reasons
from prismstereo_calibration.seam import Seam
from prismstereo_calibration.static_mask import (
    StaticMask,
    StaticMaskPart,
    StaticReason,
    of_part,
    part_of,
)
from prismstereo_hw.coverage import coverage
from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import LAYOUTS

Mask = NDArray[np.bool_]


@pytest.fixture(scope="module")
def near(oak: Rig) -> Calibration:
    """An OAK-1 for near things only: much of each view is outside of the other."""
    calibration = Calibration.nominal(oak)
    return replace(calibration, range=RangeWish(near_mm=150.0, far_mm=300.0, labels=256))


@pytest.fixture(scope="module")
def mask(oak: Rig) -> StaticMask:
    """That of an OAK-1 as its optics are: its seam, and where total reflection fails; made of its traced coverage."""
    seam = Seam(639.0, 0.4, 50.0, 2.0)
    return measured_mask(Calibration.nominal(oak), seam, measure([lit_wall(oak)], oak.views))


def lit_wall(rig: Rig) -> NamedFrame:
    """An even wall as the rig's views see it, black where no ray gets through."""
    (seen_by,) = coverage(rig, rig.camera.video)
    noise = np.random.default_rng(1).normal(0, 2, seen_by.shape)
    return NamedFrame("wall.png", np.rint(np.maximum(np.where(seen_by >= 0, 160, 2) + noise, 0)).astype(np.uint8))


def test_the_common_field_is_what_traced_rays_reach_within_the_range(oak: Rig, near: Calibration) -> None:
    seen = common_field(near, "left")
    random = np.random.default_rng(4)
    columns, rows = random.integers(0, 640, 3000), random.integers(0, 720, 3000)
    window = rectification(near).window
    ahead = rectification(near).left.R_rectified_from_left[2]
    true = traced(oak, columns, rows, np.linspace(1 / window.farthest, 1 / window.nearest, 60), ahead)

    agree = seen[rows, columns] == true
    assert 0.2 < true.mean() < 0.95  # both kinds are there
    assert agree.mean() > 0.995
    for row, column in zip(rows[~agree], columns[~agree], strict=True):  # the rest lies at the border, to two pixels
        assert 0 < seen[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3].mean() < 1


def traced(
    rig: Rig,
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
    per_depth: NDArray[np.float64],
    ahead: NDArray[np.float64],
) -> Mask:
    """Tell which pixels of the left view's picture the right view sees at any of many distances, by exact optics; depth is
    counted along `ahead` (3,) of the left view's frame."""
    left, right, video = fold(rig, "left"), fold(rig, "right"), rig.camera.video
    x, y, _, _ = rig.views[0].rectangle(video.width, video.height)
    slopes = rig.lens().slopes(np.stack([columns + x, rows + y], axis=-1).astype(float))
    origin, direction = left.rays(slopes)
    x, y, w, h = rig.views[1].rectangle(video.width, video.height)
    seen = np.zeros(len(columns), bool)
    for depth_mm in 1 / per_depth:
        reach = (depth_mm - left.view_from_rig(origin) @ ahead) / (direction @ left.R.T @ ahead)
        pixels = rig.lens().project_slopes(right.slopes(origin + reach[:, None] * direction))
        with np.errstate(invalid="ignore"):
            seen |= np.all((pixels >= [x, y]) & (pixels <= [x + w - 1, y + h - 1]), axis=1)
    return seen


def test_a_slanted_seam_takes_its_band_and_what_lies_beyond(oak: Rig, mask: StaticMask) -> None:
    lean = math.tan(math.radians(0.4))
    for codes, view, sign in ((mask.left, oak.views[0], 1), (mask.right, oak.views[1], -1)):
        x = view.rectangle(1280, 720)[0]
        for row in (0, 200, 500, 719):
            border = 639.0 + (row - 359.5) * lean + sign * 25.0
            columns = np.arange(640) + x
            np.testing.assert_array_equal(codes[row] == StaticReason.SEAM, sign * (columns - border) <= 0)


def test_pixels_without_light_are_vignetted(oak: Rig, mask: StaticMask) -> None:
    (seen_by,) = coverage(oak, oak.camera.video)
    for codes, view in ((mask.left, oak.views[0]), (mask.right, oak.views[1])):
        dark = view.cut((seen_by < 0).astype(np.uint8)) > 0
        free = codes != StaticReason.SEAM
        assert dark[free].mean() > 0.1
        assert np.mean((codes == StaticReason.VIGNETTED)[free] != dark[free]) < 0.003
    assert mask.shares("left")["vignetted"] == pytest.approx(np.mean(mask.left == 3), abs=1e-12)
    assert set(mask.shares("left")) == {"outside", "seam", "vignetted"}


def test_what_only_a_dark_rim_would_see_is_outside(oak: Rig) -> None:
    calibration = Calibration.nominal(oak)
    hidden = np.zeros((720, 640), bool)
    free = common_field(calibration, "left")
    hidden[:300] = True
    covered = common_field(calibration, "left", hidden)

    assert free[:280].mean() > 0.9
    assert covered[:280].mean() < 0.02  # rows correspond, nearly
    np.testing.assert_array_equal(covered[330:], free[330:])


def test_a_mask_of_a_full_frame_takes_less_than_eight_kilobytes_and_comes_back(mask: StaticMask) -> None:
    text = msgspec.json.encode(part_of(mask))
    back = of_part(msgspec.json.decode(text, type=StaticMaskPart))

    assert len(text) < 8192
    np.testing.assert_array_equal(back.left, mask.left)
    np.testing.assert_array_equal(back.right, mask.right)
    back.require_sizes((640, 720), (640, 720))
    with pytest.raises(CalibrationError, match=r"mask.right is for a view of 640x720 pixels, .* has 640x719"):
        back.require_sizes((640, 720), (640, 719))


def test_every_rectified_pixel_has_the_reason_of_the_pixel_it_comes_from(oak: Rig, mask: StaticMask) -> None:
    rectify = rectification(Calibration.nominal(oak))
    reasons = rectified_reasons(mask, rectify, "left")
    sources = rectify.sources(rectify.left)

    assert reasons.shape == (rectify.height, rectify.width)
    assert (reasons[np.isnan(sources[..., 0])] == StaticReason.OUTSIDE).all()
    for reason in StaticReason:
        rows, columns = np.nonzero((reasons == reason) & np.isfinite(sources[..., 0]))
        assert len(rows) > 100
        at = np.rint(sources[rows, columns]).astype(int)
        assert (mask.left[at[:, 1], at[:, 0]] == reason).all()


def damaged(codes: bytes, width: int = 640) -> StaticMaskPart:
    content = msgspec.to_builtins(part_of(StaticMask(np.zeros((720, 640), np.uint8), np.zeros((720, 640), np.uint8))))
    content["left"] |= {"codes": base64.b64encode(codes).decode(), "width_px": width}
    return msgspec.json.decode(msgspec.json.encode(content), type=StaticMaskPart)


def test_damaged_codes_are_refused_by_the_view(mask: StaticMask) -> None:
    good = part_of(mask).left.codes
    bomb = zlib.compress(bytes(4_000_000), 9)
    ragged = zlib.compress(np.full(720 * 640, 7, np.uint8).tobytes())
    for codes, width, complaint in (
        (good[:-9], 640, "mask.left.codes does not hold 640x720"),
        (good[:40] + b"\0\1" + good[42:], 640, "mask.left.codes"),
        (good + b"more", 640, "does not hold"),
        (good, 641, "mask.left.codes does not hold 641x720"),
        (bomb, 640, "does not hold"),
        (b"", 640, "does not hold"),
        (ragged, 640, "code from 0 to 3"),
    ):
        with pytest.raises(CalibrationError, match=complaint):
            of_part(damaged(codes, width))
    with pytest.raises(msgspec.ValidationError, match="codes"):
        damaged(bytes(40_000))
    noise = np.random.default_rng(1).integers(0, 4, (400, 400)).astype(np.uint8)
    with pytest.raises(CalibrationError, match="ragged"):
        part_of(StaticMask(noise, noise))


def test_a_seam_that_is_not_between_the_views_and_another_flat_field_are_refused(oak: Rig, small: Rig) -> None:
    calibration = Calibration.nominal(oak)
    with pytest.raises(UsageError, match="seam at column 640 does not lie between"):
        measured_mask(replace(calibration, left_view=LAYOUTS["top-bottom"][0]), Seam(640.0, 0.0, 0.0, 2.0))
    with pytest.raises(CalibrationError, match="160x180 pixels, but the calibration's 640x720"):
        measured_mask(calibration, None, measure([lit_wall(small)], small.views))
