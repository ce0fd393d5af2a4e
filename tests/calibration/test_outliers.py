"""Frames that do not belong: named, with the reason, and without a trace in the result."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest

from calibration.traced_boards import PRISM_RIGS, SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Rejection, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Model
from prismstereo_calibration.solving.solve import solve
from prismstereo_hw.rig import Rig

BOARD = Board(9, 7, SQUARE_MM)
MODELS: tuple[Model, ...] = ("one-lens", "two-camera")


@pytest.fixture(params=PRISM_RIGS)
def rig(request: pytest.FixtureRequest) -> Rig:
    """Each built-in prism rig."""
    return Rig.read(request.param)


def with_pair(detection: Detection, index: int, left: np.ndarray, right: np.ndarray) -> Detection:
    """The detection with the corners of one frame replaced."""
    pairs = list(detection.sightings)
    pairs[index] = Sighting.of(pairs[index].name, left, right)
    return replace(detection, sightings=tuple(pairs))


def spoiled(detection: Detection, how: str) -> Detection:
    """The detection with frame 5 spoiled."""
    left, right = detection.sightings[5].left, detection.sightings[5].right
    noise = np.random.default_rng(8).normal(0, 3, right.shape)
    return with_pair(
        detection,
        5,
        left + 40 if how == "one view moved" else left,
        {
            "one view moved": right,
            "blurred": right + noise,
            "counted from the other end": right[::-1],
            "of another moment": detection.sightings[6].right,
            "one corner mistaken": right + 9.0 * (np.arange(len(right)) == 17)[:, None],
        }[how],
    )


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("one view moved", "px off"),
        ("blurred", "px off"),
        ("of another moment", "px off"),
        ("counted from the other end", "corners in another order"),
    ],
)
def test_a_spoiled_frame_is_rejected_by_name_and_leaves_no_trace(oak: Rig, model: Model, how: str, reason: str) -> None:
    detection = traced_detection(oak, 1)
    solution = solve(spoiled(detection, how), BOARD, rig=oak, model=model)
    without = solve(
        detection.only({pair.name for i, pair in enumerate(detection.sightings) if i != 5}), BOARD, rig=oak, model=model
    )
    assert [entry.name for entry in solution.rejected] == ["pose05.png"]
    assert reason in solution.rejected[0].reason
    assert solution.calibration.baseline == pytest.approx(without.calibration.baseline, abs=1e-4)
    assert solution.rms_px == pytest.approx(without.rms_px, abs=1e-6)
    assert solution.calibration.views_used == 14


def test_a_mistaken_corner_is_rejected_alone(oak: Rig) -> None:
    solution = solve(spoiled(traced_detection(oak, 1), "one corner mistaken"), BOARD, rig=oak)
    (corner,) = solution.rejected_corners
    assert (corner.name, corner.view, corner.corner) == ("pose05.png", 1, 17)
    assert corner.off_px == pytest.approx(9 * 2**0.5, abs=1.5)
    assert (solution.rejected, solution.calibration.views_used) == ((), 15)
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)


def test_a_third_of_the_frames_may_be_wrong(oak: Rig) -> None:
    detection = traced_detection(oak, 1)
    random = np.random.default_rng(2)
    for index in (1, 4, 7, 10, 13):
        left, right = detection.sightings[index].left, detection.sightings[index].right
        detection = with_pair(detection, index, left, right + random.normal(0, 4, right.shape))
    solution = solve(detection, BOARD, rig=oak)
    assert [entry.name[4:6] for entry in solution.rejected] == ["01", "04", "07", "10", "13"]
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)


def test_good_frames_are_never_rejected(rig: Rig) -> None:
    for seed in range(3):
        assert solve(traced_detection(rig, seed), BOARD, rig=rig).rejected == ()


def test_rejections_of_the_detector_are_carried_along(oak: Rig) -> None:
    early = (Rejection("blank.png", "no board in either view"),)
    detection = replace(spoiled(traced_detection(oak, 1), "blurred"), rejected=early)
    assert [entry.name for entry in solve(detection, BOARD, rig=oak).rejected] == ["blank.png", "pose05.png"]


def test_frames_of_nothing_end_in_one_sentence_that_names_some(oak: Rig) -> None:
    random = np.random.default_rng(0)
    pairs = tuple(
        Sighting.of(f"{i}.png", random.uniform(0, 700, (63, 2)), random.uniform(0, 700, (63, 2))) for i in range(6)
    )
    detection = replace(traced_detection(oak, 1), sightings=pairs)
    for model in MODELS:
        with pytest.raises(CalibrationError, match=r"frames that show the board as they should: 0.*rejected: 0\.png"):
            solve(detection, BOARD, rig=oak, model=model)
        with pytest.raises(CalibrationError):
            solve(detection, BOARD, model=model)


FAULTS = ("blurred", "another board", "views exchanged")
ANOTHER = Board(12, 9, SQUARE_MM)  # a board of other counts: the corners that a detector would make of a part of it


def with_fault(
    detection: Detection, other: Detection, index: int, fault: str, random: np.random.Generator
) -> Detection:
    """The detection with one frame that has a bad view, drawn at random where there is a choice."""
    views = [detection.sightings[index].left, detection.sightings[index].right]
    bad = int(random.integers(2))
    if fault == "blurred":
        views[bad] = views[bad] + random.normal(0, 3, views[bad].shape)
    elif fault == "another board":  # 9 x 7 of the other board's corners, anywhere on it
        grid = other.sightings[int(random.integers(len(other.sightings)))].pixels[bad].reshape(9, 12, 2)
        row, column = int(random.integers(3)), int(random.integers(4))
        views[bad] = grid[row : row + 7, column : column + 9].reshape(-1, 2)
    else:
        views = views[::-1]
    return with_pair(detection, index, *views)


@dataclass(frozen=True)
class Campaign:
    """How often a fault was found and named, and how often a good frame had to go with it."""

    trials: int
    named: int
    innocent: int


def campaign(rig: Rig, fault: str, seeds: int) -> Campaign:
    """Spoil one of fifteen frames, which and how by the seed, and solve."""
    named = innocent = 0
    for seed in range(seeds):
        random = np.random.default_rng([seed, FAULTS.index(fault)])
        index = int(random.integers(15))
        detection = with_fault(
            traced_detection(rig, seed % 5), traced_detection(rig, 0, poses=5, board=ANOTHER), index, fault, random
        )
        gone = Counter(entry.name for entry in solve(detection, BOARD, rig=rig).rejected)
        named += gone.pop(f"pose{index:02d}.png", 0)
        innocent += gone.total()
    return Campaign(seeds, named, innocent)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_frame_with_a_bad_view_is_found_and_named(oak: Rig, fault: str) -> None:
    assert campaign(oak, fault, 4) == Campaign(trials=4, named=4, innocent=0)


@pytest.mark.soak
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", PRISM_RIGS)
def test_in_a_hundred_trials_bad_views_are_found_and_named(name: str, fault: str) -> None:
    found = campaign(Rig.read(name), fault, 100)
    print(f"\n| {name} | {fault} | named {found.named} of {found.trials} | good frames lost {found.innocent} |")
    assert found.named >= 0.95 * found.trials
    assert found.innocent <= 0.01 * 14 * found.trials
