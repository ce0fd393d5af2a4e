"""The rectification file: comes back as it was, and nothing that is wrong in it is taken on trust."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.scene_points import prism_halves
from prismstereo_calibration import store as calibration_store
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.uncalibrated.scene_fit import fit_scene
from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification
from prismstereo_calibration.uncalibrated.store import decode, encode, is_scene_rectification, read, write
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def made() -> SceneRectification:
    return fit_scene(prism_halves(0), rig="dslr-35mm", one_lens=True)


def test_a_rectification_comes_back_from_its_file_to_the_last_bit(made: SceneRectification, tmp_path: Path) -> None:
    path = tmp_path / "rectification.json"
    write(path, made)
    again = read(path)
    assert encode(again) == encode(made)
    np.testing.assert_array_equal(again.left.H_rectified_from_upright, made.left.H_rectified_from_upright)
    np.testing.assert_array_equal(again.sources(again.right), made.sources(made.right))
    assert again.figures == made.figures
    assert (again.window, again.rig, again.views) == (made.window, "dslr-35mm", made.views)


def test_the_same_matches_give_the_same_file(made: SceneRectification) -> None:
    assert encode(fit_scene(prism_halves(0), rig="dslr-35mm", one_lens=True)) == encode(made)


def test_it_has_no_depth_and_says_so(made: SceneRectification) -> None:
    with pytest.raises(UsageError, match="no focal length and baseline, so it has no depth"):
        made.window.depth(np.ones((2, 2), np.float32))


def edited(change: Callable[[dict[str, Any]], object]) -> Callable[[dict[str, Any]], bytes]:
    """Return a way to spoil the file: a change of its content, the sum left out."""

    def spoil(content: dict[str, Any]) -> bytes:
        content.pop("sha256")
        change(content)
        return json.dumps(content).encode()

    return spoil


WRONG = {
    "a number that is none": (
        edited(lambda c: c.update(scale=float("nan"))),
        "scale has NaN, which is no number of JSON",
    ),
    "no end": (
        edited(lambda c: c["left"]["H_rectified_from_upright"][0].__setitem__(2, float("inf"))),
        "H_rectified_from_upright has Infinity",
    ),
    "a missing key": (edited(lambda c: c.pop("labels")), "labels"),
    "an unknown key": (edited(lambda c: c.update(baseline_mm=48.0)), "baseline_mm"),
    "a word for a number": (edited(lambda c: c.update(width_px="640")), r"width_px"),
    "two rows for three": (edited(lambda c: c["right"]["H_rectified_from_upright"].pop()), "H_rectified_from_upright"),
    "no such form": (edited(lambda c: c.update(form="magic")), "form"),
    "a form without figures": (edited(lambda c: c["figures"].clear()), "figures"),
    "a search that no matcher counts in": (edited(lambda c: c.update(labels=100)), "labels"),
    "a picture larger than it was": (edited(lambda c: c.update(scale=1.5)), "scale"),
    "a view outside of the frame": (edited(lambda c: c["left"]["view"].update(left_fraction=0.7)), "leaves the frame"),
    "a view inside out": (
        edited(lambda c: c["left"].update(H_rectified_from_upright=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]])),
        "H_rectified_from_upright of left or right turns its view inside out",
    ),
    "a view on a line": (
        edited(lambda c: c["left"].update(H_rectified_from_upright=[[1, 1, 0], [1, 1, 0], [0, 0, 1]])),
        "H_rectified_from_upright of left or right turns its view inside out",
    ),
    "a changed digit": (lambda c: json.dumps({**c, "labels": c["labels"] + 16}).encode(), "sha256 does not belong"),
    "a key twice": (
        lambda c: json.dumps(c).replace('"labels"', '"labels": 16, "labels"', 1).encode(),
        "labels is given twice",
    ),
    "a byte order mark": (lambda c: b"\xef\xbb\xbf" + json.dumps(c).encode(), "byte order mark"),
    "half of it": (lambda c: json.dumps(c).encode()[:200], "is not JSON"),
    "depth without end": (lambda c: b'{"schema":' + b"[" * 100_000, "is not JSON"),
    "another kind": (edited(lambda c: c.update(schema="recipe/1")), "schema is 'recipe/1'"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_in_a_file_is_named(what: str, made: SceneRectification) -> None:
    spoil, complaint = WRONG[what]
    with pytest.raises(CalibrationError, match=complaint) as refused:
        decode(spoil(json.loads(encode(made))), "unit.json")
    assert "unit.json" in str(refused.value)


def test_a_file_edited_by_hand_may_leave_its_sum_out(made: SceneRectification) -> None:
    text = edited(lambda content: content.update(rig="my own"))(json.loads(encode(made)))
    assert decode(text, "unit.json").rig == "my own"


def test_a_rectification_and_a_calibration_are_not_taken_for_each_other(
    made: SceneRectification, tmp_path: Path
) -> None:
    scene, unit, missing = tmp_path / "rectification.json", tmp_path / "calibration.json", tmp_path / "none.json"
    write(scene, made)
    calibration_store.write(unit, Calibration.nominal(Rig.read("dslr-35mm")))
    assert [is_scene_rectification(path) for path in (scene, unit, missing)] == [True, False, False]
    with pytest.raises(CalibrationError, match="a calibration with a scale, and no rectification from a scene"):
        read(unit)
    with pytest.raises(CalibrationError, match="it is a rectification from a scene, which has no scale"):
        calibration_store.read(scene)
    with pytest.raises(CalibrationError, match="calibrate --from-scene"):
        read(missing)
