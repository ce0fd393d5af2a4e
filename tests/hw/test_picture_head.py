"""What a picture file claims about itself, read before any decoder is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_hw.picture_head import PictureHead, picture_head


@given(
    st.binary(max_size=300), st.sampled_from([b"", b"\xff\xd8", b"BM", b"II*\0", b"MM\0*", b"P5", b"\x89PNG\r\n\x1a\n"])
)
def test_any_first_bytes_are_understood_or_not_but_never_stumbled_over(content: bytes, magic: bytes) -> None:
    head = picture_head(magic + content)
    assert head is None or (head.width >= 0 and head.height >= 0)


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".pgm", ".ppm", ".tif"])
def test_the_head_of_a_whole_picture_tells_its_size(ending: str, rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (48, 64, 3) if ending == ".ppm" else (48, 64), np.uint8)
    head = picture_head(cv2.imencode(ending, pixels)[1].tobytes())
    assert head == PictureHead(width=64, height=48, whole=True)


def test_a_jpeg_is_as_large_as_its_frame_says_and_not_its_preview(rng: np.random.Generator) -> None:
    whole, preview = (
        cv2.imencode(".jpg", rng.integers(0, 256, shape, np.uint8))[1].tobytes() for shape in ((48, 64), (12, 16))
    )
    exif = b"Exif\0\0" + preview
    head = picture_head(whole[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + whole[2:])
    assert head == PictureHead(width=64, height=48, whole=True)


def test_other_files_are_no_pictures() -> None:
    assert picture_head(b"GIF89a" + bytes(20)) is None
    assert picture_head(b"P7\nWIDTH 4\n") is None
    assert picture_head(b"") == PictureHead(0, 0, whole=False)
