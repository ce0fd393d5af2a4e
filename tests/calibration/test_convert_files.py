"""Files of others that are damaged, foreign or made to harm: refused with the file and the field named."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from prismstereo_calibration.convert.document import MAX_BYTES
from prismstereo_calibration.convert.formats import FORMATS
from prismstereo_calibration.convert.pair import calibration_of, pair_of
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig


@cache
def contents(form: str) -> dict[str, str]:
    one = Calibration.nominal(Rig.read("oak-1")).pinholes()
    return {name: content.decode() for name, content in FORMATS[form].write(pair_of(one)).files.items()}


def stored(folder: Path, form: str, name: str, change: Callable[[str], str]) -> Path:
    for file, text in contents(form).items():
        (folder / file).write_text(change(text) if file == name else text)
    return folder


def line(key: str, text: str) -> Callable[[str], str]:
    """Replace the rest of the first line that begins with a key, blanks before it left as they are."""

    def change(whole: str) -> str:
        lines = whole.splitlines()
        index = next(index for index, each in enumerate(lines) if each.strip().startswith(key))
        kept = lines[index][: lines[index].index(key)]
        return "\n".join([*lines[:index], kept + text, *lines[index + 1 :]]) + "\n"

    return change


def after(key: str, text: str) -> Callable[[str], str]:
    """Replace the first `data` line behind a key."""

    def change(whole: str) -> str:
        head, found, tail = whole.partition(f"{key}:")
        assert found
        return head + found + line("data:", f"data: {text}")(tail)

    return change


def entry(*path: str | int, value: Any = ...) -> Callable[[str], str]:
    """Replace, or without a value remove, what stands somewhere in a JSON file."""

    def change(whole: str) -> str:
        content = json.loads(whole)
        place = content
        for key in path[:-1]:
            place = place[key]
        if value is ...:
            del place[path[-1]]
        else:
            place[path[-1]] = value
        return json.dumps(content)

    return change


LEFT = ("cameraData", 0, 1)
K = "[{}, {}, 3, 0, 9, 3, 0, 0, 1]"
P = "[933, 0, 3, {}, 0, 933, {}, 0, 0, 0, 1, 0]"
POSE = (*LEFT, "extrinsics")
STEREO = "stereoRectificationData"
MIRROR = "[-1.0, 0, 0, 0, 1, 0, 0, 0, 1]"
MALFORMED: dict[tuple[str, str], dict[str, tuple[Callable[[str], str], str]]] = {
    ("ros", "left.yaml"): {
        "NaN": (after("camera_matrix", K.format(".nan", 0)), r"camera_matrix\.data\[0\]"),
        "a text": (after("camera_matrix", K.format("a", 0)), r"camera_matrix\.data\[0\] is 'a'"),
        "a number in quotes": (line("image_width", 'image_width: "640"'), "image_width is '640'"),
        "too few numbers": (after("camera_matrix", "[1, 2]"), r"camera_matrix\.data has 2 entries, not 9"),
        "skew": (after("camera_matrix", K.format(9, 1)), "camera_matrix is no camera matrix"),
        "a focal length below 0": (after("camera_matrix", K.format(-9, 0)), "camera_matrix has focal"),
        "fisheye": (line("distortion_model", "distortion_model: equidistant"), "distortion_model is 'equidistant'"),
        "rational": (after("distortion_coefficients", "[0, 0, 0, 0, 0, 1, 0, 0]"), "beyond k3"),
        "half a pixel": (line("image_height", "image_height: 719.5"), "image_height is 719.5"),
        "no pixel": (line("image_height", "image_height: 0"), "image_height is 0"),
        "a python object": (line("camera_name", "camera_name: !!python/object/apply:os.getcwd []"), "python/object"),
        "an alias": (line("camera_name", "a: &x [1]\nb: *x"), "left.yaml has an alias"),
        "a key twice": (line("camera_name", "image_width: 640"), "'image_width' twice"),
        "deep": (lambda text: text + "deep: " + "[" * 100_000, "more than 20 levels"),
        "deep by dashes": (lambda text: text + "deep:\n" + "- " * 50_000, "more than 20 levels"),
        "empty": (lambda text: "", "left.yaml has no fields"),
        "half a file": (lambda text: text[:150], "left.yaml"),
        "no yaml": (lambda text: "a: [1, }", "left.yaml is not YAML"),
    },
    ("ros", "right.yaml"): {
        "no matrix": (line("rectification_matrix", "nothing:"), "has no field 'rectification_matrix'"),
        "a mirror": (after("rectification_matrix", MIRROR), "right.yaml: rectification_matrix is no rotation"),
        "a baseline below 0": (after("projection_matrix", P.format(47, 359.5)), "projection_matrix"),
        "other rows": (after("projection_matrix", P.format(-47, 300)), "share its rows"),
        "long": (lambda text: text + "#" * 10_000_000, f"right.yaml has more than {MAX_BYTES} bytes"),
    },
    ("opencv", "stereo.yml"): {
        "a matrix of another shape": (line("cols: 3", "cols: 4"), "M1 has 3 rows and 4 columns"),
        "NaN": (after("\nT", "[.Nan, 0., 0.]"), r"T\.data\[0\]"),
        "a rotation that is none": (after("\nR", "[1., 0., 0., 0., 1., 0., 0., 0., 0.9]"), "R is no rotation"),
        "views exchanged": (after("\nT", "[49., 0., 0.]"), "T puts the right camera.*exchanged"),
        "no baseline": (after("\nT", "[0., 0., 0.]"), "T is 0 in all parts"),
        "inches": (line("unit", "unit: inch"), "unit is 'inch'"),
        "another tag": (lambda text: text.replace("opencv-matrix", "opencv-sparse", 1), "opencv-sparse"),
    },
    ("kalibr", "camchain.yaml"): {
        "a third camera": (lambda text: text + "cam2: {}\n", "cam2 is a third camera"),
        "omni": (line("camera_model", "camera_model: omni"), r"cam0\.camera_model is 'omni'"),
        "a last row": (line("- [0.0, 0.0, 0.0, 1.0]", "- [0, 0, 0, 2]"), r"T_cn_cnm1\[3\]"),
        "a size of three": (line("resolution", "resolution: [1, 2, 3]"), "resolution has 3 entries"),
        "an infinite focal length": (line("intrinsics", "intrinsics: [1e999, 9, 3, 3]"), r"intrinsics\[0\]"),
    },
    ("luxonis", "eeprom.json"): {
        "fisheye": (entry(*LEFT, "cameraType", value=1), "cameraType is 1"),
        "NaN": (entry(*LEFT, "intrinsicMatrix", 0, 0, value=float("nan")), r"intrinsicMatrix\[0\]\[0\]"),
        "true": (entry(*LEFT, "width", value=True), "width is True"),
        "no pose": (entry(*POSE, "toCameraSocket", value=-1), "extrinsics does not lead"),
        "no axis": (entry(*POSE, "translation", "y"), "translation has no field 'y'"),
        "another unit": (entry(*POSE, "lengthUnit", value=5), "lengthUnit is 5"),
        "no such camera": (entry(STEREO, "leftCameraSocket", value=7), "leftCameraSocket is 7"),
        "deep": (lambda text: "[" * 100_000, "eeprom.json is not JSON"),
        "a list": (lambda text: "[]", "eeprom.json has no fields"),
        "a key twice": (lambda text: text.replace("{", '{"version": 7,', 1), "'version' twice"),
    },
    ("colmap", "cameras.txt"): {
        "another model": (lambda text: text.replace("OPENCV", "SIMPLE_RADIAL"), "line 2.* is 'SIMPLE_RADIAL'"),
        "a number missing": (line("1 OPENCV", "1 OPENCV 640 720 9 9 3 3 0 0 0"), "line 2 has 7 parameters"),
    },
    ("colmap", "images.txt"): {
        "no unit quaternion": (line("1 1.0", "1 2 0 0 0 0 0 0 1 left.png"), "line 2 has a quaternion of length 2"),
        "no such camera": (line("2 0.9", "2 1 0 0 0 -50 0 0 7 right.png"), "no camera of that number"),
        "one image": (line("2 0.9", "# no right"), "1 images whose names begin with left and 0 with right"),
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("form", "file", "name"), [(*which, name) for which, all_ in MALFORMED.items() for name in all_]
)
def test_a_malformed_file_is_refused_by_its_name_and_its_field(form: str, file: str, name: str, tmp_path: Path) -> None:
    change, message = MALFORMED[form, file][name]
    with pytest.raises(CalibrationError, match=message) as caught:
        FORMATS[form].read([stored(tmp_path, form, file, change)])
    assert str(caught.value).startswith(str(tmp_path / file))


def test_a_tag_in_a_file_runs_nothing(tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    wish = f"camera_name: !!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path [{trace}]]"
    with pytest.raises(CalibrationError, match="only plain values"):
        FORMATS["ros"].read([stored(tmp_path, "ros", "left.yaml", line("camera_name", wish))])
    assert not trace.exists()


def test_files_that_are_not_there_and_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"left\.yaml cannot be read: No such file"):
        FORMATS["ros"].read([tmp_path])
    (tmp_path / "eeprom.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CalibrationError, match=r"eeprom\.json is not a text in UTF-8"):
        FORMATS["luxonis"].read([tmp_path])


def test_a_format_of_two_files_wants_both_left_first(tmp_path: Path) -> None:
    folder = stored(tmp_path, "ros", "left.yaml", str)
    with pytest.raises(UsageError, match=r"1 files given, but a ROS stereo pair is left\.yaml and right\.yaml"):
        FORMATS["ros"].read([folder / "left.yaml"])
    with pytest.raises(CalibrationError, match=r"baseline of .*give left first"):
        FORMATS["ros"].read([folder / "right.yaml", folder / "left.yaml"])


def test_a_rotation_of_four_digits_is_taken_as_the_nearest_one(tmp_path: Path) -> None:
    rounded = after("rectification_matrix", "[0.972, 0.0, 0.2351, 0.0, 1.0, 0.0, -0.2351, 0.0, 0.972]")
    pair = FORMATS["ros"].read([stored(tmp_path, "ros", "right.yaml", rounded)])
    R = pair.R_right_from_left
    assert abs(R @ R.T - [[1, 0, 0], [0, 1, 0], [0, 0, 1]]).max() < 1e-12


def test_a_focal_length_that_no_lens_has_is_refused_by_the_camera(tmp_path: Path) -> None:
    wrong = line("intrinsics", "intrinsics: [9.0, 9.0, 3.0, 3.0]")
    pair = FORMATS["kalibr"].read([stored(tmp_path, "kalibr", "camchain.yaml", wrong)])
    one = Calibration.nominal(Rig.read("oak-1"))
    with pytest.raises(CalibrationError, match="left camera has focal lengths 9"):
        calibration_of(replace(pair), one.views, (1280, 720), one.range, "oak-1")
