"""`prismstereo align` against twins that are built wrong in one known way."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from host.command import complaint_of, prismstereo, result_of
from prismstereo.alignment import Alignment, alignment
from prismstereo.alignment_picture import alignment_picture
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.files import read_picture, write_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.pupil import Pupil
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin

DISTANCE_MM = 800.0


@cache
def wish(name: str = "oak-1") -> PrismRig:
    """A built-in rig, read out with a quarter of the pixels: quick, and with the same optics."""
    rig = Rig.read(name)
    assert isinstance(rig, PrismRig)
    camera = msgspec.structs.replace(rig.camera, video=Mode(width=640, height=360, rate_hz=30.0))
    return msgspec.structs.replace(rig, camera=camera)


def with_mirrors(rig: PrismRig, **changes: float) -> PrismRig:
    return msgspec.structs.replace(rig, mirrors=msgspec.structs.replace(rig.mirrors, **changes))


def off_axis(rig: PrismRig, columns: float) -> PrismRig:
    return msgspec.structs.replace(rig, camera=msgspec.structs.replace(rig.camera, principal_offset_px=(columns, 0.0)))


@cache
def frame_of(built: PrismRig, scene: str = f"plane:{DISTANCE_MM:g}", samples: int = 1) -> RawFrame:
    return Twin(built, named(built, scene), pupil=Pupil(samples=samples)).frame()


def to_adjust(found: Alignment) -> set[str]:
    return {figure.name for figure in found.figures if figure.verdict == "adjust"}


@pytest.mark.parametrize("name", ["dslr-35mm", "oak-1", "pi-camera-v2"])
def test_a_rig_as_drawn_is_in_order(name: str) -> None:
    rig = wish(name)

    found = alignment(frame_of(rig), rig, DISTANCE_MM)

    assert found.ok
    assert all(figure.verdict == "ok" and not figure.mend for figure in found.figures)
    assert found.figure("seam_px").value == pytest.approx(rig.lens().cx_px, abs=1)
    assert found.figure("vertical_offset_px").value == pytest.approx(0, abs=0.05)
    assert found.figure("vergence_error_deg").value == pytest.approx(0, abs=0.01)


def test_a_rig_as_drawn_is_in_order_with_its_blended_seam() -> None:
    found = alignment(frame_of(wish(), samples=12), wish(), DISTANCE_MM)

    assert found.ok
    assert found.figure("seam_px").value == pytest.approx(wish().lens().cx_px, abs=3)
    assert found.figure("seam_width_px").value == pytest.approx(found.figure("seam_width_px").wish, rel=0.35)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("tip_deg", [0.1, -0.3])
def test_a_tipped_mirror_is_found_and_told_from_the_other(side: str, tip_deg: float) -> None:
    other = "right" if side == "left" else "left"
    built = with_mirrors(wish(), **{f"{side}_tip_deg": tip_deg})

    found = alignment(frame_of(built), wish())

    assert found.figure(f"{side}_tip_deg").value == pytest.approx(tip_deg, rel=0.15)
    assert found.figure(f"{other}_tip_deg").value == pytest.approx(0, abs=0.05 * abs(tip_deg))
    assert to_adjust(found) == {"vertical_offset_px", "roll_deg", f"{side}_tip_deg"}
    mend = found.figure(f"{side}_tip_deg").mend
    assert f"the {side} mirror's face leans {'down' if tip_deg > 0 else 'up'}" in mend
    assert f"mm {'back' if tip_deg > 0 else 'forward'}" in mend


def test_a_tip_is_found_among_things_of_several_depths_too() -> None:
    found = alignment(frame_of(with_mirrors(wish(), left_tip_deg=0.3), "desk"), wish())

    assert found.figure("left_tip_deg").value == pytest.approx(0.3, rel=0.15)


def test_turning_back_by_what_was_found_puts_the_rig_in_order() -> None:
    built = with_mirrors(wish(), left_tip_deg=0.4, right_tip_deg=-0.2, angle_deg=wish().mirrors.angle_deg + 0.1)
    before = alignment(frame_of(built), wish(), DISTANCE_MM)

    mended = with_mirrors(
        built,
        left_tip_deg=0.4 - before.figure("left_tip_deg").value,
        right_tip_deg=-0.2 - before.figure("right_tip_deg").value,
        angle_deg=built.mirrors.angle_deg - before.figure("vergence_error_deg").value / 4,
    )

    assert not before.ok
    assert alignment(frame_of(mended), wish(), DISTANCE_MM).ok


@pytest.mark.parametrize(("name", "samples"), [("oak-1", 1), ("oak-1", 12), ("dslr-35mm", 12)])
def test_a_lens_off_the_axis_moves_the_seam_and_the_mend_says_which_way(name: str, samples: int) -> None:
    rig = wish(name)
    assert rig.split_edge_mm is not None
    columns = 0.2 / rig.split_edge_mm * rig.lens().fx_px  # the apex seen 0.2 mm aside
    built = off_axis(rig, columns)

    seam = alignment(frame_of(built, samples=samples), rig, DISTANCE_MM).figure("seam_px")

    assert seam.value == pytest.approx(rig.lens().cx_px + columns, abs=3)
    assert seam.verdict == "adjust"
    assert "mm to the left" in seam.mend


class TestVergence:
    def test_is_found_by_a_flat_target_at_a_known_distance(self) -> None:
        built = with_mirrors(wish(), angle_deg=wish().mirrors.angle_deg + 0.1)

        figure = alignment(frame_of(built), wish(), DISTANCE_MM).figure("vergence_error_deg")

        assert figure.value == pytest.approx(0.4, rel=0.1)  # each view turns by twice its mirror's turn
        assert figure.verdict == "adjust"
        assert "smaller" in figure.mend

    def test_is_unknown_without_one(self) -> None:
        figure = alignment(frame_of(wish(), "desk"), wish()).figure("vergence_error_deg")

        assert figure.verdict == "unknown"
        assert "--distance-mm" in figure.mend

    def test_is_not_made_up_from_a_target_that_is_not_flat(self) -> None:
        figure = alignment(frame_of(wish(), "desk"), wish(), DISTANCE_MM).figure("vergence_error_deg")

        assert figure.verdict == "unknown"


class TestBalance:
    @pytest.mark.parametrize("side", ["left", "right"])
    def test_a_blurred_half_is_named(self, side: str) -> None:
        found = alignment(spoilt(side, blur_px=1.0), wish())

        assert to_adjust(found) == {"focus_ratio"}
        assert (
            f"the {side} view ({'right' if side == 'left' else 'left'} half of the frame)"
            in found.figure("focus_ratio").mend
        )

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_a_darkened_half_is_named_and_measured(self, side: str) -> None:
        found = alignment(spoilt(side, light=0.7), wish())

        assert to_adjust(found) == {"brightness_ratio"}
        assert found.figure("brightness_ratio").value == pytest.approx(0.7 if side == "left" else 1 / 0.7, rel=0.03)
        assert f"the {side} view" in found.figure("brightness_ratio").mend


def spoilt(side: str, blur_px: float = 0.0, light: float = 1.0) -> RawFrame:
    pixels = frame_of(wish()).pixels.copy()
    half = pixels[:, 320:] if side == "left" else pixels[:, :320]  # the views are crossed
    half[:] = cv2.GaussianBlur(half, (0, 0), blur_px) if blur_px else half
    half[:] = np.rint(half * light)
    return RawFrame(pixels)


class TestFramesThatCannotTell:
    def test_no_frame(self) -> None:
        with pytest.raises(ImageError, match="0 frames"):
            alignment([], wish())

    def test_a_frame_of_another_size(self) -> None:
        with pytest.raises(CalibrationError, match=r"320x180, but .* for 640x360"):
            alignment(RawFrame(np.zeros((180, 320), np.uint8)), wish())

    def test_a_blank_wall(self) -> None:
        wall = 120 + np.random.default_rng(1).standard_normal((360, 640))
        with pytest.raises(ImageError, match="texture"):
            alignment(RawFrame(np.rint(wall).astype(np.uint8)), wish())

    def test_two_views_of_different_things(self) -> None:
        noise = np.random.default_rng(1).integers(0, 255, (360, 640))
        with pytest.raises(ImageError, match="found in both views"):
            alignment(RawFrame(cv2.GaussianBlur(noise.astype(np.uint8), (0, 0), 2)), wish())

    def test_a_distance_that_is_none(self) -> None:
        with pytest.raises(UsageError, match="distance_mm is -5"):
            alignment(frame_of(wish()), wish(), -5)


def test_several_frames_are_looked_at_together() -> None:
    built = with_mirrors(wish(), left_tip_deg=0.3)
    near, several = frame_of(built), frame_of(built, "desk")

    found = alignment([near, several], wish())

    assert found.frames == 2
    assert found.rows.count > 1.5 * alignment(near, wish()).rows.count
    assert found.figure("left_tip_deg").value == pytest.approx(0.3, rel=0.15)


def test_the_picture_shows_the_frame_above_the_figures() -> None:
    frame = frame_of(with_mirrors(wish(), left_tip_deg=0.1))

    picture = alignment_picture(frame, alignment(frame, wish()))

    assert picture.shape[1:] == (640, 3)
    assert picture.shape[0] > 360
    blue = (picture[:360, 318:322] == (255, 160, 0)).all(axis=2)
    assert blue.any(axis=1).mean() > 0.8  # the seam's line


class TestCommand:
    def test_a_tipped_unit_exits_1_and_says_what_to_turn(self, tmp_path: Path) -> None:
        (tmp_path / "wish.toml").write_text(wish().toml())
        write_picture(tmp_path / "frame.png", frame_of(with_mirrors(wish(), right_tip_deg=0.3)).pixels)

        done = prismstereo(
            "align", tmp_path / "frame.png", "--rig", tmp_path / "wish.toml", "--picture", tmp_path / "seen.png"
        )

        assert done.returncode == 1
        assert "ADJUST  right tip" in done.stdout
        assert "the right mirror's face leans down: turn its upper screw" in done.stdout
        assert read_picture(tmp_path / "seen.png").shape[1] == 640

    def test_a_running_twin_is_in_order(self, tmp_path: Path) -> None:
        (tmp_path / "wish.toml").write_text(wish().toml())

        found = result_of("align", "twin:plane:800", "--rig", tmp_path / "wish.toml", "--distance-mm", 800)

        assert found["ok"] is True
        assert {figure["verdict"] for figure in found["figures"].values()} == {"ok"}
        assert found["figures"]["seam_px"]["wish"] == 319.5

    def test_wishes_that_cannot_be_granted_are_explained(self, tmp_path: Path) -> None:
        write_picture(tmp_path / "frame.png", frame_of(wish()).pixels)
        assert "--rig oak-1" in complaint_of(2, "align", tmp_path / "frame.png")
        assert "640x360" in complaint_of(4, "align", tmp_path / "frame.png", "--rig", "oak-1")
