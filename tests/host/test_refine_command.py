"""`prismstereo refine`: scenes of a crept twin, the two slots, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from host.command import in_process
from prismstereo.cli.refine import command
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import read, write
from prismstereo_hw.errors import UsageError
from prismstereo_hw.files import write_picture
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin

KNOWN_MM = 700.0


def crept(rig: Rig) -> PrismRig:
    assert isinstance(rig, PrismRig)
    return msgspec.structs.replace(rig, mirrors=msgspec.structs.replace(rig.mirrors, right_tip_deg=0.15))


@pytest.fixture(scope="module")
def scenes(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four planes before a unit whose right mirror has tipped."""
    folder = tmp_path_factory.mktemp("crept")
    unit = crept(small)
    for number, distance_mm in enumerate((KNOWN_MM, 500.0, 900.0, 1500.0)):
        scene = facing_plane(unit, distance_mm, seed=number + 1)
        write_picture(folder / f"scene{number}.png", Twin(unit, scene).frame().pixels)
    return folder


@pytest.fixture
def unit(small: Rig, tmp_path: Path) -> Path:
    """The calibration of the unit before it crept."""
    path = tmp_path / "unit.json"
    write(path, Calibration.nominal(small))
    return path


def run(*arguments: object) -> tuple[int, str]:
    return in_process(command, *arguments)


def test_a_crept_unit_is_refined_and_one_command_goes_back(scenes: Path, unit: Path, pinhole_z_small_mm: float) -> None:
    before = unit.read_bytes()

    code, said = run(
        scenes, "--calibration", unit, "--known-distance-mm", KNOWN_MM - pinhole_z_small_mm, "-o", unit, "--json"
    )

    found: dict[str, Any] = json.loads(said)
    after = unit.read_bytes()
    assert code == 0
    assert found["better"] is True
    assert found["rows_before_px"] > 5 * found["rows_after_px"]
    assert abs(found["known_error_after_percent"]) < 0.1
    assert found["moves"]["right_mirror_tip_deg"]["amount"] == pytest.approx(-0.15, abs=0.02)
    assert Path(found["former"]).read_bytes() == before
    assert run("--restore", "-o", unit)[0] == 0
    assert unit.read_bytes() == before
    assert (unit.parent / "unit.former.json").read_bytes() == after


@pytest.fixture
def pinhole_z_small_mm(small: Rig) -> float:
    """Where depth begins, in the frame in which the scenes stand."""
    return float(fold(small, "left").paraxial_centre_mm[2])


def test_people_are_told_what_became_better(scenes: Path, unit: Path, tmp_path: Path) -> None:
    code, said = run(scenes, "--calibration", unit, "-o", tmp_path / "new.json")

    assert code == 0
    assert "rows, held back" in said
    assert "a known distance (--known-distance-mm) would make depths surer" in said
    assert read(tmp_path / "new.json").baseline != read(unit).baseline


class TestWhatIsRefused:
    def test_blank_walls(self, unit: Path, tmp_path: Path) -> None:
        before, walls = unit.read_bytes(), tmp_path / "walls"
        walls.mkdir()
        for number in range(4):
            noise = np.random.default_rng(number).normal(120, 2, (180, 320))
            cv2.imwrite(str(walls / f"{number}.png"), np.clip(noise, 0, 255).astype(np.uint8))

        with pytest.raises(CalibrationError, match="textured things"):
            run(walls, "--calibration", unit, "-o", unit)

        assert unit.read_bytes() == before
        assert list(tmp_path.glob("*.json")) == [unit]

    def test_scenes_that_make_nothing_better(self, small: Rig, unit: Path, scenes: Path) -> None:
        write(unit, Calibration.nominal(crept(small)))
        before = unit.read_bytes()

        code, said = run(scenes, "--calibration", unit, "-o", unit)

        assert code == 1, said
        assert "nothing was written" in said
        assert unit.read_bytes() == before
        assert not (unit.parent / "unit.former.json").exists()

    @pytest.mark.parametrize(
        ("arguments", "mend"),
        [
            ([], "give FRAMES"),
            (["--calibration", "c.json"], "give FRAMES"),
            (["a.png", "--calibration", "c.json", "--at", "3,4"], "--known-distance-mm too"),
            (["a.png", "--restore"], "-o alone"),
        ],
    )
    def test_flags_that_are_missing_or_contradict(self, arguments: list[str], mend: str) -> None:
        with pytest.raises(UsageError, match=mend):
            run(*arguments, "-o", "o.json")

    def test_a_pixel_that_is_no_pixel(self, scenes: Path, unit: Path) -> None:
        with pytest.raises(UsageError, match="column and the row"):
            run(scenes / "scene0.png", "--calibration", unit, "--known-distance-mm", 700, "--at", "left", "-o", unit)
