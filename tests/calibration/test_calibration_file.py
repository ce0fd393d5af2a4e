"""The calibration as a file and as flash: exact there and back, and nothing damaged, foreign or hand-made gets in."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_calibration import flash, store
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.schema import MAX_BYTES, decode, encode, from_file, to_file
from prismstereo_hw.errors import DataError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import View


@cache
def calibration() -> Calibration:
    return Calibration.nominal(Rig.read("oak-1"))


def parts(one: Calibration) -> tuple[object, ...]:
    """Everything in a calibration as plain comparable values."""
    rest = (one.rig, one.frame_width, one.frame_height, one.views, one.range, one.model, one.unit, one.lens_position)
    right = one.right.R_camera_from_left.tolist(), one.right.t_camera_from_left.tolist()
    return (*rest, one.rms_px, one.views_used, one.left.lens, one.right.lens, right)


CUTS: tuple[dict[str, Any], ...] = (
    {},
    {"row_start": 1, "row_step": 2},
    {"exposure": 1, "exposures": 2},
    {"polygon": ((0.0, 0.0), (0.5, 0.25), (0.125, 1.0))},
)


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Calibrations with every number drawn: two lenses, a small turn, both units, mirrored and turned views."""
    focal, off = draw(st.floats(500, 5000)), draw(st.floats(-100, 100))
    lens = Lens(
        focal,
        focal * draw(st.floats(0.9, 1.1)),
        640 + off,
        360 - off,
        tuple(draw(st.floats(-1e-3, 1e-3)) for _ in range(5)),
    )
    turn = draw(st.floats(-0.02, 0.02)) - 2 * math.atan(320 / focal)  # so that the halves look the same way
    R = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    centre = np.array([draw(st.floats(1, 500)), draw(st.floats(-0.1, 0.1)), draw(st.floats(-0.1, 0.1))])
    turn_deg = draw(st.sampled_from([0, 180]))
    cut = draw(st.sampled_from(CUTS))
    step = cut.get("row_step", 1)  # an interlaced picture is as many times lower
    thinned = replace(lens, cx_px=lens.cx_px + draw(st.floats(-50, 50)), fy_px=lens.fy_px / step)
    far = draw(st.one_of(st.just(math.inf), st.floats(2e5, 1e6)))
    return Calibration(
        rig=draw(st.text(max_size=40).filter(lambda text: text.isprintable())),
        frame_width=1280,
        frame_height=720,
        left_view=View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=draw(st.booleans()), turn_deg=0),
        right_view=View(left=0.0, top=0.0, width=draw(st.floats(0.3, 0.5)), height=1.0, turn_deg=turn_deg, **cut),
        left=Camera.at_origin(lens),
        right=Camera(thinned, R, -R @ centre),
        range=RangeWish(near_mm=draw(st.floats(1, 1000)), far_mm=far, labels=16 * draw(st.integers(1, 64))),
        model=draw(st.sampled_from(["one-lens", "two-camera"])),
        unit=draw(st.sampled_from(["mm", "square"])),
        lens_position=draw(st.one_of(st.none(), st.integers(0, 255))),
        rms_px=draw(st.one_of(st.none(), st.floats(0, 5))),
        views_used=draw(st.integers(0, 500)),
    )  # fmt: skip


@given(calibrations())
def test_flash_gives_back_exactly_what_was_packed(one: Calibration) -> None:
    assert parts(flash.unpack(flash.pack(one))) == parts(one)


@given(calibrations())
def test_the_file_form_gives_back_the_calibration(one: Calibration) -> None:
    assert parts(from_file(to_file(one))) == parts(one)


def test_a_stored_file_is_read_back_exactly_and_reads_like_a_page(tmp_path: Path) -> None:
    store.write(tmp_path / "unit.json", calibration())
    assert parts(store.read(tmp_path / "unit.json")) == parts(calibration())
    text = (tmp_path / "unit.json").read_text("utf-8")
    assert '"far_mm": null' in text
    assert text.count("\n") > 50


def test_the_same_calibration_packs_to_the_same_bytes_and_digest() -> None:
    packed = flash.pack(calibration())
    assert packed == flash.pack(Calibration.nominal(Rig.read("oak-1")))
    assert len(flash.digest(packed)) == 8
    assert flash.digest(packed) != flash.digest(flash.pack(replace(calibration(), views_used=1)))


@given(st.integers(0, 8 * len(flash.pack(calibration())) - 1))
def test_any_flipped_bit_is_refused(bit: int) -> None:
    damaged = bytearray(flash.pack(calibration()))
    damaged[bit // 8] ^= 1 << (bit % 8)
    with pytest.raises(CalibrationError, match="flash"):
        flash.unpack(bytes(damaged))


@given(st.integers(0, len(flash.pack(calibration())) - 1))
def test_flash_that_was_cut_anywhere_is_refused(length: int) -> None:
    with pytest.raises(CalibrationError, match="flash"):
        flash.unpack(flash.pack(calibration())[:length])


def test_flash_with_more_behind_it_or_far_too_large_is_refused() -> None:
    with pytest.raises(CalibrationError, match="it was cut"):
        flash.unpack(flash.pack(calibration()) + b"\x00")
    with pytest.raises(CalibrationError, match="at most 262144"):
        flash.unpack(b"\x00" * (MAX_BYTES + 1))


@given(st.binary(max_size=400))
def test_no_other_bytes_are_a_calibration(data: bytes) -> None:
    with pytest.raises(CalibrationError):
        flash.unpack(data)
    with pytest.raises(CalibrationError, match=r"^there"):
        decode(data, "there")


def test_a_file_that_is_far_too_large_is_refused_unread(tmp_path: Path) -> None:
    (tmp_path / "unit.json").write_bytes(b" " * (MAX_BYTES + 1) + encode(calibration()))
    with pytest.raises(CalibrationError, match=f"more than {MAX_BYTES} bytes"):
        store.read(tmp_path / "unit.json")


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="there is no file"):
        store.read(tmp_path / "unit.json")
    with pytest.raises(CalibrationError, match="cannot be read"):
        store.read(tmp_path)


def test_a_write_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "plain").write_text("a file, not a folder")
    for target in (tmp_path / "taken", tmp_path / "plain" / "unit.json"):
        with pytest.raises(DataError, match="cannot write"):
            store.write(target, calibration())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plain", "taken"]
    assert list((tmp_path / "taken").iterdir()) == []


def test_a_write_that_cannot_be_made_leaves_the_old_file_as_it_was(tmp_path: Path) -> None:
    target = tmp_path / "unit.json"
    store.write(target, calibration())
    before = target.read_bytes()
    for wrong in (replace(calibration(), rig="r" * 2000), replace(calibration(), rms_px=math.nan)):
        with pytest.raises(CalibrationError, match="cannot be kept in a file"):
            store.write(target, wrong)
    assert target.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["unit.json"]
