"""Disparity files: PFM, 16-bit PNG and NPY, from good hands and from bad ones."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from prismstereo_hw import pfm
from prismstereo_hw.errors import DataError, UsageError

MAPS = hnp.arrays(
    np.float32,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
    elements=st.floats(width=32, allow_nan=True, allow_infinity=True),
)


@given(MAPS)
def test_a_map_comes_back_from_its_pfm_and_infinite_means_unmatched(values: np.ndarray) -> None:
    back = pfm.decode(pfm.encode(values), "here")
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, np.where(np.isfinite(values), values, np.nan))


def test_rows_run_bottom_up_and_unmatched_is_plus_infinity() -> None:
    content = pfm.encode(np.array([[1.0, np.nan], [3.0, 4.0]], np.float32))
    head, body = content[:-16], content[-16:]
    assert head == b"Pf\n2 2\n-1.0\n"
    assert struct.unpack("<4f", body) == (3.0, 4.0, 1.0, np.inf)


def test_opencv_reads_the_same_picture(tmp_path: Path, rng: np.random.Generator) -> None:
    values = rng.random((5, 7), np.float32)
    pfm.write(tmp_path / "map.pfm", values)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "map.pfm"), cv2.IMREAD_UNCHANGED), values)


def test_big_endian_files_are_read_too() -> None:
    content = b"Pf\n2 1\n1.0\n" + struct.pack(">2f", 0.5, np.inf)
    np.testing.assert_array_equal(pfm.decode(content, "here"), [[0.5, np.nan]])


@pytest.mark.parametrize(
    "head", [b"Pf\r\n2 1\r\n-1\r\n", b"Pf\n# made by hand\n#\n2 1\n-1.000000\n", b"Pf \n 2\t1 \n -1e0 \n"]
)
def test_other_writers_spaces_comments_and_line_ends_are_taken(head: bytes) -> None:
    np.testing.assert_array_equal(pfm.decode(head + struct.pack("<2f", 1.5, 2.5), "here"), [[1.5, 2.5]])


def test_the_first_byte_of_the_pixels_may_look_like_a_space() -> None:
    value = struct.unpack("<f", b"\n \n\x40")[0]
    assert pfm.decode(b"Pf\n1 1\n-1\n\n \n\x40", "here")[0, 0] == value


@given(MAPS, st.data())
def test_a_file_that_is_cut_off_anywhere_is_refused_by_name(values: np.ndarray, data: st.DataObject) -> None:
    whole = pfm.encode(values)
    part = whole[: data.draw(st.integers(0, len(whole) - 1))]
    with pytest.raises(DataError, match=r"^here (is cut off: \d+ of \d+ bytes|is not a single-channel PFM)"):
        pfm.decode(part, "here")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not a single-channel PFM file: it must begin with Pf, width, height, scale"),
        (b"PF\n1 1\n-1\n" + bytes(12), "is not a single-channel PFM"),
        (b"P5\n1 1\n255\n\0", "is not a single-channel PFM"),
        (b"Pf\n-1 1\n-1\n", "is not a single-channel PFM"),
        (b"Pf\n1 1\nnan\n" + bytes(4), "is not a single-channel PFM"),
        (b"Pf\n9999999 1\n-1\n", "is not a single-channel PFM"),
        (b"Pf\n1 1\n0\n" + bytes(4), "claims 1x1 pixels at scale 0: that is no picture"),
        (b"Pf\n1 1\n1e999\n" + bytes(4), "at scale 1e999"),
        (b"Pf\n1 1\n-.-\n" + bytes(4), "at scale -.-"),
        (b"Pf\n0 5\n-1\n", "claims 0x5 pixels"),
        (b"Pf\n999999 999999\n-1\n" + bytes(64), "claims 999999x999999 pixels"),
        (b"Pf\n1 1\n" + b"1" * 100 + b"\n", "is not a single-channel PFM"),
        (b"Pf\n" + b"#\n" * 50_000, "is not a single-channel PFM"),
    ],
)
def test_a_hostile_header_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(DataError, match=r"^here ") as caught:
        pfm.decode(content, "here")
    assert words in str(caught.value)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_map_or_one_clear_error(content: bytes) -> None:
    with suppress(DataError):
        assert pfm.decode(b"Pf\n" + content, "here").ndim == 2


def test_a_picture_with_channels_is_no_map() -> None:
    with pytest.raises(UsageError, match=r"holds one \(height, width\) map, not \(2, 2, 3\)"):
        pfm.encode(np.zeros((2, 2, 3), np.float32))


@pytest.mark.parametrize("ending", [".pfm", ".png", ".npy", ".PFM"])
def test_disparities_come_back_from_every_format(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"map{ending}"
    disparity = np.array([[0.0625, 1.5, np.nan], [200.0, 1023.9375, 0.5]], np.float32)
    pfm.write_disparity(path, disparity)
    np.testing.assert_array_equal(pfm.read_disparity(path), disparity)


def test_a_png_holds_sixteenths_of_a_pixel(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    pfm.write_disparity(path, np.array([[1.0, 0.0, np.nan, 0.04, np.inf, -3.0, 5000.0]], np.float32))
    steps = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert steps.dtype == np.uint16
    # a match at nothing is not unmatched: it is rounded up to one sixteenth
    np.testing.assert_array_equal(steps, [[16, 1, 0, 1, 0, 1, 65535]])


def test_an_unknown_ending_is_refused_both_ways(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ends in \.pfm, \.png, \.npy"):
        pfm.write_disparity(tmp_path / "map.tif", np.zeros((2, 2), np.float32))
    with pytest.raises(UsageError, match=r"ends in \.pfm, \.png, \.npy"):
        pfm.read_disparity(tmp_path / "map.exr")


@pytest.mark.parametrize("shape", [(2, 2, 3), (4,), (0, 5)])
def test_what_is_no_map_is_not_written(tmp_path: Path, shape: tuple[int, ...]) -> None:
    for ending in pfm.FORMATS:
        with pytest.raises(UsageError, match=r"a disparity map is \(height, width\), not"):
            pfm.write_disparity(tmp_path / f"map{ending}", np.zeros(shape, np.float32))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", pfm.FORMATS)
def test_a_missing_file_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"missing{ending}"
    with pytest.raises(DataError, match=str(path)):
        pfm.read_disparity(path)


def test_an_8_bit_png_is_no_disparity(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(DataError, match=r"is uint8 \(4, 4\): a disparity PNG has one 16-bit channel"):
        pfm.read_disparity(tmp_path / "grey.png")


def test_arrays_that_are_no_disparity_are_refused(tmp_path: Path) -> None:
    for name, values in {
        "whole": np.zeros((2, 2), np.int32),
        "deep": np.zeros((2, 2, 2)),
        "complex": np.zeros((2, 2), complex),
    }.items():
        np.save(tmp_path / f"{name}.npy", values)
        with pytest.raises(DataError, match=r"a disparity map is \(height, width\) float"):
            pfm.read_disparity(tmp_path / f"{name}.npy")


def test_double_precision_arrays_are_taken(tmp_path: Path) -> None:
    np.save(tmp_path / "double.npy", np.full((2, 3), 1.5))
    assert pfm.read_disparity(tmp_path / "double.npy").dtype == np.float32
