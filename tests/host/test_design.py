"""`prismstereo design`, as a user calls it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from host.command import complaint_of, prismstereo, result_of
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.catalogue import cameras
from prismstereo_hw.design.designer import design
from prismstereo_hw.rig import Rig


def test_a_wish_becomes_a_rig_file_and_a_drawing(tmp_path: Path) -> None:
    rig, svg = tmp_path / "robot.toml", tmp_path / "rays.svg"

    made = result_of(
        "design", "--camera", "oak-1", "--baseline-mm", 60, "--range-mm", "300:4000", "-o", rig, "--svg", svg
    )

    assert made["baseline_mm"] == pytest.approx(60, abs=0.1)
    assert made["columns_kept"] == pytest.approx(0.816, abs=0.002)
    assert made["range_min_mm"] <= 300
    assert made["range_max_mm"] == pytest.approx(4000, rel=0.01)
    assert made["rig"] == "robot"
    assert made["out"] == str(rig)
    assert ET.parse(svg).getroot().tag.endswith("svg")
    again = result_of("design", rig)
    assert {key: again[key] for key in again} == {key: made[key] for key in again}
    assert Rig.read(rig).range.near_mm == 300


def test_the_result_says_what_cannot_be_had_and_what_assembly_costs() -> None:
    found = result_of("design", "oak-1")

    assert {limit["kind"] for limit in found["limits"]} >= {"total_reflection", "seam"}
    assert found["sensitivities"]["mirror_angle_mm_per_deg"] == pytest.approx(2.15, abs=0.01)
    assert found["box"]["labels"] == found["labels"] == 128
    assert found["box"]["range_min_mm"] == pytest.approx(found["range_min_mm"], rel=0.01)
    assert found["box"]["range_max_mm"] is None  # infinity
    errors = found["assembly"]
    assert errors["error_from_drawing_mm"]["1000"] > errors["error_after_creep_mm"]["1000"] > 3
    assert errors["error_calibrated_mm"]["1000"] < 3


def test_a_rig_is_designed_anew_for_another_baseline_with_all_else_kept(tmp_path: Path) -> None:
    text = prismstereo("design", "dslr-35mm", "--baseline-mm", 80, "--toml").stdout
    (tmp_path / "wide.toml").write_text(text)

    made, before = Rig.read(tmp_path / "wide.toml"), Rig.read("dslr-35mm")

    assert result_of("design", tmp_path / "wide.toml")["baseline_mm"] == pytest.approx(80, abs=0.1)
    assert made.camera == before.camera
    assert made.prism.pupil_to_prism_mm == before.prism.pupil_to_prism_mm
    assert made.range.near_mm == before.range.near_mm


def test_the_catalogue_is_listed_with_its_sources() -> None:
    listed = result_of("design", "--cameras")["cameras"]

    assert [entry["name"] for entry in listed] == list(cameras())
    assert all(entry["sources"] for entry in listed)
    assert "pi-camera-v3" in prismstereo("design", "--cameras").stdout


def test_people_read_lines() -> None:
    said = prismstereo("design", "--camera", "aps-c-35mm", "--baseline-mm", 50).stdout

    for words in ("prism               N-BK7", "mirrors ", "after calibration", "after a creep", "limit "):
        assert words in said


class TestWishesThatCannotBeGranted:
    def test_a_baseline_out_of_reach_names_the_nearest(self) -> None:
        said = complaint_of(2, "design", "--camera", "oak-1", "--baseline-mm", 200)
        assert "baseline 200 mm cannot be had" in said
        assert "is nearest" in said

    def test_an_unknown_camera_names_the_known_ones(self) -> None:
        assert "pi-camera-v2" in complaint_of(2, "design", "--camera", "brownie", "--baseline-mm", 50)

    def test_flags_that_contradict_or_miss_each_other_are_explained(self) -> None:
        assert "not both" in complaint_of(2, "design", "oak-1", "--camera", "oak-1", "--baseline-mm", 50)
        assert "--baseline-mm" in complaint_of(2, "design", "--camera", "oak-1")
        assert "--camera" in complaint_of(2, "design")
        assert "A:Z" in complaint_of(2, "design", "oak-1", "--range-mm", "near")


@pytest.mark.parametrize("name", ["oak-1", "pi-camera-v3", "imx273-16mm", "aps-c-50mm"])
def test_a_designed_rig_can_be_rectified_over_its_range(name: str) -> None:
    entry = cameras()[name]
    made = design(entry.camera, 50.0, 450.0, 6000.0, pupil_to_prism_mm=entry.pupil_to_prism_mm)

    window = rectification(Calibration.nominal(made.rig)).window

    assert window.labels == made.rig.range.labels
    assert window.nearest <= 450
    assert window.farthest == pytest.approx(6000, rel=0.01)
