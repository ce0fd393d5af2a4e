"""The rectification of a unit from matches alone: every form is fitted to one half of them and judged on the other.

Taken is the plainest form that explains the held-back matches hardly worse than a free fundamental matrix does: five angles
where the focal length is known, six numbers, eight, and Hartley's form at last. It is then fitted to all matches; the
figures stay those of the held-back half.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.uncalibrated.epipolar import sampson
from prismstereo_calibration.uncalibrated.form_figures import FORMS, Form, FormFigures, evened, figures
from prismstereo_calibration.uncalibrated.hartley import fit_fundamental, fit_hartley
from prismstereo_calibration.uncalibrated.pictures import ViewPictures
from prismstereo_calibration.uncalibrated.placement import place
from prismstereo_calibration.uncalibrated.scene_matches import LEAST_MATCHES, SceneMatches
from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification, SceneView
from prismstereo_calibration.uncalibrated.turned_views import fit_turned_views
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.lens import Lens

__all__ = ["MOST_LABELS", "FittedForm", "fit_form", "fit_scene"]

Array = NDArray[np.float64]

MOST_LABELS = 256  # a longer search makes the rectified pictures smaller
_HARDLY_WORSE = 1.5
_SEED = 2010


@dataclass(frozen=True, slots=True)
class FittedForm:
    """Evened homographies (3, 3) from upright to rectified pixels, and the focal length of a form that has one."""

    form: Form
    H_left: Array
    H_right: Array
    focal_px: float | None = None


def fit_form(
    form: Form, left: Array, right: Array, pictures: ViewPictures, focal_px: float | None = None
) -> FittedForm | None:
    """Fit one form to matches (N, 2) in upright pixels; None where it would turn a view inside out."""
    found_px: float | None = None
    if form == "hartley":
        pair = fit_hartley(left, right, pictures)
    else:
        turned = fit_turned_views(form, left, right, pictures, focal_px)
        pair, found_px = (turned.H_left, turned.H_right), turned.focal_px
    even = None if pair is None else evened(*pair, pictures)
    return None if even is None else FittedForm(form, *even, found_px)


def fit_scene(
    matches: SceneMatches, *, rig: str = "", lens: Lens | None = None, one_lens: bool | None = None,
    most_labels: int = MOST_LABELS,
) -> SceneRectification:  # fmt: skip
    """Derive the rectification of a unit from matches of its scenes.

    `lens`: the one lens before both views as far as it is known, in raw-frame pixels: its axis, and its focal length as the
    first to be tried. Without it the axis is taken to pass through the middle of the frame (`one_lens`, or where a view is
    mirrored) or of each view. `CalibrationError` where there are too few matches, or no form rectifies them.
    """
    if len(matches.left) < LEAST_MATCHES:
        raise CalibrationError(f"{len(matches.left)} matches, and {LEAST_MATCHES} are needed: give more frames")
    pictures = ViewPictures.of(matches.views, matches.frame_width, matches.frame_height, lens, one_lens=one_lens)
    focal_px = None if lens is None else lens.fx_px
    order = np.random.default_rng(_SEED).permutation(len(matches.left))
    fit, held = np.sort(order[::2]), np.sort(order[1::2])
    tried = _judged(matches, fit, held, pictures, focal_px)
    form, reason = _choice(tried, _free(matches, fit, held))
    best = fit_form(form, matches.left, matches.right, pictures, focal_px)
    if best is None:
        raise CalibrationError(f"the form {form} fits one half of the matches and not all of them: give more frames")
    placed = place(best.H_left, best.H_right, matches.left, matches.right, pictures, most_labels)
    return SceneRectification(
        left=SceneView(matches.views[0], placed.H_left),
        right=SceneView(matches.views[1], placed.H_right),
        width=placed.width,
        height=placed.height,
        frame_width=matches.frame_width,
        frame_height=matches.frame_height,
        window=DisparityWindow(placed.labels),
        scale=placed.scale,
        form=form,
        reason=reason,
        figures=tried,
        matches=len(matches.left),
        rig=rig,
    )


def _judged(
    matches: SceneMatches, fit: NDArray[np.intp], held: NDArray[np.intp], pictures: ViewPictures, focal_px: float | None
) -> tuple[FormFigures, ...]:
    """Fit every form to one part of the matches and judge it on the other; those that cannot be used are left out."""
    tried = []
    for form in FORMS if focal_px is not None else FORMS[1:]:
        fitted = fit_form(form, matches.left[fit], matches.right[fit], pictures, focal_px)
        if fitted is not None:
            judged = figures(
                form, fitted.H_left, fitted.H_right, matches.left[held], matches.right[held], pictures, fitted.focal_px
            )
            tried += [] if judged is None else [judged]
    return tuple(tried)


def _free(matches: SceneMatches, fit: NDArray[np.intp], held: NDArray[np.intp]) -> float:
    """Return how far the held-back matches are from a free fundamental matrix, in pixels; inf where there is none."""
    F = fit_fundamental(matches.left[fit], matches.right[fit])
    return float("inf") if F is None else float(np.abs(sampson(F, matches.left[held], matches.right[held])).mean())


def _choice(tried: tuple[FormFigures, ...], free_px: float) -> tuple[Form, str]:
    """Take the first form that is hardly worse than no form at all, and say why."""
    if not tried:
        raise CalibrationError(
            "no rectification of any form puts these matches on common rows: check where the views lie, and give frames with "
            "things at several distances"
        )
    limit = f"{_HARDLY_WORSE} times the {free_px:.3f} px of a free fundamental matrix"
    for one in tried:
        if one.sampson_px <= _HARDLY_WORSE * free_px:
            return one.form, f"the plainest form whose held-back matches lie within {limit}: {one.sampson_px:.3f} px"
    best = min(tried, key=lambda one: one.row_error_mean_px)
    return best.form, f"no form keeps within {limit}; this one has the least row error"
