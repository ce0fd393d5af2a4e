"""`prismstereo measure`: lengths in a scene, with how far off they may be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.measuring import Measured, Patch, Relief

_PATCH_SIDES, _PIXEL_SIDES = 4, 2


@click.command(
    "measure",
    epilog="Examples:  prismstereo measure desk --points 210,300 420,310\n\n"
    "           prismstereo measure frame.png --calibration unit.json --height-over 300,500,120,80 --at 340,420 --json",
)
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Calibration file; a session and a recording have their own."
)
@click.option("--points", nargs=2, metavar="X,Y X,Y", help="Distance between what two pixels show.")
@click.option("--plane", metavar="X,Y,W,H", help="The plane that most of a patch lies on.")
@click.option("--sphere", metavar="X,Y,W,H", help="The ball that a patch shows.")
@click.option("--height-over", metavar="X,Y,W,H", help="The plane of this patch is the ground for --at.")
@click.option("--at", metavar="X,Y", help="The pixel whose height over that plane is measured.")
@click.option("--frame", "number", default=0, show_default=True, type=click.IntRange(0), help="Which frame, from 0.")
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP)
@matching_options
@json_option
def command(
    source: Path, calibration: Path | None, points: tuple[str, str] | None, plane: str | None, sphere: str | None,
    height_over: str | None, at: str | None, number: int, range_mm: str | None, matching: Matching, as_json: bool,
) -> None:  # fmt: skip
    """Measure in one frame of SOURCE: a session folder, a picture, or an MCAP recording.

    Pixels are those of the rectified left picture, as `depth` and the viewer show it. Each length comes with one standard
    deviation: of the matches, and of the calibration where it says how well it is known.
    """
    wish = _wish(points, plane, sphere, height_over, at)
    relief = _relief(source, calibration, matching, range_mm, number)
    found = wish.measured(relief)
    say({"source": source, "frame": number, **found.told}, found.lines, as_json=as_json)


@dataclass(frozen=True, slots=True)
class _Found:
    """A result as an object and as lines."""

    told: dict[str, object]
    lines: list[str]


@dataclass(frozen=True, slots=True)
class _Wish:
    """What is to be measured, and where."""

    what: str
    patch: Patch | None
    pixels: tuple[tuple[float, float], ...]

    def measured(self, relief: Relief) -> _Found:
        """Measure it."""
        from prismstereo.measuring import distance, fit_plane, height_over

        if self.patch is None:
            length = distance(relief, *self.pixels)
            return _Found({"what": self.what, **_object(length)}, [f"distance {_line(length)}"])
        if self.what == "sphere":
            return _sphere(relief, self.patch)
        plane = fit_plane(relief, self.patch)
        ground: dict[str, object] = {
            "plane_distance": _object(plane.distance),
            "normal": plane.normal.tolist(),
            "tilt_deg": plane.tilt_deg,
            "tilt_sigma_deg": plane.tilt_sigma_deg,
            "rms_mm": plane.rms_mm,
            "rms_px": plane.rms_px,
            "pixels": plane.pixels,
            "share": plane.share,
        }
        lines = [
            f"plane {_line(plane.distance)} from the left pinhole, tilted {plane.tilt_deg:.3f} +- "
            f"{plane.tilt_sigma_deg:.3f} deg, rms {plane.rms_mm:.4g} mm ({plane.rms_px:.3f} px) of {plane.pixels} pixels"
        ]
        if not self.pixels:
            return _Found({"what": self.what, **_object(plane.distance), **ground}, lines)
        height = height_over(relief, plane, self.pixels[0])
        return _Found({"what": self.what, **_object(height), **ground}, [*lines, f"height {_line(height)}"])


def _sphere(relief: Relief, patch: Patch) -> _Found:
    from prismstereo.measuring import fit_sphere

    ball = fit_sphere(relief, patch)
    told: dict[str, object] = {
        "what": "sphere",
        **_object(ball.radius),
        "centre_mm": ball.centre.tolist(),
        "centre_distance": _object(ball.distance),
        "rms_mm": ball.rms_mm,
        "rms_px": ball.rms_px,
        "pixels": ball.pixels,
        "share": ball.share,
    }
    x, y, z = ball.centre
    return _Found(
        told,
        [
            f"radius {_line(ball.radius)}",
            f"centre {x:.3f}, {y:.3f}, {z:.3f} mm, {_line(ball.distance)} from the left pinhole, rms {ball.rms_mm:.4g} mm "
            f"({ball.rms_px:.3f} px) of {ball.pixels} pixels",
        ],
    )


def _object(found: Measured) -> dict[str, object]:
    return {
        "value_mm": found.value_mm,
        "sigma_mm": found.sigma_mm,
        "matching_mm": found.matching_mm,
        "calibration_mm": found.calibration_mm,
    }


def _line(found: Measured) -> str:
    known = "" if found.calibration_mm is not None else ", the calibration does not say how well it is known"
    return f"{found.value_mm:.3f} +- {found.sigma_mm:.3f} mm{known}"


def _wish(
    points: tuple[str, str] | None, plane: str | None, sphere: str | None, over: str | None, at: str | None
) -> _Wish:  # fmt: skip
    given = [
        name
        for name, one in zip(("points", "plane", "sphere", "height"), (points, plane, sphere, over), strict=True)
        if one
    ]
    if len(given) != 1:
        raise UsageError("say what to measure: one of --points, --plane, --sphere, or --height-over with --at")
    if (at is None) != (over is None):
        raise UsageError("--height-over and --at go together: the patch is the ground, the pixel what stands on it")
    if points:
        return _Wish("distance", None, tuple(_pixel(one) for one in points))
    name, text = next(
        (name, one) for name, one in (("--plane", plane), ("--sphere", sphere), ("--height-over", over)) if one
    )
    return _Wish(given[0], _patch(name, text), () if at is None else (_pixel(at),))


def _patch(option: str, text: str) -> Patch:
    from prismstereo.measuring import Patch

    sides = [side.strip() for side in text.split(",")]
    if len(sides) != _PATCH_SIDES or not all(side.isascii() and side.isdigit() for side in sides):
        raise UsageError(f"{option} {text}: give X,Y,WIDTH,HEIGHT in whole pixels, e.g. 100,50,320,240")
    return Patch(*map(int, sides))


def _pixel(text: str) -> tuple[float, float]:
    try:
        sides = [float(side) for side in text.split(",")]
    except ValueError:
        sides = []
    if len(sides) != _PIXEL_SIDES:
        raise UsageError(f"point {text}: give X,Y in pixels of the rectified left picture, e.g. 210,300")
    return sides[0], sides[1]


def _relief(source: Path, calibration: Path | None, matching: Matching, range_mm: str | None, number: int) -> Relief:
    from prismstereo.measuring import Relief
    from prismstereo.measuring.frames import open_frames

    matcher = matching.create() if matching.matcher or source.suffix.lower() != ".mcap" else None
    opened = open_frames(source, calibration, matcher, matching.chain(), parse_range(range_mm, 1024))
    found = next(iter(opened.frames(number, number + 1)), None)
    if found is None:
        raise UsageError(f"{source} has no frame {number}: count them from 0")
    return Relief.of_frame(found.depth)
