"""Which board the pictures show, read from the code that is printed beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.target.code import CODE_DICTIONARIES, LEAST, decode, place_and_digit
from prismstereo_calibration.target.code_markers import seen_markers
from prismstereo_hw.view import View

__all__ = ["read", "read_from"]

_SURE = 2  # pictures in which a marker must have been seen before reading stops early
_PATIENCE = 12  # frames that show fewer than `_A_TRACE` places of a code, after which there is none
_A_TRACE = 3  # places: now and then a board's own marker passes for one of the code's

Picture = NDArray[np.uint8]
Votes = dict[str, Counter[int]]  # dictionary -> how many pictures show each of its markers


def read(picture: Picture) -> Board | None:
    """Read the code in an upright picture, (height, width[, 3]) uint8; None where no whole code is seen."""
    return _elected({name: Counter(seen) for name, seen in seen_markers(picture).items()})


def read_from(frames: Iterable[NamedFrame], views: Sequence[View]) -> Board:
    """Read the code from the views of many frames, each of which may show a part of it.

    Every place of the code takes the digit that most pictures show. `frames` may be lazy; reading stops as soon as the code is
    sure. `CalibrationError` where no frame shows enough of a code.
    """
    votes: Votes = {name: Counter() for name in CODE_DICTIONARIES}
    looked, places = 0, 0
    for looked, frame in enumerate(frames, start=1):
        for view in views:
            for name, seen in seen_markers(view.cut(frame.pixels)).items():
                votes[name].update(seen)
            sure = {name: Counter({n: v for n, v in seen.items() if v >= _SURE}) for name, seen in votes.items()}
            board = _elected(sure)
            if board is not None:
                return board
        places = max(_places(seen) for seen in votes.values())
        if looked >= _PATIENCE and places < _A_TRACE:
            break
    board = _elected(votes)
    if board is None:
        raise CalibrationError(
            f"no board code in {looked} frames ({places} of its markers seen, {LEAST} are needed): keep the small markers "
            "beside the board in the picture, or say which board it is with --board and --square-mm"
        )
    return board


def _places(markers: Iterable[int]) -> int:
    """Count the places of a code that markers stand for."""
    return len({claim[0] for claim in map(place_and_digit, markers) if claim is not None})


def _elected(votes: Votes) -> Board | None:
    """Return the board of the markers that won their places; a tie wins nothing."""
    for name, seen in votes.items():
        best: dict[int, list[int]] = {}
        for marker, count in seen.items():
            claim = place_and_digit(marker)
            if claim is None:
                continue
            rivals = best.setdefault(claim[0], [])
            if not rivals or count > seen[rivals[0]]:
                best[claim[0]] = [marker]
            elif count == seen[rivals[0]]:
                rivals.append(marker)
        board = decode([rivals[0] for rivals in best.values() if len(rivals) == 1], name)
        if board is not None:
            return board
    return None
