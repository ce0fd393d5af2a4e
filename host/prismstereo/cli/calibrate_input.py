"""What `prismstereo calibrate` is given: pictures, the rig or the layout of the views, the board, further pictures."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from prismstereo.frames import BoardFrames, expand, pairs
from prismstereo_calibration.boards.board import Board
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.session import Session
from prismstereo_hw.view import LAYOUTS, View, read_layout
from prismstereo_hw.view import layout as layout_by_name

if TYPE_CHECKING:
    from prismstereo_calibration.seam import Seam

__all__ = ["Given", "board_of", "given", "require_state", "seam_of"]

_SEAM_FRAMES = 6
_COLDEST_C, _HOTTEST_C = -100.0, 200.0
_FARTHEST_STEP = 1_000_000


@dataclass(frozen=True, slots=True)
class Given:
    """The pictures, and what the command line or a session says of them.

    `board` is written as for --board, "" where nobody says; `stills` are board views of the still mode.
    """

    frames: BoardFrames
    rig: Rig | None
    views: tuple[View, ...]
    board: str = ""
    square_mm: float | None = None
    stills: BoardFrames | None = None


def given(
    frames: tuple[Path, ...],
    left: str | None,
    right: str | None,
    rig: str | None,
    layout: str | None,
    *,
    scene: bool = False,
) -> Given:
    """Read what the command line names; `UsageError` where it contradicts itself or says too little.

    Of a session folder the board views are taken, or with `scene` the video.
    """
    if left or right:
        if frames or not (left and right):
            raise UsageError("give FRAMES, or both --left and --right, not a mixture")
        if rig or layout:
            raise UsageError("--left and --right are two cameras: they have no --rig and no --layout")
        return Given(BoardFrames(pairs(left, right)), None, LAYOUTS["side-by-side"])
    if not frames:
        raise UsageError(
            "give pictures of the board: prismstereo calibrate frames/*.png --rig oak-1 --board ... -o unit.json"
        )
    if rig is not None and layout is not None:
        raise UsageError("give --rig or --layout, not both: a rig knows its layout")
    if len(frames) == 1 and (frames[0] / "session.toml").is_file():
        return _of_session(Session.open(frames[0]), rig, layout, scene=scene)
    built, views = _views(rig, layout)
    return Given(BoardFrames(expand(frames)), built, views)


def _of_session(session: Session, rig: str | None, layout: str | None, *, scene: bool) -> Given:
    folder, info = session.folder, session.info
    paths = session.paths("video" if scene else "boards")
    if not paths:
        what = "no video" if scene else "no board views: simulate some with --boards"
        raise UsageError(f"{folder} holds {what}, or give FRAMES")
    own = folder / "rig.toml"
    built, views = _views(rig or (None if layout else str(own) if own.is_file() else info.rig), layout)
    stills = session.paths("boards_still")
    return Given(
        BoardFrames(paths),
        built,
        views,
        info.board or "",
        info.square_mm or None,
        BoardFrames(stills) if stills and not scene else None,
    )


def _views(rig: str | None, layout: str | None) -> tuple[Rig | None, tuple[View, ...]]:
    if rig is not None:
        built = Rig.read(rig)
        return built, built.views
    if layout is None:
        raise UsageError("say where the views lie: --rig oak-1 for a prism unit, or --layout side-by-side")
    if Path(layout).suffix.lower() == ".toml":
        return None, read_layout(layout)
    return None, layout_by_name(layout)


def board_of(found: Given, board: str | None, square_mm: float | None, bar_mm: float | None) -> Board:
    """Return the board: as it is named, as the session says, or as the code beside it in the pictures says."""
    from prismstereo_calibration.target.reading import read_from
    from prismstereo_calibration.target.scale import printed

    text = board or found.board
    if text:
        known = Board.parse(text, found.square_mm if square_mm is None else square_mm)
    else:
        known = read_from(found.frames, found.views)
        known = known if square_mm is None else replace(known, square_mm=square_mm)
    if bar_mm is None:
        return known
    if square_mm is not None:
        raise UsageError("give --square-mm or --bar-mm, not both: a measured square needs no bar")
    return printed(known, bar_mm)


def require_state(lens_position: int | None, temperature_c: float | None) -> None:
    """Refuse a focus or a temperature that no unit has, before anything is measured."""
    if temperature_c is not None and not _COLDEST_C <= temperature_c <= _HOTTEST_C:  # NaN compares as False
        raise UsageError(f"--temperature-c {temperature_c:g}: give {_COLDEST_C:g} to {_HOTTEST_C:g} degrees Celsius")
    if lens_position is not None and abs(lens_position) > _FARTHEST_STEP:
        raise UsageError(
            f"--lens-position {lens_position}: give what the camera counts, {-_FARTHEST_STEP} to {_FARTHEST_STEP}"
        )


def seam_of(found: Given) -> Seam | None:
    """Find the seam between views that stand side by side behind one lens; None where there is none to be seen."""
    from prismstereo_calibration.seam import find_seam

    beside = found.views[:2] in (LAYOUTS["side-by-side"], LAYOUTS["swapped"])
    if found.rig is None or not beside or found.views[0].exposures > 1:
        return None
    try:
        return find_seam([frame.pixels for frame in itertools.islice(iter(found.frames), _SEAM_FRAMES)])
    except ImageError:  # a blank scene shows none
        return None
