"""`prismstereo refine`: mend a calibration whose mirrors crept, from ordinary scenes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.upkeep.pose_fit import KnownDepth
    from prismstereo_calibration.upkeep.refine import Refinement
    from prismstereo_calibration.upkeep.sightlines import SceneMatches

_ENOUGH = 0.003  # of the depth: what a refined calibration should be good to


@click.command(
    "refine",
    epilog="Examples:  prismstereo refine scenes/*.png --calibration unit.json --known-distance-mm 1200 -o unit.json\n\n"
    "           prismstereo refine --restore -o unit.json",
)
@click.argument("frames", nargs=-1, type=click.Path(path_type=Path))
@click.option("--calibration", type=click.Path(path_type=Path), help="Calibration file of the unit.")
@click.option("--rig", help="The unit's rig, where the calibration does not name a built-in one: a rig file.")
@click.option(
    "--known-distance-mm",
    type=float,
    help="Depth, as depth maps have it, of a plane that faces the unit and fills the first of FRAMES.",
)
@click.option(
    "--at", metavar="X,Y", help="The known depth is that of this raw-frame pixel (left viewpoint) of the first frame."
)
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Calibration file to write.")
@click.option("--restore", is_flag=True, help="Go back: exchange the file and the former one kept beside it.")
@json_option
def command(
    frames: tuple[Path, ...], calibration: Path | None, rig: str | None, known_distance_mm: float | None,
    at: str | None, out: Path, restore: bool, as_json: bool,
) -> int:  # fmt: skip
    """Update the pose of a calibrated unit from FRAMES of ordinary textured scenes.

    The result is judged on frames that were held back, and written only where it is better there; the former calibration is
    kept beside it. Exit code 1 when it is not better: then nothing is written. Without a known distance the convergence
    of the views, and with it the scale of depth, is touched only where the rows surely show that it changed.
    """
    from prismstereo_calibration.store import read
    from prismstereo_calibration.upkeep.mount import mount_for
    from prismstereo_calibration.upkeep.refine import refine
    from prismstereo_calibration.upkeep.slot import keep_and_write

    if restore:
        _restore(out, as_json=as_json, other=bool(frames) or calibration is not None)
        return 0
    if not frames or calibration is None:
        raise UsageError("give FRAMES and the unit's calibration: prismstereo refine scenes/*.png --calibration C -o C")
    if at is not None and known_distance_mm is None:
        raise UsageError("--at says where a known distance is: give --known-distance-mm too")
    unit = read(calibration)
    if known_distance_mm is not None and unit.unit != "mm":
        raise UsageError(
            f"{calibration} is in squares of a board, so it knows no millimetres: calibrate with --square-mm"
        )
    scenes = _matched(unit, frames)
    known = _known(unit, scenes[0], known_distance_mm, at)
    found = refine(unit, scenes, mount_for(unit, rig), known)
    former = keep_and_write(out, found.calibration, calibration) if found.better else None
    say(_object(found, unit, out, former), _lines(found, unit, out, former), as_json=as_json)
    return 0 if found.better else 1


def _restore(out: Path, *, as_json: bool, other: bool) -> None:
    from prismstereo_calibration.upkeep.slot import former_of, restore

    if other:
        raise UsageError("--restore goes with -o alone: prismstereo refine --restore -o unit.json")
    back = restore(out)
    lines = [f"{out}: the former calibration is in use again; the one given up is {former_of(out)}"]
    length = "baseline_mm" if back.unit == "mm" else "baseline_squares"
    result = {"out": out, "former": former_of(out), "restored": True, length: back.baseline}
    say(result, lines, as_json=as_json)


def _matched(unit: Calibration, frames: tuple[Path, ...]) -> list[SceneMatches]:
    from prismstereo.frames import expand, named_frames
    from prismstereo_calibration.upkeep.matcher import SceneMatcher

    matcher, count = SceneMatcher(unit), len(expand(frames))
    return [matcher.match(name, frame) for name, frame in with_progress(named_frames(frames), count, "matching")]


def _known(unit: Calibration, scene: SceneMatches, distance_mm: float | None, at: str | None) -> KnownDepth | None:
    from prismstereo_calibration.upkeep.known_distance import known_distance

    return None if distance_mm is None else known_distance(unit, scene, distance_mm, _pixel(at))


def _pixel(at: str | None) -> tuple[float, float] | None:
    if at is None:
        return None
    x, _, y = at.partition(",")
    try:
        return float(x), float(y)
    except ValueError:
        raise UsageError(f"--at {at!r}: give the column and the row of a raw-frame pixel, e.g. 960,360") from None


def _object(found: Refinement, unit: Calibration, out: Path, former: Path | None) -> dict[str, object]:
    suffix = "mm" if unit.unit == "mm" else "squares"
    return {
        "better": found.better,
        "reason": found.reason,
        "scenes": found.scenes,
        "matches": found.matches,
        "rows_before_px": found.rows_before_px,
        "rows_after_px": found.rows_after_px,
        "gain_sigmas": found.gain_sigmas,
        "turn_deg": found.turn_deg,
        f"baseline_change_{suffix}": found.baseline_change,
        f"at_depth_{suffix}": found.at_depth,
        "depth_change_percent": 100 * found.depth_change,
        "depth_sigma_percent": 100 * found.depth_sigma,
        "convergence": found.convergence,
        "known_error_before_percent": 100 * found.known_before,
        "known_error_after_percent": 100 * found.known_after,
        "moves": {move.way: {"amount": move.amount, "sigma": move.sigma} for move in found.moves},
        "out": out if found.better else None,
        "former": former,
    }


def _lines(found: Refinement, unit: Calibration, out: Path, former: Path | None) -> list[str]:
    depth = f"{found.at_depth:.4g} {unit.unit}"
    lines = [
        f"{found.matches} points in {found.scenes} scenes",
        f"  rows, held back     {found.rows_before_px:.3f} -> {found.rows_after_px:.3f} px "
        f"({found.gain_sigmas:.1f} standard errors better)",
        f"  pose                turned by {found.turn_deg:.3f} deg, baseline {found.baseline_change:+.3f} {unit.unit}",
        f"  depth               at {depth} {100 * found.depth_change:+.2f} %, good to {100 * found.depth_sigma:.2f} %; "
        f"convergence {found.convergence}",
    ]
    if found.known_before == found.known_before:  # a number
        lines.append(
            f"  known distance      off by {100 * found.known_before:+.2f} % -> {100 * found.known_after:+.2f} %"
        )
    elif found.depth_sigma > _ENOUGH:
        lines.append("  a known distance (--known-distance-mm) would make depths surer")
    if found.better:
        return [*lines, f"{out}: refined; the former calibration is {former}"]
    return [*lines, f"nothing was written: {found.reason}"]
