"""Files: written whole or not at all; pictures read as the sensor made them, or refused with one clear complaint."""

from __future__ import annotations

import io
import os
import stat
import struct
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from prismstereo_hw.errors import DataError, ImageError
from prismstereo_hw.files import read_array, read_depth_png, read_picture, write_picture, write_whole


@pytest.fixture
def grey(rng: np.random.Generator) -> np.ndarray:
    """A noisy grey picture, 48 rows of 64."""
    return rng.integers(0, 256, (48, 64), np.uint8)


def saved(path: Path, pixels: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), pixels)
    return path


# ---- writing


def test_a_file_is_written_with_its_folders(tmp_path: Path) -> None:
    write_whole(tmp_path / "a" / "b" / "c.bin", b"content")
    assert (tmp_path / "a" / "b" / "c.bin").read_bytes() == b"content"
    assert len(list((tmp_path / "a" / "b").iterdir())) == 1


def test_a_new_file_may_be_read_by_whom_the_umask_allows(tmp_path: Path) -> None:
    write_whole(tmp_path / "ours", b"")
    (tmp_path / "theirs").touch()
    assert stat.S_IMODE((tmp_path / "ours").stat().st_mode) == stat.S_IMODE((tmp_path / "theirs").stat().st_mode)


def test_a_write_that_fails_leaves_the_old_content_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "map.pfm"
    write_whole(path, b"old")
    with pytest.raises(TypeError):
        write_whole(path, "not bytes")  # type: ignore[arg-type]
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "taken" / "inside").mkdir(parents=True)
    with pytest.raises(DataError, match=r"cannot write .*taken: .*: nothing was changed"):
        write_whole(tmp_path / "taken", b"content")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    assert (tmp_path / "taken" / "inside").is_dir()


@pytest.mark.parametrize("name", ["a" * 300, "file/below", ""])
def test_where_nothing_can_be_written_says_so(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_bytes(b"old")
    with pytest.raises(DataError, match=r"cannot write .*give a folder that can be written to"):
        write_whole(tmp_path / name, b"content")
    assert (tmp_path / "file").read_bytes() == b"old"


def test_a_reader_never_sees_half_a_file(tmp_path: Path) -> None:
    path = tmp_path / "busy"
    contents = [bytes([letter]) * 200_000 for letter in b"ab"]
    write_whole(path, contents[0])
    stop = threading.Event()
    seen: list[bytes] = []

    def read() -> None:
        while not stop.is_set():
            seen.append(path.read_bytes())

    reader = threading.Thread(target=read)
    reader.start()
    for turn in range(20):
        write_whole(path, contents[turn % 2])
    stop.set()
    reader.join()
    assert seen
    assert set(seen) <= set(contents)


@pytest.mark.parametrize("ending", [".png", ".jpg", ".jpeg", ".PNG"])
def test_pictures_come_back(tmp_path: Path, grey: np.ndarray, ending: str) -> None:
    smooth = cv2.GaussianBlur(grey, (0, 0), 4)
    for pixels in (smooth, np.stack([smooth, 255 - smooth, smooth // 2], axis=-1)):
        write_picture(tmp_path / f"picture{ending}", pixels)
        back = read_picture(tmp_path / f"picture{ending}")
        assert back.shape == pixels.shape
        np.testing.assert_allclose(back.astype(int), pixels, atol=0 if ending.lower() == ".png" else 8)


@pytest.mark.parametrize(
    ("name", "pixels", "words"),
    [
        ("a.tif", np.zeros((2, 2), np.uint8), r"a picture ends in \.png, \.jpg or \.jpeg"),
        ("a.jpg", np.zeros((2, 2), np.uint16), r"uint16 \(2, 2\) does not fit a \.jpg file: give 8-bit grey or BGR"),
        ("a.png", np.zeros((2, 2), np.float32), r"float32 \(2, 2\) does not fit a \.png file"),
        ("a.png", np.zeros((0, 2), np.uint8), r"uint8 \(0, 2\) does not fit"),
        ("a.png", np.zeros((2, 2, 2), np.uint8), r"uint8 \(2, 2, 2\) does not fit"),
        ("a.png", np.zeros(4, np.uint8), r"uint8 \(4,\) does not fit"),
    ],
)
def test_what_does_not_fit_a_picture_file_is_not_written(
    tmp_path: Path, name: str, pixels: np.ndarray, words: str
) -> None:
    with pytest.raises(DataError, match=words):
        write_picture(tmp_path / name, pixels)
    assert not list(tmp_path.iterdir())


# ---- reading


@pytest.mark.parametrize("ending", [".png", ".bmp", ".pgm", ".tif"])
def test_lossless_formats_are_read_exactly(tmp_path: Path, grey: np.ndarray, ending: str) -> None:
    np.testing.assert_array_equal(read_picture(saved(tmp_path / f"grey{ending}", grey)), grey)
    colour = np.stack([grey, grey[::-1], 255 - grey], axis=-1)
    ending = ".ppm" if ending == ".pgm" else ending
    np.testing.assert_array_equal(read_picture(saved(tmp_path / f"colour{ending}", colour)), colour)


def test_colours_are_turned_grey_when_asked(tmp_path: Path, grey: np.ndarray) -> None:
    path = saved(tmp_path / "colour.png", np.stack([grey] * 3, axis=-1))
    np.testing.assert_allclose(read_picture(path, grey=True).astype(int), grey, atol=1)
    assert read_picture(path).shape == (48, 64, 3)


def test_transparency_is_left_out(tmp_path: Path, grey: np.ndarray) -> None:
    path = saved(tmp_path / "rgba.png", np.stack([grey, grey, grey, np.full_like(grey, 128)], axis=-1))
    np.testing.assert_array_equal(read_picture(path), np.stack([grey] * 3, axis=-1))


def test_a_picture_is_read_as_the_sensor_made_it_whatever_the_camera_says_was_up(
    tmp_path: Path, grey: np.ndarray
) -> None:
    # EXIF orientation 6: "turn a quarter to the right for looking at"; the rig's views stand as the sensor has them
    plain = saved(tmp_path / "plain.jpg", grey).read_bytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    (tmp_path / "held.jpg").write_bytes(plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:])
    np.testing.assert_array_equal(read_picture(tmp_path / "held.jpg"), read_picture(tmp_path / "plain.jpg"))


@pytest.mark.parametrize("grey_wanted", [True, False])
@pytest.mark.parametrize("ending", [".png", ".tif", ".pgm"])
def test_16_bits_are_refused_where_8_are_needed(
    tmp_path: Path, grey: np.ndarray, ending: str, grey_wanted: bool
) -> None:
    path = saved(tmp_path / f"deep{ending}", grey.astype(np.uint16) * 256)
    with pytest.raises(ImageError, match="has uint16 pixels: a raw frame has 8 bits a channel"):
        read_picture(path, grey=grey_wanted)


def test_a_depth_png_has_one_channel_of_16_bits(tmp_path: Path, grey: np.ndarray) -> None:
    deep = grey.astype(np.uint16) * 200 + 7
    np.testing.assert_array_equal(read_depth_png(saved(tmp_path / "deep.png", deep)), deep)
    for name, pixels in (("flat", grey), ("colour", np.stack([deep] * 3, axis=-1))):
        with pytest.raises(ImageError, match="a disparity PNG has one 16-bit channel"):
            read_depth_png(saved(tmp_path / f"{name}.png", pixels))


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".pgm"])
def test_a_picture_that_is_cut_off_is_refused_wherever_it_was_cut(
    tmp_path: Path, grey: np.ndarray, ending: str
) -> None:
    whole = saved(tmp_path / f"whole{ending}", grey).read_bytes()
    path = tmp_path / f"cut{ending}"
    for kept in [*range(12), *np.linspace(12, len(whole) - 2, 40).astype(int)]:
        path.write_bytes(whole[:kept])
        with pytest.raises(ImageError, match=r"cut off or empty \(\d+ bytes\): copy it again|not a picture|damaged"):
            read_picture(path)


def test_a_preview_inside_a_cut_off_jpeg_does_not_make_it_whole(tmp_path: Path, grey: np.ndarray) -> None:
    whole = saved(tmp_path / "whole.jpg", grey).read_bytes()
    preview = b"Exif\0\0" + saved(tmp_path / "preview.jpg", grey[::4, ::4]).read_bytes()
    with_preview = whole[:2] + b"\xff\xe1" + struct.pack(">H", len(preview) + 2) + preview + whole[2:]
    (tmp_path / "a.jpg").write_bytes(with_preview)
    (tmp_path / "b.jpg").write_bytes(with_preview[:-200])
    assert read_picture(tmp_path / "a.jpg").shape == (48, 64)
    with pytest.raises(ImageError, match="is cut off"):
        read_picture(tmp_path / "b.jpg")


def test_what_a_camera_appends_behind_a_jpeg_does_no_harm(tmp_path: Path, grey: np.ndarray) -> None:
    whole = saved(tmp_path / "whole.jpg", grey).read_bytes()
    (tmp_path / "trailer.jpg").write_bytes(whole + b"maker's notes" * 1000)
    np.testing.assert_array_equal(read_picture(tmp_path / "trailer.jpg"), read_picture(tmp_path / "whole.jpg"))


def _png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


def _jpeg(width: int, height: int) -> bytes:
    frame = struct.pack(">BHHBBBB", 8, height, width, 1, 1, 0x11, 0)
    return b"\xff\xd8\xff\xc0" + struct.pack(">H", len(frame) + 2) + frame + b"\xff\xda\0\x02" + b"\xff\xd9"


def _bmp(width: int, height: int) -> bytes:
    return b"BM" + struct.pack("<IHHIIiiHHIIiiII", 54, 0, 0, 54, 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)


def _tiff(width: int, height: int) -> bytes:
    entries = [struct.pack("<HHII", tag, 4, 1, value) for tag, value in ((256, width), (257, height))]
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + b"".join(entries) + bytes(4)


@pytest.mark.parametrize(
    "bomb",
    [
        _png(60_000, 60_000), _png(2**31 - 1, 2**31 - 1), _jpeg(65_500, 65_500), _bmp(40_000, 40_000),
        _bmp(40_000, -40_000), _tiff(50_000, 50_000), b"P5\n50000 50000\n255\n" + bytes(100), b"P2\n99999 99999\n1\n0 ",
    ],
    ids=["png", "png overflow", "jpeg", "bmp", "bmp top down", "tiff", "pgm", "pgm text"],
)  # fmt: skip
def test_a_small_file_that_claims_gigabytes_is_refused_before_it_is_decoded(tmp_path: Path, bomb: bytes) -> None:
    (tmp_path / "bomb").write_bytes(bomb)
    with pytest.raises(ImageError, match=r"claims \d+x\d+ pixels: at most 67108864 are read"):
        read_picture(tmp_path / "bomb")


@pytest.mark.parametrize(
    "content", [b"GIF89a" + bytes(50), b"RIFF\0\0\0\0WEBPVP8 " + bytes(50), b"hello", b"PK\x03\x04" + bytes(100)]
)
def test_what_is_no_picture_is_refused_with_what_is(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "other").write_bytes(content)
    with pytest.raises(ImageError, match="is not a picture that can be read: give PNG, JPEG, PGM, BMP or TIFF"):
        read_picture(tmp_path / "other")


def test_a_missing_picture_and_a_folder_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.png", tmp_path):
        with pytest.raises(ImageError, match=f"cannot read {path}: "):
            read_picture(path)


# ---- arrays


def test_arrays_come_back_from_npy_files(tmp_path: Path, rng: np.random.Generator) -> None:
    for values in (rng.random((3, 4, 2), np.float32), rng.integers(0, 9, 5), np.asfortranarray(rng.random((4, 5)))):
        np.save(tmp_path / "array.npy", values)
        back = read_array(tmp_path / "array.npy")
        np.testing.assert_array_equal(back, values)
        assert back.dtype == values.dtype
        assert back.flags.writeable
        assert back.base is None or not isinstance(back.base, np.memmap)


def _npy(header: str, body: bytes = b"") -> bytes:
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header.encode() + body


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\x93NUMPY", _npy("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 4), }", bytes(63)),
        _npy("{'descr': '<f4', 'fortran_order': False, 'shape': (100000000, 1000000), }", bytes(64)),
        _npy("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 4), }", bytes(64)),
        _npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", bytes(64)),
        _npy("{'descr': '<f4', 'fortran_order': False, 'shape': (" + "-" * 4000 + "1,), }", bytes(64)),
        _npy("__import__('os')", bytes(64)), _npy("[" * 5000, bytes(64)),
    ],
    ids=["empty", "magic alone", "cut off", "petabytes", "negative", "objects", "deep", "code", "brackets"],
)  # fmt: skip
def test_what_is_no_plain_array_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.npy").write_bytes(content)
    with pytest.raises(DataError, match=r"bad\.npy is not a readable NPY file: "):
        read_array(tmp_path / "bad.npy")


def test_an_archive_of_arrays_is_not_an_array(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, one=np.zeros(3))
    (tmp_path / "archive.npy").write_bytes(content.getvalue())
    with pytest.raises(DataError, match="is not a readable NPY file"):
        read_array(tmp_path / "archive.npy")


def test_a_missing_array_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=os.fspath(tmp_path / "missing.npy")):
        read_array(tmp_path / "missing.npy")
