"""The calibration as a file and as flash: exact there and back, and nothing damaged, foreign or hand-made gets in."""

from __future__ import annotations

import json
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


def changed(**values: Any) -> bytes:
    """The file's text with some fields replaced (None in a nested path removes nothing; `...` removes the key)."""
    content = json.loads(encode(calibration()))
    del content["sha256"]
    for path, value in values.items():
        where, *rest = path.split("__")[::-1]
        target = content
        for key in rest[::-1]:
            target = target[int(key) if isinstance(target, list) else key]
        if value is ...:
            del target[where]
        else:
            target[int(where) if isinstance(target, list) else where] = value
    return json.dumps(content).encode()


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
    turn = draw(st.floats(-0.2, 0.2))
    R = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    centre = np.array([draw(st.floats(1, 500)), draw(st.floats(-0.1, 0.1)), draw(st.floats(-0.1, 0.1))])
    turn_deg = draw(st.sampled_from([0, 180]))
    cut = draw(st.sampled_from(CUTS))
    step = cut.get("row_step", 1)  # an interlaced picture is as many times lower
    thinned = replace(lens, cx_px=lens.cx_px + draw(st.floats(-50, 50)), fy_px=lens.fy_px / step)
    far = draw(st.one_of(st.just(math.inf), st.floats(2e3, 1e6)))
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


MALFORMED = {
    "a number is a text": (changed(left_lens__fx_px="934"), r"left_lens\.fx_px"),
    "a number is missing": (changed(right_lens__k2=...), r"k2.*right_lens"),
    "an unknown key": (changed(left_lens__skew_px=0.0), "skew_px"),
    "an unknown key at the top": (changed(author="me"), "author"),
    "another schema": (changed(schema="prismstereo-calibration/2"), "schema is 'prismstereo-calibration/2'"),
    "no schema": (changed(schema=...), "schema"),
    "NaN": (changed(left_lens__cx_px=math.nan), r"left_lens\.cx_px"),
    "Infinity": (changed(near_mm=math.inf), "near_mm"),
    "a number beyond floats": (changed(rms_px=7).replace(b'"rms_px": 7', b'"rms_px": 1e999'), "rms_px"),
    "an absurd number": (changed(right_lens__fy_px=1e308), r"right_lens\.fy_px"),
    "a negative focal length": (changed(left_lens__fx_px=-900.0), r"left_lens\.fx_px"),
    "a matrix of two rows": (changed(R_right_from_left=[[1, 0, 0], [0, 1, 0]]), "R_right_from_left"),
    "not a rotation": (changed(R_right_from_left=[[1, 0, 0], [0, 1, 0], [0, 0, 0.5]]), "R_right_from_left"),
    "a view outside the frame": (changed(left_view__width_fraction=0.9), "leaves the frame"),
    "more rows than eight": (changed(left_view__row_step=99), r"left_view\.row_step"),
    "a row that is not there": (changed(left_view__row_start=3), "rows from 3 in steps of 1"),
    "a polygon outside": (
        changed(left_view__polygon_fraction=[[0, 0], [0, 1], [2, 0]]),
        r"left_view\.polygon_fraction",
    ),
    "a turn by 45 degrees": (changed(left_view__turn_deg=45), r"left_view\.turn_deg"),
    "an empty range": (changed(near_mm=500.0, far_mm=400.0), "range 500:400"),
    "labels not of sixteen": (changed(labels=100), "100 disparity labels"),
    "another model": (changed(model="three-camera"), "model"),
    "another unit": (changed(unit="inch"), "unit"),
    "lengths of the other unit": (changed(unit="square"), "t_right_from_left_mm has no place"),
    "no lengths": (changed(near_mm=...), "near_mm is missing"),
    "lengths of both units": (changed(near_squares=3.0), "near_squares has no place"),
    "the right camera on the left": (changed(t_right_from_left_mm=[50.0, 0.0, 0.0]), "left and right are exchanged"),
    "no size": (changed(frame_width_px=0), "frame_width_px"),
    "half a file": (encode(calibration())[:700], "is not JSON"),
    "no JSON": (b"fx = 900", "is not JSON"),
    "a list": (b"[1, 2]", "Expected `object`"),
    "nothing": (b"", "is not JSON"),
    "a byte order mark": (b"\xef\xbb\xbf" + encode(calibration()), "byte order mark"),
    "not UTF-8": (encode(calibration()).replace(b"oak-1", b"oak\xff1"), "unit.json"),
    "UTF-16": (encode(calibration()).decode().encode("utf-16"), "is not JSON"),
    "brackets without end": (b"[" * 200_000, "unit.json"),
    "brackets in a field": (changed(rig=0).replace(b'"rig": 0', b'"rig": ' + b"[" * 100_000), "unit.json"),
    "an edited file": (encode(calibration()).replace(b'"views_used":0', b'"views_used":9'), "sha256"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused_by_its_name_and_its_field(name: str, tmp_path: Path) -> None:
    text, field = MALFORMED[name]
    (tmp_path / "unit.json").write_bytes(text)
    with pytest.raises(CalibrationError, match=field) as caught:
        store.read(tmp_path / "unit.json")
    assert str(tmp_path / "unit.json") in str(caught.value)


def test_a_file_edited_on_purpose_is_read_once_its_sha256_is_left_out() -> None:
    assert decode(changed(views_used=9), "unit.json").views_used == 9


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
