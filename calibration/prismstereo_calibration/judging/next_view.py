"""What view to add next: the place of the board that would take most off the uncertainty of depth, before it is taken.

A view adds what its corners say about the cameras' 24 numbers once its own, unknown pose is taken out. With the present
covariance C = L L^T, the view's derivatives J freed of its pose, and s the corners' noise per axis, the covariance becomes
L (1 + (J L)^T (J L) / s^2)^-1 L^T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.judging.board_places import Place, places
from prismstereo_calibration.judging.sensitivity import derivative
from prismstereo_calibration.judging.uncertainty_map import UncertaintyMap, depth_gradient, yardstick
from prismstereo_calibration.model import Calibration, Unit
from prismstereo_calibration.solving.poses import rotations

__all__ = ["NextView", "next_views"]

Array = NDArray[np.float64]
_EVERY = 2  # field of the maps, each way, is enough to compare by
_LEAST_GAIN = 0.03  # of the uncertainty: less is not worth a view
_LEAST_EIGENVALUE = 1e-12  # of the correlation matrix
_TURN_STEP_RAD, _SHIFT_STEP = 1e-5, 1e-5  # of the depth


@dataclass(frozen=True, slots=True, eq=False)
class NextView:
    """A place for the board, and the depth uncertainty that is expected without and with that view.

    `sentence` says it to a person. `share_before`, `share_after`: mean over the maps, of the depth; `sigma_before`,
    `sigma_after`: typical at `depth_of_sigma`, in `unit`. Views after the first count on those before them.
    """

    sentence: str
    place: Place
    unit: Unit
    depth_of_sigma: float
    share_before: float
    share_after: float
    sigma_before: float
    sigma_after: float


def next_views(
    calibration: Calibration, board: Board, noise_px: float, maps: tuple[UncertaintyMap, ...], count: int = 3
) -> tuple[NextView, ...]:
    """Propose up to so many views, the most useful first; none where nothing would help by 3 %, or nothing is known.

    `noise_px` is the corners' noise per axis: the rms over the square root of two. `maps` are what is to become better.
    """
    if calibration.uncertainty is None or not maps or not noise_px > 0:
        return ()
    candidates = places(calibration, board)
    if not candidates:
        return ()
    factor = _factor(calibration.uncertainty.covariance)
    if not factor.size:
        return ()
    told = _freed(calibration, candidates) @ factor / noise_px  # (C, M, r)
    gains = told.swapaxes(1, 2) @ told
    wanted = _gradients(calibration, maps, factor)
    known = np.eye(factor.shape[1])  # the information so far
    sentences = [_sentence(calibration, place) for place in candidates]
    found: list[NextView] = []
    said: list[str] = []
    for _ in range(count):
        before = _mean_share(wanted, known)
        after = np.array([_mean_share(wanted, known + gain) for gain in gains])
        best = int(np.argmin(after))
        if not after[best] < (1 - _LEAST_GAIN) * before:
            break
        sigmas = [_typical(calibration, wanted, information) for information in (known, known + gains[best])]
        found.append(_view(calibration, candidates[best], (before, float(after[best])), (sigmas[0], sigmas[1])))
        known = known + gains[best]
        said.append(sentences[best])
        gains[[sentence in said for sentence in sentences]] = 0.0  # another place shows what the model hides
    return tuple(found)


def _factor(covariance: Array) -> Array:
    """Return L (24, r) with L L^T the covariance, whose rank r is that of the model."""
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    kept = values > _LEAST_EIGENVALUE
    return np.asarray(safe[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def _freed(calibration: Calibration, candidates: tuple[Place, ...]) -> Array:
    """Return how the corners' pixels of each place move with the 24 numbers, its pose taken out: (C, M, 24)."""
    points = np.stack([place.points for place in candidates])

    def pixels(left: Camera, right: Camera, at: Array = points) -> Array:
        seen = np.stack([left.project(at), right.project(at)], axis=1)
        return seen.reshape(len(points), -1)

    numbers = derivative(calibration, pixels)
    middle = points.mean(axis=1, keepdims=True)
    step = _SHIFT_STEP * float(np.median(middle[..., 2]))
    moved = [
        (
            step_by,
            [middle + (points - middle) @ rotations(by * turn * axis).T + by * shift * axis for by in (1.0, -1.0)],
        )
        for step_by, turn, shift in ((_TURN_STEP_RAD, _TURN_STEP_RAD, 0.0), (step, 0.0, step))
        for axis in np.eye(3)
    ]
    cameras = calibration.left, calibration.right
    by_pose = [(pixels(*cameras, ahead) - pixels(*cameras, behind)) / (2 * by) for by, (ahead, behind) in moved]
    basis, _ = np.linalg.qr(np.stack(by_pose, axis=-1))
    return np.asarray(numbers - basis @ (basis.swapaxes(1, 2) @ numbers))


def _gradients(calibration: Calibration, maps: tuple[UncertaintyMap, ...], factor: Array) -> list[tuple[float, Array]]:
    """Return the depth of each map and how the relative depths in it move, (P, r)."""
    thin = [(one.depth, one.pixels[::_EVERY, ::_EVERY], one.calibration_sigma[::_EVERY, ::_EVERY]) for one in maps]
    fields = [(depth, pixels[np.isfinite(sigma)]) for depth, pixels, sigma in thin if np.isfinite(sigma).any()]
    if not fields:
        return []
    at = np.concatenate([np.full(len(pixels), depth) for depth, pixels in fields])
    moves = depth_gradient(calibration, np.concatenate([pixels for _, pixels in fields]), at) @ factor / at[:, None]
    ends = np.cumsum([len(pixels) for _, pixels in fields])[:-1]
    return [(depth, part) for (depth, _), part in zip(fields, np.split(moves, ends), strict=True)]


def _mean_share(wanted: list[tuple[float, Array]], information: Array) -> float:
    return float(np.mean([_sigmas(moves, information).mean() for _, moves in wanted])) if wanted else 0.0


def _typical(calibration: Calibration, wanted: list[tuple[float, Array]], information: Array) -> float:
    """Return the median standard deviation of depth at the yardstick, or at the map that is nearest to it."""
    depth, moves = min(wanted, key=lambda one: abs(one[0] - yardstick(calibration)))
    return depth * float(np.median(_sigmas(moves, information)))


def _sigmas(gradients: Array, information: Array) -> Array:
    """Return one standard deviation (P,) of what moves by `gradients` (P, r) in units of the present factor."""
    root = np.linalg.cholesky(information)
    return np.asarray(np.linalg.norm(np.linalg.solve(root, gradients.T), axis=0))


def _view(calibration: Calibration, place: Place, shares: tuple[float, float], sigmas: tuple[float, float]) -> NextView:
    return NextView(
        sentence=_sentence(calibration, place),
        place=place,
        unit=calibration.unit,
        depth_of_sigma=yardstick(calibration),
        share_before=shares[0],
        share_after=shares[1],
        sigma_before=sigmas[0],
        sigma_after=sigmas[1],
    )


def _sentence(calibration: Calibration, place: Place) -> str:
    unit = "mm" if calibration.unit == "mm" else "squares"
    if place.about == "vertical":
        side = "right" if place.tilt_deg > 0 else "left"
    else:
        side = "upper" if place.tilt_deg > 0 else "lower"
    tilt = f"tilted {abs(place.tilt_deg):.0f} degrees about the {place.about}, its {side} side towards the cameras"
    facing = tilt if place.about else "facing the cameras"
    about = f"{float(f'{place.depth:.2g}'):g} {unit}"
    return f"Hold the board about {about} away, {_region(calibration, place)} of the left view, {facing}."


def _region(calibration: Calibration, place: Place) -> str:
    """Name the ninth of the left view in which the board's middle lies."""
    x, y, _, _ = calibration.left_view.rectangle(calibration.frame_width, calibration.frame_height)
    size = calibration.left_view.upright_size(calibration.frame_width, calibration.frame_height)
    column, row = np.clip(3 * (place.middle_px - [x, y]) / size, 0, 2).astype(int)
    if (column, row) == (1, 1):
        return "in the middle"
    return (
        f"in the {' '.join(part for part in (('upper', '', 'lower')[row], ('left', '', 'right')[column]) if part)} part"
    )
