"""The quasi-Euclidean form: which turns of two cameras of one focal length would put all matches on common rows.

After Fusiello and Irsara. A camera that turns on the spot changes its picture by K R K^-1, which hardly distorts it; so the
rectifying homographies are looked for among those. With the left view's turn about the baseline set to none (turning both
about it changes nothing), five angles and one focal length are left, six numbers. Where two lenses took the views, two
more: the right view's zoom, and how much lower its principal point lies; both are held near zero, as few matches tell them
badly from the focal length.

Frames. u = (1, 0, 0) is the baseline in the rectified frame, x right, y down, z forward; R is rectified_from_camera.
Pixels are upright coordinates of each view; a view of every n-th row has a focal length n times shorter down than across.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.uncalibrated.damped import Bounds, Found, minimise
from prismstereo_calibration.uncalibrated.epipolar import homogeneous, sampson_homogeneous
from prismstereo_calibration.uncalibrated.pictures import ViewPictures

__all__ = ["TurnedForm", "TurnedViews", "fit_turned_views"]

Array = NDArray[np.float64]
TurnedForm = Literal["quasi-euclidean-5", "quasi-euclidean-6", "quasi-euclidean-8"]

_LOSS_PX = 0.5
_DEFAULT_FIELD_DEG = 68.0  # across the picture: what a camera has of which nothing is known
_MOST_ANGLE = 1.3  # radians: a view turned farther shows nothing of what the other one does
_MOST_ZOOM, _MOST_DROP = 0.3, 0.4  # natural logarithm; share of the picture's height
_TOE_IN = (0.0, 0.18, -0.18, 0.5, -0.5)  # half the angle between the views, radians: where the search begins
_FOCALS = (-0.5, 0.0, 0.5)
_BEST_STARTS = 2
_A_FEW_ROUNDS = 8
_FEW, _ROUGHLY = 300, 15  # matches, and rounds of every search but the last
_TELLING = 3.0  # standard deviations: nearer to the supposed focal length, the matches do not tell another
_SIZES: dict[TurnedForm, int] = {"quasi-euclidean-5": 5, "quasi-euclidean-6": 6, "quasi-euclidean-8": 8}
_HOLD = 0.05  # how firmly the form with eight numbers is held near these: in pixels of every match, per unit of
_HELD = np.array([0.2] * 5 + [1.0, 10.0, 5.0])  # angle, logarithm (base 3) of the focal length, zoom, drop
_NOTHING = (0.0,) * 8
_BASELINE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # [u]x


@dataclass(frozen=True, slots=True)
class TurnedViews:
    """Two turns that rectify: homographies (3, 3) from upright pixels to rectified ones, origin on the rectified z axis.

    `angles_deg`: y and z of the left view, x, y and z of the right one. `zoom`: the right focal length over the left one.
    `drop_px`: how much lower than supposed the right principal point lies. `cost`: of the robust fit.
    """

    H_left: Array
    H_right: Array
    focal_px: float
    angles_deg: Array
    zoom: float
    drop_px: float
    cost: float


@dataclass(frozen=True, slots=True)
class _Form:
    """What a vector of unknowns means: five angles, the focal length's exponent, zoom, drop; some of them fixed."""

    count: int
    focal_px: float  # at exponent 0
    axes: tuple[tuple[float, float], tuple[float, float]]  # where the lens axis meets both views
    row_steps: tuple[int, int]
    height: int

    @classmethod
    def of(cls, pictures: ViewPictures, count: int, focal_px: float) -> _Form:
        (x, y), (u, v) = pictures.principal_points.tolist()
        return cls(count, focal_px, ((x, y), (u, v)), pictures.row_steps, pictures.height)

    def matrices(self, q: Array) -> tuple[float, Array, Array]:
        """Return the left focal length, and R K^-1 of the left and of the right view, of unknowns (count,)."""
        y1, z1, x2, y2, z2, exponent, zoom, drop = (*(float(number) for number in q), *_NOTHING[self.count :])
        focal = self.focal_px * 3.0**exponent
        zoomed = focal * math.exp(zoom)
        (x, y), (u, v) = self.axes
        back_left = _inverse(focal, self.row_steps[0], x, y)
        back_right = _inverse(zoomed, self.row_steps[1], u, v + drop * self.height)
        return focal, _turn(0.0, y1, z1) @ back_left, _turn(x2, y2, z2) @ back_right

    def fundamental(self, q: Array) -> Array:
        """Return F = K2^-T R2^T [u]x R1 K1^-1."""
        _, left, right = self.matrices(q)
        return np.asarray(right.T @ _BASELINE @ left)

    def fit(self, left: Array, right: Array, start: Array, most_rounds: int = 60) -> Found:
        """Fit from `start` on; the form with eight numbers is held near upright, equal cameras."""
        N, held = len(left), self.count == 8
        hold = _HOLD * math.sqrt(N) * _HELD

        a, b = np.ascontiguousarray(homogeneous(left).T), np.ascontiguousarray(homogeneous(right).T)

        def residuals(q: Array) -> Array:
            apart = sampson_homogeneous(self.fundamental(q), a, b)
            return np.concatenate([apart, hold * q]) if held else apart

        scale = np.concatenate([np.full(N, _LOSS_PX), np.full(8 if held else 0, math.inf)])
        high = np.array([_MOST_ANGLE] * 5 + [1.0, _MOST_ZOOM, _MOST_DROP])[: self.count]
        return minimise(residuals, start, scale, Bounds(-high, high), most_rounds)

    def views(self, found: Found) -> TurnedViews:
        """Return what was found as homographies."""
        focal, left, right = self.matrices(found.unknowns)
        K_new = np.diag([focal, focal, 1.0])
        q = np.zeros(8)
        q[: self.count] = found.unknowns
        return TurnedViews(
            H_left=K_new @ left,
            H_right=K_new @ right,
            focal_px=focal,
            angles_deg=np.degrees(q[:5]),
            zoom=math.exp(q[6]),
            drop_px=float(q[7] * self.height),
            cost=found.cost,
        )


def fit_turned_views(
    form: TurnedForm, left: Array, right: Array, pictures: ViewPictures, focal_px: float | None = None
) -> TurnedViews:
    """Fit one of the quasi-Euclidean forms to matches (N, 2) in upright pixels of both views.

    The form with five numbers takes the focal length as given; the others look for it between a third and three times what
    is given, or else the picture's width plus height. In the form with six, one that runs against these bounds, or fits hardly
    better than what is supposed, is not in these matches: the one given, or that of an ordinary camera, takes its place, and
    the angles alone are fitted.
    """
    count = _SIZES[form]
    middle_px = float(pictures.width + pictures.height) if focal_px is None else focal_px
    default_px = pictures.camera_width / 2 / math.tan(math.radians(_DEFAULT_FIELD_DEG / 2))
    known_px = default_px if focal_px is None else focal_px
    if count == 5:
        return _angles(pictures, known_px, left, right)
    whole, few = _Form.of(pictures, count, middle_px), _even_choice(len(left))
    starts = [
        np.concatenate([found.unknowns, [exponent], np.zeros(count - 6)])
        for exponent in _FOCALS
        for found in _starts(_Form.of(pictures, 5, middle_px * 3.0**exponent), left[few], right[few])
    ]
    nearly = min((whole.fit(left[few], right[few], start, _ROUGHLY) for start in starts), key=lambda one: one.cost)
    found = whole.fit(left, right, nearly.unknowns)
    if count == 6:
        supposed = _angles(pictures, known_px, left, right)
        gain = (supposed.cost - found.cost) / max(found.cost / max(len(left) - 6, 1), 1e-12)
        if abs(found.unknowns[5]) >= 1 - 1e-9 or gain < _TELLING**2:
            return supposed
    return whole.views(found)


def _angles(pictures: ViewPictures, focal_px: float, left: Array, right: Array) -> TurnedViews:
    """Fit the five angles for a focal length that is known."""
    form, few = _Form.of(pictures, 5, focal_px), _even_choice(len(left))
    starts = _starts(form, left[few], right[few])
    nearly = min((form.fit(left[few], right[few], one.unknowns, _ROUGHLY) for one in starts), key=lambda one: one.cost)
    return form.views(form.fit(left, right, nearly.unknowns))


def _even_choice(count: int) -> NDArray[np.intp]:
    """Return which of many matches tell from where to begin: all of them would tell no better."""
    return np.linspace(0, count - 1, min(count, _FEW)).astype(np.intp)


def _starts(form: _Form, left: Array, right: Array) -> list[Found]:
    """Return angles to begin at, of those that were tried the ones of least loss after a few rounds."""
    tried = [form.fit(left, right, np.array([toe_in, 0.0, 0.0, -toe_in, 0.0]), _A_FEW_ROUNDS) for toe_in in _TOE_IN]
    tried.sort(key=lambda one: one.cost)
    distinct = tried[:1]
    for one, after in itertools.pairwise(tried):
        if np.abs(one.unknowns - after.unknowns).max() > 1e-3 and len(distinct) < _BEST_STARTS:
            distinct.append(after)
    return distinct


def _inverse(focal_px: float, row_step: int, x: float, y: float) -> Array:
    """Return K^-1 of a view with every `row_step`-th row, whose lens axis is at x, y."""
    return np.array(
        [[1 / focal_px, 0.0, -x / focal_px], [0.0, row_step / focal_px, -y * row_step / focal_px], [0, 0, 1]]
    )


def _turn(x: float, y: float, z: float) -> Array:
    """Return the rotation Rx Ry Rz of three angles in radians."""
    a, b, c, s, t, w = math.cos(x), math.cos(y), math.cos(z), math.sin(x), math.sin(y), math.sin(z)
    return np.array(
        [
            [b * c, -b * w, t],
            [a * w + s * t * c, a * c - s * t * w, -s * b],
            [s * w - a * t * c, s * c + a * t * w, a * b],
        ]
    )
