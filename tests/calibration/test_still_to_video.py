"""Scale and shift between video and still: as the sensor's modes have them, from boards seen in both, and honest when not."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import flawed, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import Detection, NamedFrame, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving.still_to_video import still_to_video
from prismstereo_hw.modes import still_from_video, still_pixels
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Scene, board, board_poses, facing_plane
from prismstereo_hw.twin import Twin

Array = NDArray[np.float64]


def both_modes(rig: Rig, seed: int, noise_px: float = 0.2, poses: int = 8) -> tuple[Detection, Detection]:
    """The same traced boards in video and still, noise per axis in the pixels of each; stills are JPEG files elsewhere."""
    exact, camera = traced_detection(rig, seed, poses=poses, noise_px=0.0), rig.camera
    random = np.random.default_rng(seed)
    video, still = [], []
    for one in exact.sightings:
        traced = rig.lens(camera.still).project_slopes(rig.lens().slopes(one.pixels))
        video.append(Sighting(one.name, one.pixels + random.normal(0, noise_px, one.pixels.shape)))
        named = f"boards_still/{one.name.replace('png', 'jpg')}"
        still.append(Sighting(named, traced + random.normal(0, noise_px, traced.shape)))
    size = camera.still
    return replace(exact, sightings=tuple(video)), Detection(size.width, size.height, rig.views, tuple(still))


def moved(detection: Detection, index: int, change: Array) -> Detection:
    """The same detection with one sighting changed by pixels (..., 2)."""
    sightings = list(detection.sightings)
    sightings[index] = replace(sightings[index], pixels=sightings[index].pixels + change)
    return replace(detection, sightings=tuple(sightings))


def roughly(one: Sighting) -> Sighting:
    """Corners that were found to two or three pixels."""
    random = np.random.default_rng(1)
    return replace(one, pixels=one.pixels + random.normal(0, 2.5, one.pixels.shape).round(3))


def corners_of(width: int, height: int) -> Array:
    return np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)


def test_the_corners_of_the_frame_are_placed_to_a_twentieth_of_a_still_pixel(rig: Rig) -> None:
    real = flawed(rig, (5.0, -3.0), (-0.06, 0.03))
    match = still_to_video(*both_modes(real, 1, noise_px=0.1, poses=15))

    frame = corners_of(real.camera.video.width, real.camera.video.height)
    off = np.linalg.norm(match.output.from_calibrated(frame) - still_pixels(real, frame), axis=1)
    scale = still_from_video(real)[0]
    assert off.max() < 0.05
    assert match.output.scale == pytest.approx(scale, rel=5e-5)
    assert match.output.rms_px == pytest.approx(0.1 * np.sqrt(2) * np.hypot(1, scale), rel=0.1)
    assert match.homography_px < 0.15
    assert (match.frames_used, match.rejected) == (15, ())
    np.testing.assert_allclose(match.output.to_calibrated(match.output.from_calibrated(frame)), frame, atol=1e-9)


@pytest.mark.soak
def test_a_still_is_tied_to_its_video_over_many_seeds(rig: Rig) -> None:
    real = flawed(rig, (5.0, -3.0), (-0.06, 0.03))
    frame = corners_of(real.camera.video.width, real.camera.video.height)
    off, free = [], []
    for seed in range(20):
        match = still_to_video(*both_modes(real, seed, poses=15))
        off.append(np.linalg.norm(match.output.from_calibrated(frame) - still_pixels(real, frame), axis=1).max())
        free.append(match.homography_px)
    print(f"| still to video | {rig.name} | {np.median(off):.3f} | {np.max(off):.3f} | {np.max(free):.3f} |")
    assert (
        np.median(off) < 0.065
    )  # still pixels, the worst corner of the frame, 0.2 px of noise per axis in either mode
    assert np.max(off) < 0.15
    assert np.max(free) < 0.4


def test_frames_that_moved_between_the_two_pictures_are_named_and_left_out(dslr: Rig) -> None:
    video, still = both_modes(dslr, 5)
    nudged = moved(moved(still, 2, np.array([2.0, 0.0])), 6, np.array([[[0.0, 6.0]], [[0.0, 5.0]]]))
    match = still_to_video(video, nudged)

    assert [one.name for one in match.rejected] == ["pose02.png", "pose06.png"]
    assert "moved between video and still, by 2.0 px" in match.rejected[0].reason
    frame = corners_of(dslr.camera.video.width, dslr.camera.video.height)
    assert np.abs(match.output.from_calibrated(frame) - still_pixels(dslr, frame)).max() < 0.2


def test_a_few_wild_corners_pull_nothing(dslr: Rig) -> None:
    video, still = both_modes(dslr, 6, noise_px=0.05)
    wild = np.zeros_like(still.sightings[0].pixels)
    wild[0, ::20] = 8.0
    match = still_to_video(video, moved(still, 0, wild))

    frame = corners_of(dslr.camera.video.width, dslr.camera.video.height)
    assert np.abs(match.output.from_calibrated(frame) - still_pixels(dslr, frame)).max() < 0.05


def test_corners_unseen_in_one_mode_are_left_out(dslr: Rig) -> None:
    video, still = both_modes(dslr, 7)
    gone = np.zeros_like(still.sightings[3].pixels)
    gone[1] = np.nan
    match = still_to_video(video, moved(still, 3, gone))

    assert match.corners_used == 8 * 2 * 63 - 63


def test_a_camera_that_rolled_or_another_lens_is_no_mode_of_this_one(dslr: Rig) -> None:
    video, still = both_modes(dslr, 8)
    roll = np.radians(0.1)
    turned = [
        replace(one, pixels=one.pixels @ np.array([[np.cos(roll), np.sin(roll)], [-np.sin(roll), np.cos(roll)]]))
        for one in still.sightings
    ]
    with pytest.raises(CalibrationError, match=r"homography .* differs by [0-9.]+ px .* moved .* two lenses"):
        still_to_video(video, replace(still, sightings=tuple(turned)))


def test_what_tells_no_scale_is_refused_by_name(dslr: Rig) -> None:
    video, still = both_modes(dslr, 9, poses=4)
    elsewhere = [replace(one, name=f"boards_still/{number:06d}.png") for number, one in enumerate(still.sightings)]
    with pytest.raises(CalibrationError, match="0 have the same name"):
        still_to_video(video, replace(still, sightings=tuple(elsewhere)))

    shaken = still
    for index, by in enumerate((0.0, 15.0, -25.0, 40.0)):
        shaken = moved(shaken, index, np.array([by, -by]))
    with pytest.raises(CalibrationError, match=r"moved between|agree to"):
        still_to_video(video, shaken)
    with pytest.raises(CalibrationError, match=r"2 of 4 poses moved .* \(pose02.png"):
        still_to_video(video, moved(moved(still, 2, np.array(30.0)), 3, np.array(-20.0)))
    blurred = replace(video, sightings=tuple(roughly(one) for one in video.sightings))
    with pytest.raises(CalibrationError, match=r"agree to [0-9.]+ px only"):
        still_to_video(blurred, still)

    small = Board(4, 3, 1.0)
    tiny = [replace(one, pixels=one.pixels[:, :12] * 0.01 + 100) for one in video.sightings]
    assert tiny[0].pixels.shape[1] == small.corner_count
    with pytest.raises(CalibrationError, match="corners reach over"):
        still_to_video(replace(video, sightings=tuple(tiny)), replace(video, sightings=tuple(tiny)))
    other = [replace(one, pixels=one.pixels[:, :12]) for one in still.sightings]
    with pytest.raises(CalibrationError, match="the same board"):
        still_to_video(video, replace(still, sightings=tuple(other)))


def test_rendered_boards_tie_both_modes_together(oak: Rig) -> None:
    camera = msgspec.structs.replace(
        oak.camera, video=Mode(width=640, height=360, rate_hz=30.0), still=Mode(width=960, height=720)
    )
    little = msgspec.structs.replace(oak, camera=camera)
    wall = facing_plane(little, 3 * little.range.near_mm, 1).surfaces
    frames: dict[str, list[NamedFrame]] = {"video": [], "still": []}
    for index, (square_mm, R, t) in enumerate(board_poses(little, 2, 4, columns=7, rows=5)):
        scene = Scene("board", (board(7, 5, square_mm, R, t), *wall))
        for kind, mode in (("video", camera.video), ("still", camera.still)):
            pixels = Twin(little, scene, mode=mode, seed=index).frame().pixels
            frames[kind].append(NamedFrame(f"{index:06d}.png", pixels))
    video, still = (detect(frames[kind], little.views, Board(7, 5)) for kind in ("video", "still"))
    match = still_to_video(video, still)

    frame = corners_of(640, 360)
    assert np.abs(match.output.from_calibrated(frame) - still_pixels(little, frame)).max() < 0.15
    assert match.output.rms_px is not None
    assert match.output.rms_px < 0.25
