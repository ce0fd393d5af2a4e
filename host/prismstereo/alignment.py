"""How a rig stands against its rig file, told by raw frames: while the mount is still open and screws can be turned.

Three things are looked at. The seam says how the prism stands before the lens. Points found in both views say how the views
are turned against each other: a turn w (radians, rectified axes) of the right view against the left one moves a point at
slopes (a, b) by (w_y (1 + a^2) - w_z b - w_x a b,  w_z a - w_x (1 + b^2) + w_y a b) focal lengths. Rows give w_x and w_z
well; w_y hides in the depths, so that it needs a flat target at a known distance and is else hardly known.
What both views show around a point says which of them is blurred or dark.

Only turns of the views against each other can be seen; a prism rig's two mirrors are told apart because a tip turns a view
about the mirror's own line. Small displacements of mirrors are left to calibration.

Directions: right, left, up, down and clockwise are those of the picture, as the camera looks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo import alignment_mends as mends
from prismstereo.matched_rows import MatchedRows, matched_rows
from prismstereo_calibration.seam import Seam, find_seam
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.outlook import outlook
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side, View

__all__ = ["Alignment", "Figure", "Verdict", "alignment"]

Array = NDArray[np.float64]
Verdict = Literal["ok", "adjust", "unknown"]

_SEAM_SHARE = 0.005  # of the frame's width: columns lost by a lens so far off the prism's axis are few
_SLANT_DEG = 0.5
_BAND_SHARE = 0.5  # more than a stop of the aperture; a scene's own contrast makes the width uncertain by a third
_TURN_DEG = 0.1
_ROLL_DEG = 0.15
_VERGENCE_DEG = 0.2
_TIP_DEG = 0.08
_ROWS_VERGENCE_DEG = 0.15  # what the glass, which is no pinhole, makes of a vergence seen by rows alone
_FOCUS_RATIO = 0.25
_BRIGHTNESS_RATIO = 0.15
_SIDES: tuple[Side, Side] = ("left", "right")
_ROUNDS = 12
_FLAT_PX = 1.0  # what a flat target may leave of most points: more, and it is not flat
_MOST_PERCENT = 85
_PROBE_DEG = 0.02


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a rig: what it is, what the rig file wishes, and what to do about the difference.

    The unit is last in `name`. `sigma` is NaN where it is not known, `value` where it cannot be told. `mend` is empty for
    what is in order, and says what is missing where the verdict is unknown.
    """

    name: str
    value: float
    wish: float
    tolerance: float
    sigma: float = math.nan
    mend: str = ""
    at_most: bool = False  # less than the wish is as good

    @property
    def verdict(self) -> Verdict:
        """`ok` within the tolerance, `adjust` beyond it, `unknown` where the measurement cannot tell."""
        if math.isnan(self.value):
            return "unknown"
        off = self.value - self.wish if self.at_most else abs(self.value - self.wish)
        doubt = 0.0 if math.isnan(self.sigma) else 2 * self.sigma
        if doubt > self.tolerance and off <= self.tolerance + doubt:
            return "unknown"
        return "ok" if off <= self.tolerance else "adjust"


@dataclass(frozen=True, slots=True)
class Alignment:
    """All figures of a rig, the seam (None where it could not be told) and the pairs of points that they come from."""

    figures: tuple[Figure, ...]
    seam: Seam | None
    rows: MatchedRows
    frames: int

    @property
    def ok(self) -> bool:
        """Whether nothing needs adjusting; what is unknown does not count."""
        return all(figure.verdict != "adjust" for figure in self.figures)

    def figure(self, name: str) -> Figure:
        """Return a figure by name; `UsageError` lists the names there are."""
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise UsageError(f"there is no figure {name!r}: choose one of {', '.join(f.name for f in self.figures)}")


@dataclass(frozen=True, slots=True)
class _Turn:
    """Turn of the right view against the left one, (3,) radians about the rectified axes, and its standard deviations."""

    radians: Array
    sigma: Array
    note: str = ""  # why the turn about y is not known, or how it was found


def alignment(frame: RawFrame | Sequence[RawFrame], rig: Rig, distance_mm: float | None = None) -> Alignment:
    """Judge how a unit stands against its rig file by a raw frame, or by several of them together.

    `distance_mm` is that of a flat textured target that faces the rig and fills both views, from the entrance pupil; without
    it, vergence is known only as far as rows tell it. `CalibrationError` for a frame of another size, `ImageError` for no frame
    and for a scene that shows nothing to match, `UsageError` for a distance that is none.
    """
    frames = [frame] if isinstance(frame, RawFrame) else list(frame)
    if distance_mm is not None and not (math.isfinite(distance_mm) and distance_mm > 0):
        raise UsageError(f"distance_mm is {distance_mm:g}: give the distance of the flat target in mm, more than 0")
    rows = matched_rows(frames, rig)
    seam, seam_figures = _seam_figures(frames, rig)
    turn = _turn_of_rows(rows, 0.0 if seam is None else (seam.column_px - rig.lens().cx_px) / rig.lens().fx_px)
    if distance_mm is not None:
        turn = _with_vergence(rows, rig, turn, distance_mm)
    elif rig.folded("left") is None:  # glass that bends directions is too far from a pinhole for rows to tell
        turn = replace(turn, radians=np.array([turn.radians[0], math.nan, turn.radians[2]]))
    found = (*seam_figures, *_turn_figures(rows, turn, rig), *_picture_figures(rows, rig))
    return Alignment(found, seam, rows, len(frames))


def _figure(figure: Figure) -> Figure:
    """Return the figure, without its mend if it needs none."""
    return replace(figure, mend="") if figure.verdict == "ok" else figure


def _seam_figures(frames: Sequence[RawFrame], rig: Rig) -> tuple[Seam | None, tuple[Figure, ...]]:
    if rig.split_edge_mm is None or not all(rig.surfaces(side) for side in _SIDES):
        return None, ()  # no edge that divides the views, or one that does not stand before the middle of the lens
    width, lens, wished = rig.camera.video.width, rig.lens(), figures(rig).seam_px
    try:
        seam = find_seam([frame.pixels for frame in frames], lens.cx_px)
    except ImageError as error:
        return None, (Figure("seam_px", math.nan, lens.cx_px, _SEAM_SHARE * width, mend=str(error)),)
    aside_mm = (seam.column_px - lens.cx_px) / lens.fx_px * rig.split_edge_mm
    slant, band = mends.slant(seam.slant_deg), mends.band(seam.width_px, wished)
    return seam, (
        _figure(Figure("seam_px", seam.column_px, lens.cx_px, _SEAM_SHARE * width, mend=mends.seam(aside_mm))),
        _figure(Figure("seam_slant_deg", seam.slant_deg, 0.0, _SLANT_DEG, mend=slant)),
        _figure(
            Figure("seam_width_px", seam.width_px, wished, _BAND_SHARE * wished + 0.01 * width, mend=band, at_most=True)
        ),
    )


def _turn_figures(rows: MatchedRows, turn: _Turn, rig: Rig) -> tuple[Figure, ...]:
    off = rows.right_px[:, 1] - rows.left_px[:, 1]
    middle = float(np.median(off))
    sigma = 1.25 * float(np.std(off)) / math.sqrt(rows.count)
    tolerance_px = rows.rectification.focal_px * math.radians(_TURN_DEG)
    nod, vergence, roll = (float(value) for value in np.degrees(turn.radians))
    _, vergence_sigma, roll_sigma = (float(value) for value in np.degrees(turn.sigma))
    told = not turn.note or abs(vergence) > _VERGENCE_DEG + 2 * vergence_sigma
    mend = mends.vergence(vergence, isinstance(rig, PrismRig)) if told else turn.note
    return (
        _figure(Figure("vertical_offset_px", middle, 0.0, tolerance_px, sigma, mends.vertical(middle, nod))),
        _figure(Figure("roll_deg", roll, 0.0, _ROLL_DEG, roll_sigma, mends.roll(roll))),
        *(_tip_figures(turn, rig) if isinstance(rig, PrismRig) else ()),
        _figure(Figure("vergence_error_deg", vergence, 0.0, _VERGENCE_DEG, vergence_sigma, mend)),
    )


def _tip_figures(turn: _Turn, rig: PrismRig) -> tuple[Figure, ...]:
    """Tell the two mirrors of a prism rig apart by the turns that a tip of each would give."""
    names = ("left_tip_deg", "right_tip_deg")
    probes = np.stack([_turn_by(rig, name) for name in names], axis=1)[[0, 2]]  # radians per degree, about x and z
    solve = np.linalg.inv(probes)
    tips = solve @ turn.radians[[0, 2]]
    sigmas = np.sqrt(solve**2 @ turn.sigma[[0, 2]] ** 2)
    wishes = (rig.mirrors.left_tip_deg, rig.mirrors.right_tip_deg)
    return tuple(
        _figure(
            Figure(
                name, wish + float(more), wish, _TIP_DEG, float(sigma),
                mends.tip(name.split("_")[0], float(more), rig.mirrors.height_mm),
            )
        )
        for name, more, wish, sigma in zip(names, tips, wishes, sigmas, strict=True)
    )  # fmt: skip


def _turn_by(rig: PrismRig, name: str) -> Array:
    """Return the turn (3,) of the right view against the left, radians about the rig's axes, per degree of a mirror's tip."""
    mirrors = rig.mirrors
    tipped = msgspec.structs.replace(mirrors, **{name: getattr(mirrors, name) + _PROBE_DEG})
    other = msgspec.structs.replace(rig, mirrors=tipped)
    believed = [
        sight(rig, side).R.T @ sight(other, side).R for side in _SIDES
    ]  # where the rig file thinks a ray comes from
    W = believed[1] @ believed[0].T
    return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / (2 * _PROBE_DEG)


def _picture_figures(rows: MatchedRows, rig: Rig) -> tuple[Figure, ...]:
    focus, light = float(np.median(rows.sharpness)), float(np.median(rows.brightness))
    halves = _half(rig.views[0]), _half(rig.views[1])
    return (
        _figure(Figure("focus_ratio", focus, 1.0, _FOCUS_RATIO, mend=mends.focus(focus, halves))),
        _figure(Figure("brightness_ratio", light, 1.0, _BRIGHTNESS_RATIO, mend=mends.brightness(light, halves))),
    )


def _half(view: View) -> str:
    if view.width < 1:
        return "left half" if view.left == 0 else "right half"
    return "upper half" if view.top == 0 and view.height < 1 else "lower half" if view.height < 1 else "all"


def _robust_fit(terms: Array, values: Array) -> tuple[Array, Array]:
    """Fit values (N,) by terms (N, K) with Tukey's weights: K numbers and their standard deviations."""
    weights: Array = np.ones(len(values))
    found: Array = np.zeros(terms.shape[1])
    spread = 0.0
    for _ in range(_ROUNDS):
        found = np.asarray(np.linalg.lstsq(terms * weights[:, None], values * weights, rcond=None)[0], np.float64)
        rest = values - terms @ found
        spread = 1.4826 * float(np.median(np.abs(rest))) + 1e-9
        weights = np.maximum(1 - (rest / (4.685 * spread)) ** 2, 0)  # their square is Tukey's
    weighted = terms * weights[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted) * spread**2
    return found, np.sqrt(np.diag(covariance))


def _slopes(rows: MatchedRows) -> tuple[Array, Array]:
    """Return the rectified slopes a and b (N,) of the right view's points."""
    how = rows.rectification
    return (rows.right_px[:, 0] - how.right.cx_px) / how.focal_px, (rows.right_px[:, 1] - how.cy_px) / how.focal_px


def _turn_of_rows(rows: MatchedRows, aside: float) -> _Turn:
    """Find the turn by how far pairs lie off their rows; a seam that is `aside` (radians) makes the vergence as uncertain."""
    a, b = _slopes(rows)
    off = (rows.right_px[:, 1] - rows.left_px[:, 1]) / rows.rectification.focal_px
    found, sigma = _robust_fit(np.stack([-(1 + b * b), a * b, a], axis=1), off)
    sigma[1] = math.hypot(sigma[1], math.radians(_ROWS_VERGENCE_DEG), aside)
    return _Turn(found, sigma, mends.DISTANCE_UNKNOWN)


def _with_vergence(rows: MatchedRows, rig: Rig, turn: _Turn, distance_mm: float) -> _Turn:
    """Find the turn about y by a flat target at a known distance; it may be tilted about its middle."""
    how = rows.rectification
    expected = _right_of_plane(rows, rig, distance_mm)
    a, b = _slopes(rows)
    across = (rows.left_px[:, 0] - how.left.cx_px) / (2 * how.focal_px) + a / 2  # as seen from between the views
    off = (rows.right_px[:, 0] - expected) / how.focal_px + turn.radians[2] * b + turn.radians[0] * a * b
    seen = np.isfinite(off)
    terms = np.stack([1 + a * a, across, b], axis=1)[seen]
    found, sigma = _robust_fit(terms, off[seen])
    left_px = how.focal_px * float(np.percentile(np.abs(off[seen] - terms @ found), _MOST_PERCENT))
    if left_px > _FLAT_PX:
        radians = np.array([turn.radians[0], math.nan, turn.radians[2]])
        return _Turn(radians, turn.sigma, mends.not_flat(left_px))
    return _Turn(
        np.array([turn.radians[0], found[0], turn.radians[2]]), np.array([turn.sigma[0], sigma[0], turn.sigma[2]])
    )


def _right_of_plane(rows: MatchedRows, rig: Rig, distance_mm: float) -> Array:
    """Return the rectified columns (N,) at which the drawing's right view would show the left view's points on a plane."""
    how, looking, lens = rows.rectification, outlook(rig), rig.lens()
    origin, direction = sight(rig, "left").rays(lens.slopes(rows.raw_left_px))
    start, way = looking.to_scene(origin), direction @ looking.R_rig_from_scene
    point = looking.to_rig(start + ((distance_mm - start[:, 2]) / way[:, 2])[:, None] * way)
    raw = lens.project_slopes(sight(rig, "right").slopes(point))
    upright = how.right.view.upright_from_raw(raw, how.frame_width, how.frame_height)
    return how.rectify(upright, how.right)[:, 0]
