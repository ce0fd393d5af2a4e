"""What view to add: the promise of a proposed view is held against a solution with that view in it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from calibration.traced_boards import SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_calibration.judging.board_places import places
from prismstereo_calibration.judging.next_view import NextView, next_views
from prismstereo_calibration.judging.uncertainty_map import uncertainty_maps
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.solve import Solution, solve
from prismstereo_hw.rig import Rig

BOARD = Board(9, 7, SQUARE_MM)


@cache
def few() -> tuple[Detection, Solution, tuple[NextView, ...]]:
    """Six boards before an OAK-1, their solution, and what it asks for."""
    rig = Rig.read("oak-1")
    detection = traced_detection(rig, 1, poses=6)
    solution = solve(detection, BOARD, rig=rig)
    calibration = solution.calibration
    return (
        detection,
        solution,
        next_views(calibration, BOARD, solution.rms_px / math.sqrt(2), uncertainty_maps(calibration)),
    )


def share(calibration: Calibration) -> float:
    """The mean over the maps of the relative depth uncertainty."""
    maps = uncertainty_maps(calibration)
    return float(np.mean([np.nanmean(one.calibration_sigma / one.depth) for one in maps]))


def with_views(views: tuple[NextView, ...]) -> Calibration:
    """The six boards and the proposed ones, seen by the solved cameras with the same noise, solved again."""
    detection, solution, _ = few()
    noise = np.random.default_rng(3)
    added = []
    for index, view in enumerate(views):
        cameras = solution.calibration.left, solution.calibration.right
        pixels = [camera.project(view.place.points) + noise.normal(0, 0.2, (63, 2)) for camera in cameras]
        added.append(Sighting.of(f"added{index}.png", *pixels))
    more = replace(detection, sightings=(*detection.sightings, *added))
    return solve(more, BOARD, rig=Rig.read("oak-1")).calibration


def test_a_proposed_view_brings_what_is_promised() -> None:
    _, solution, proposed = few()
    assert proposed[0].share_before == pytest.approx(share(solution.calibration), rel=0.05)
    assert share(with_views(proposed[:1])) == pytest.approx(proposed[0].share_after, rel=0.15)
    assert share(with_views(proposed)) == pytest.approx(proposed[-1].share_after, rel=0.15)


def test_a_proposed_view_beats_the_seventh_that_was_taken_by_chance(oak: Rig) -> None:
    by_chance = solve(traced_detection(oak, 1, poses=7), BOARD, rig=oak).calibration
    assert few()[2][0].share_after < 0.9 * share(by_chance)


def test_each_proposal_counts_on_those_before_it_and_is_another_place() -> None:
    proposed = few()[2]
    assert len(proposed) == 3
    for first, second in pairwise(proposed):
        assert second.share_before == first.share_after
        assert second.sigma_before == first.sigma_after
    assert all(one.share_after < 0.97 * one.share_before for one in proposed)
    assert len({one.sentence for one in proposed}) == 3


def test_the_sentence_says_where_the_board_is() -> None:
    calibration = few()[1].calibration
    x, y, w, h = calibration.left_view.rectangle(calibration.frame_width, calibration.frame_height)
    for view in few()[2]:
        column, row = (calibration.left.project(view.place.points).mean(axis=0) - [x, y]) / [w, h]
        assert ("lower" in view.sentence.split(" of the left view")[0]) == (row > 2 / 3)
        assert ("right part" in view.sentence) == (column > 2 / 3)
        assert f"about {float(f'{view.place.depth:.2g}'):g} mm away" in view.sentence


def test_a_positive_tilt_brings_the_right_or_upper_side_nearer_and_every_place_shows_the_whole_board() -> None:
    calibration = few()[1].calibration
    found = places(calibration, BOARD)
    assert {place.about for place in found} == {"", "vertical", "horizontal"}
    assert len({place.depth for place in found}) == 3
    for place in found:
        z = place.points[:, 2].reshape(7, 9)
        if place.about == "vertical":
            assert (z[:, -1].mean() < z[:, 0].mean()) == (place.tilt_deg > 0)
        if place.about == "horizontal":
            assert (z[0].mean() < z[-1].mean()) == (place.tilt_deg > 0)
        for camera, view in zip((calibration.left, calibration.right), calibration.views, strict=True):
            x, y, w, h = view.rectangle(calibration.frame_width, calibration.frame_height)
            pixels = camera.project(place.points)
            assert ((pixels > [x, y]) & (pixels < [x + w - 1, y + h - 1])).all()


def test_nothing_is_proposed_where_nothing_is_known_or_no_board_fits(oak: Rig) -> None:
    _, solution, _ = few()
    maps = uncertainty_maps(solution.calibration)
    assert next_views(Calibration.nominal(oak), BOARD, 0.2, ()) == ()
    assert next_views(solution.calibration, Board(40, 40, 50.0), 0.2, maps) == ()
    assert next_views(solution.calibration, BOARD, 0.0, maps) == ()
