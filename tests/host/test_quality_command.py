"""`prismstereo quality`: flat targets, a scene with its truth, the report, and two runs side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from host.command import in_process
from prismstereo.cli.quality import command
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import write
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin

PINHOLE_MM = 13.39  # behind the entrance pupil, where the scene is counted from


def simulated(folder: Path, rig: Rig, scene: str, frames: int) -> Path:
    twin = Twin(rig, named(rig, scene))
    writer = SessionWriter(folder, rig, scene)
    for index in range(frames):
        writer.add("video", twin.frame(index))
        writer.add_truth(index, twin.truth(index))
    write(folder / "calibration.json", Calibration.nominal(rig))
    writer.finish()
    return folder


@pytest.fixture(scope="module")
def sessions(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("quality")
    simulated(folder / "near", small, "plane:500", 2)
    simulated(folder / "desk", small, "desk", 1)
    return folder


def told(*arguments: object) -> dict[str, Any]:
    code, text = in_process(command, *arguments, "--json")
    assert code == 0
    found = json.loads(text)
    assert isinstance(found, dict)
    return found


def test_a_flat_target_and_a_scene_are_judged_and_compared(sessions: Path, tmp_path: Path) -> None:
    report, kept = tmp_path / "quality.html", tmp_path / "quality.json"
    found = told(sessions / "near", sessions / "desk", "--report", report)
    (target,), (scene,) = found["flat"], found["scenes"]
    assert (target["source"], target["figures"]["frames"], scene["source"]) == ("near", 2, "desk")
    assert abs(target["figures"]["z_accuracy_percent"]) <= 0.5  # of the twin's true plane
    assert target["figures"]["subpixel_rms_px"] <= 0.12
    assert target["figures"]["plane_rms_mm"] == pytest.approx(target["expected_rms_mm"], rel=0.05)
    assert target["figures"]["temporal_rms_mm"] > 0
    for one in scene["by_distance"]:
        if one["errors"] is not None and one["pixels"] > 500:
            assert one["errors"]["depth_rms_mm"] == pytest.approx(one["errors"]["predicted_rms_mm"], rel=0.25)
    assert scene["levels"]["in_use"] >= 3
    assert set(found["definitions"]) >= {"fill_percent", "z_accuracy_percent", "subpixel_rms_px"}
    page = report.read_text()
    assert "<svg" in page
    assert "Definitions" in page
    kept.write_text(json.dumps(found))
    _, text = in_process(command, sessions / "near", "--compare", kept)
    assert text.count("same") == 6
    assert "fill rate" in text


def test_a_distance_that_was_measured_by_hand_is_held_against(sessions: Path) -> None:
    true = 500.0 + PINHOLE_MM
    found = told(sessions / "near", "--distance-mm", f"{0.99 * true:.4f}", "--frames", "1")["flat"][0]["figures"]
    assert found["z_accuracy_percent"] == pytest.approx(100 / 99, abs=0.5)
    assert found["temporal_noise_mm"] is None


def test_what_cannot_be_judged_is_one_clear_sentence(sessions: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="2 distances for 1 sources"):
        in_process(command, sessions / "near", "--distance-mm", "1", "--distance-mm", "2")
    with pytest.raises(UsageError, match="X,Y,WIDTH,HEIGHT"):
        in_process(command, sessions / "near", "--roi", "1,2")
    with pytest.raises(UsageError, match="reaches out of the map"):
        in_process(command, sessions / "near", "--roi", "1,2,9000,10", "--frames", "1")
    with pytest.raises(UsageError, match="say which board"):
        in_process(command, sessions / "near", "--square-mm", "5")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(DataError, match="no quality report"):
        in_process(command, sessions / "near", "--compare", tmp_path / "other.json")
    picture = sessions / "near" / "video" / "000000.png"
    with pytest.raises(UsageError, match="holds no truth"):
        in_process(command, picture, "--calibration", sessions / "near" / "calibration.json", "--as", "scene")
