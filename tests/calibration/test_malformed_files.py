"""Calibration files that are damaged, foreign or hand-made: each is refused by its name and by the field that is wrong."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prismstereo_calibration import store
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.outputs import Output
from prismstereo_calibration.photometry import Photometry
from prismstereo_calibration.schema import decode, encode
from prismstereo_calibration.static_mask import StaticMask
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_hw.rig import Rig


@cache
def calibration() -> Calibration:
    return Calibration.nominal(Rig.read("oak-1"))


@cache
def full() -> Calibration:
    """A calibration with every part that a file may have: glass, temperature, outputs, covariance, light and mask."""
    left, right = (view.upright_size(1280, 720) for view in calibration().views)
    return replace(
        calibration(),
        temperature_c=23.5,
        lens_position=131,
        uncertainty=Uncertainty(1e-4 * np.eye(len(NUMBERS))),
        outputs=(Output("still", 4056, 3040, 3.17, 1.08, 380.33, 0.12),),
        photometry=Photometry.even(1.1, 4.0),
        mask=StaticMask(np.zeros(left[::-1], np.uint8), np.zeros(right[::-1], np.uint8)),
    )


def changed(**values: Any) -> bytes:
    """The file's text with some fields replaced (None in a nested path removes nothing; `...` removes the key)."""
    content = json.loads(encode(full()))
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


def doubled(key: str, first: str = "0") -> bytes:
    """The file's text with a key that stands a second time, before the first one."""
    text = encode(full()).decode()
    assert f'"{key}":' in text
    return text.replace(f'"{key}":', f'"{key}":{first},"{key}":', 1).encode()


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
    "rows of the rotation exchanged": (
        changed(R_right_from_left=calibration().right.R_camera_from_left[[1, 0, 2]].tolist()),
        "R_right_from_left is not a rotation",
    ),
    "a rotation turned over": (
        changed(R_right_from_left=calibration().right.R_camera_from_left.T.tolist()),
        "R_right_from_left",
    ),
    "a key twice": (doubled("labels", "128"), "labels is given twice"),
    "a key twice, the same": (doubled("unit", '"mm"'), "unit is given twice"),
    "a key twice, one in other letters": (
        encode(full()).replace(b'"labels":', b'"lab\\u0065ls":128,"labels":'),
        "labels is given twice",
    ),
    "the schema twice": (doubled("schema", '"prismstereo-calibration/1"'), "schema is given twice"),
    "a key of a lens twice": (doubled("fx_px", "934.0"), r"left_lens\.fx_px is given twice"),
    "a key of the glass twice": (doubled("index", "1.5"), r"glass\.index is given twice"),
    "a key of an output twice": (doubled("name", '"video"'), r"outputs\[0\]\.name is given twice"),
    "a key three times": (doubled("labels", '128,"labels":128'), "labels is given 3 times"),
    "glass of no thickness": (changed(glass__thickness_mm=0.0), r"glass\.thickness_mm"),
    "glass thinner than air": (changed(glass__index=0.9), r"glass\.index"),
    "glass that is a number": (changed(glass=22.0), "glass"),
    "glass before squares": (
        changed(
            unit="square",
            t_right_from_left_mm=...,
            near_mm=...,
            far_mm=...,
            t_right_from_left_squares=[-5, 0, 0],
            near_squares=40.0,
            far_squares=None,
        ),
        "glass has a thickness in mm",
    ),
    "a temperature that is a text": (changed(temperature_c="warm"), "temperature_c"),
    "a temperature that is no number": (changed(temperature_c=math.nan), "temperature_c"),
    "a temperature of a star": (changed(temperature_c=5000.0), "temperature_c"),
    "half a lens position": (changed(lens_position=1.5), "lens_position"),
    "a covariance cut short": (changed(covariance=[0.0] * 299), "covariance"),
    "a covariance with infinity": (changed(covariance__7=math.inf), r"covariance\[7\]"),
    "a negative variance": (changed(covariance__0=-1e-4), "covariance"),
    "a correlation beyond one": (changed(covariance__1=1e-3), "covariance"),
    "an output of no scale": (changed(outputs__0__scale=0.0), r"outputs\[0\]\.scale"),
    "an output without a name": (changed(outputs__0__name=...), r"name.*outputs\[0\]"),
    "outputs without end": (changed(outputs=[json.loads(encode(full()))["outputs"][0]] * 17), "outputs"),
    "two outputs of one name": (changed(outputs=json.loads(encode(full()))["outputs"] * 2), "outputs"),
    "a gain that no lens has": (changed(photometry__left__gain__0=99.0), r"photometry\.left\.gain\[0\]"),
    "a gain grid with a hole": (changed(photometry__right__columns=3), r"photometry\.right\.gain has 4 numbers"),
    "a black level that is no number": (
        changed(photometry__left__black_grey=math.nan),
        r"photometry\.left\.black_grey",
    ),
    "a mask of another size": (changed(mask__left__width_px=639), r"mask\.left"),
    "a mask of garbage": (changed(mask__right__codes="AAAA"), r"mask\.right\.codes"),
    "a mask that is a list": (changed(mask__right__codes=[0, 1]), r"mask\.right\.codes"),
    "a mask as large as a city": (changed(mask__left__width_px=16384, mask__left__height_px=16384), r"mask\.left"),
    "brackets in the glass": (
        changed(glass__index=0).replace(b'"index": 0', b'"index": ' + b"[" * 100_000),
        "unit.json",
    ),
    "objects without end": (b'{"schema":' * 20_000, "schema"),
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


def test_a_file_with_every_part_is_read() -> None:
    again = decode(changed(), "unit.json")
    assert (again.temperature_c, again.lens_position, again.outputs) == (23.5, 131, full().outputs)
    assert again.left.plate == full().left.plate is not None
    assert again.uncertainty is not None
    assert again.photometry is not None
    assert again.mask is not None
