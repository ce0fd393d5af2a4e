"""Compositions with truth: an object cut from one picture stands on another in the still, and elsewhere in the video frame.

Dead leaves (discs, boxes and fine grain of all sizes) stand for the statistics of real pictures. Everything is drawn at the
still's resolution; the video is that, blurred by motion, shaken, brightened, reduced, made noisy and compressed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.grid import Grid

Float = NDArray[np.float32]
Picture = NDArray[np.uint8]
Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mover:
    """One object: opacity in the still and in the video's true still-size picture, and the motion between them."""

    in_still: Float
    in_frame: Float
    frame_from_still: Matrix  # 3x3, still pixels


@dataclass(frozen=True, slots=True)
class Composition:
    """Pictures of one instant of video and of a still, and the truth behind them."""

    background_still: Picture
    background_video: Picture
    still: Picture
    frame: Picture
    sharp_frame: Picture  # what a still at the instant of the frame would have been
    movers: tuple[Mover, ...]
    grid: Grid

    def object_in_frame(self) -> NDArray[np.bool_]:
        """Tell which video pixels an object covers."""
        together = np.max([mover.in_frame for mover in self.movers], axis=0)
        height, width = self.frame.shape[:2]
        return np.asarray(cv2.resize(together, (width, height), interpolation=cv2.INTER_AREA) > 0.5)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What happens in a composition: lengths in video pixels, angles in degrees."""

    seed: int = 0
    video: tuple[int, int] = (320, 400)
    scale: float = 2.5
    shift_px: tuple[float, float] = (70.0, 16.0)
    turn_deg: float = 10.0
    grow: float = 1.04
    tilt: float = 0.0  # perspective: change of size across the object, as a share
    shadow: float = 0.45
    gain: float = 1.15
    blur_px: float = 5.0
    shake_px: float = 0.0
    noise: float = 2.0
    quality: int = 88
    textured: bool = True
    second: bool = False
    occluder: bool = False
    size: float = 0.3  # of the object, as a share of the height


BASE = Recipe()


def variant(**changes: object) -> Recipe:
    """Return the base recipe with changes."""
    return replace(BASE, **changes)


def leaves(height: int, width: int, seed: int, *, coarse: float = 1.0) -> Float:
    """Draw dead leaves, (height, width, 3) float32 grey levels."""
    rng = np.random.default_rng(seed)
    picture = np.full((height, width, 3), 120, np.float32)
    count = int(1500 * height * width / 640_000 / coarse)
    sizes = np.sort(8 * coarse * (1 / np.maximum(rng.random(count), 1e-3)) ** 0.7)[::-1]
    for size in sizes:
        centre = tuple(int(v) for v in rng.integers(0, (width, height)))
        base = rng.uniform(35, 210)
        colour = tuple(float(v) for v in np.clip(base + rng.normal(0, 25, 3), 10, 245))
        angle = float(rng.uniform(0, 180))
        axes = (max(2, int(size)), max(2, int(size * rng.uniform(0.4, 1))))
        if rng.random() < 0.5:
            cv2.ellipse(picture, centre, axes, angle, 0, 360, colour, -1, cv2.LINE_8)
        else:
            corners = cv2.boxPoints(((float(centre[0]), float(centre[1])), axes, angle))
            cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_8)
    grain = rng.normal(0, 1, (height, width)).astype(np.float32)
    picture += (14 * cv2.GaussianBlur(grain, (0, 0), 1.2) + 30 * cv2.GaussianBlur(grain, (0, 0), 4))[..., None]
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), 0, 255)


def blob(size: int, seed: int) -> Float:
    """Draw the opacity (size, size) float32 of a smooth, lopsided shape."""
    rng = np.random.default_rng([seed, 7])
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    radius = np.ones_like(angle)
    for wave in range(2, 6):
        radius += 0.25 / wave * np.cos(wave * angle + rng.uniform(0, 2 * np.pi))
    radius *= 0.46 * size / radius.max()
    points = size / 2 + np.stack([radius * np.cos(angle), 0.9 * radius * np.sin(angle)], axis=-1)
    canvas = np.zeros((4 * size, 4 * size), np.uint8)
    cv2.fillPoly(canvas, [np.rint(4 * points).astype(np.int32)], 255)
    return np.asarray(cv2.resize(canvas, (size, size), interpolation=cv2.INTER_AREA) / np.float32(255), np.float32)


def moved(shift: tuple[float, float], turn_deg: float, grow: float, centre: NDArray[np.float64], tilt: float) -> Matrix:
    """Return the motion (3, 3) about a centre: turned, grown, shifted, and seen at a slant."""
    angle = np.radians(turn_deg)
    R = grow * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    t = np.asarray(shift) + centre - R @ centre
    similar = np.vstack([np.column_stack([R, t]), [0, 0, 1]])
    to = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1]])
    slant = np.array([[1, 0, 0], [0, 1 - abs(tilt) * 0.3, 0], [tilt, 0, 1.0]]) if tilt else np.eye(3)
    return np.asarray(similar @ np.linalg.inv(to) @ slant @ to)


def _placed(ground: Float, skin: Float, opacity: Float, M: Matrix, shadow: float) -> tuple[Float, Float]:
    height, width = ground.shape[:2]
    over = cv2.warpPerspective(skin, M, (width, height), flags=cv2.INTER_CUBIC)
    share = np.clip(cv2.warpPerspective(opacity, M, (width, height), flags=cv2.INTER_LINEAR), 0, 1)
    if shadow > 0:
        step = height // 30
        dark = cv2.GaussianBlur(np.roll(share, (step, step), (0, 1)), (0, 0), height / 100)
        ground = ground * (1 - shadow * dark)[..., None]
    return ground * (1 - share[..., None]) + over * share[..., None], share


def _to_video(picture: Float, recipe: Recipe, gain: float, rng: np.random.Generator) -> Picture:
    height, width = recipe.video
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA) * gain
    small = small + rng.normal(0, recipe.noise, small.shape)
    packed = cv2.imencode(".jpg", np.clip(small, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, recipe.quality])[
        1
    ]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def compose(recipe: Recipe = BASE) -> Composition:
    """Make the pictures of a recipe."""
    rng = np.random.default_rng(recipe.seed)
    s = recipe.scale
    height, width = round(recipe.video[0] * s), round(recipe.video[1] * s)
    ground = leaves(height, width, 100 + recipe.seed)
    still, sharp, movers = ground, ground, []
    starts = [(0.2, 0.35, recipe.shift_px, recipe.turn_deg, recipe.grow)]
    if recipe.second:
        starts.append((0.72, 0.2, (-0.7 * recipe.shift_px[0], 2 * recipe.shift_px[1]), -8.0, 0.97))
    for number, (left, top, shift, turn, grow) in enumerate(starts):
        size = int(recipe.size * height * (1 if number == 0 else 0.8))
        opacity = blob(size, recipe.seed + 31 * number)
        skin = leaves(size, size, 500 + recipe.seed + number, coarse=0.6) if recipe.textured else _plain(size)
        corner = np.array([left * width, top * height])
        start = np.array([[1, 0, corner[0]], [0, 1, corner[1]], [0, 0, 1.0]])
        tilt = recipe.tilt / size
        M = moved((s * shift[0], s * shift[1]), turn, grow, corner + size / 2, tilt)
        still, before = _placed(still, skin, opacity, start, recipe.shadow)
        sharp, after = _placed(sharp, skin, opacity, M @ start, recipe.shadow)
        movers.append(Mover(before, after, M))
    if recipe.occluder:
        sharp, movers = _hidden(sharp, ground, movers, recipe)
    frame = _streaked(sharp, movers, recipe.blur_px * s)
    if recipe.shake_px:
        S = np.array([[1, 0, s * recipe.shake_px], [0, 1, -0.6 * s * recipe.shake_px]])
        frame, sharp = (cv2.warpAffine(p, S, (width, height), borderMode=cv2.BORDER_REFLECT) for p in (frame, sharp))
        movers = [replace(m, in_frame=cv2.warpAffine(m.in_frame, S, (width, height)),
                          frame_from_still=np.vstack([S, [0, 0, 1]]) @ m.frame_from_still) for m in movers]  # fmt: skip
    as_bytes = [np.clip(p, 0, 255).astype(np.uint8) for p in (ground, still, sharp)]
    return Composition(
        as_bytes[0], _to_video(ground, recipe, 1.0, rng), as_bytes[1], _to_video(frame, recipe, recipe.gain, rng),
        as_bytes[2], tuple(movers), Grid.between(recipe.video, (height, width)),
    )  # fmt: skip


def _plain(size: int) -> Float:
    rows, columns = np.mgrid[:size, :size] / size
    return np.dstack([60 + 15 * columns, 70 + 15 * rows, 170 + 10 * columns]).astype(np.float32)


def _hidden(sharp: Float, ground: Float, movers: list[Mover], recipe: Recipe) -> tuple[Float, list[Mover]]:
    """Let a part of the background stand before the first object in the frame: it went behind something."""
    _, columns = np.nonzero(movers[0].in_frame > 0.5)
    begin = int(np.percentile(columns, 40))
    end = int(np.percentile(columns, 65))
    sharp = sharp.copy()
    sharp[:, begin:end] = ground[:, begin:end]
    hidden = [mover.in_frame.copy() for mover in movers]
    for share in hidden:
        share[:, begin:end] = 0
    return sharp, [replace(mover, in_frame=share) for mover, share in zip(movers, hidden, strict=True)]


def _streaked(sharp: Float, movers: list[Mover], length: float) -> Float:
    taps = round(length)
    if taps < 2:
        return sharp
    kernel = np.full((1, taps | 1), 1 / (taps | 1), np.float32)
    opacity = np.max([mover.in_frame for mover in movers], axis=0)
    share = np.clip(4 * cv2.filter2D(opacity, -1, kernel), 0, 1)[..., None]
    return np.asarray(sharp * (1 - share) + cv2.filter2D(sharp, -1, kernel) * share)
