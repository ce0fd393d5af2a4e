"""`prismstereo align`: how a rig stands against its rig file, while its screws can still be turned."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.alignment import Alignment, Figure
    from prismstereo_hw.frame import RawFrame
    from prismstereo_hw.kinds import AnyRig

_MOST_FRAMES = 8  # that are looked at together: more make nothing surer that can be turned with a screw
_TWIN = "twin:"
_MARKS = {"ok": "ok     ", "adjust": "ADJUST ", "unknown": "unknown"}


@click.command(
    "align",
    epilog="Examples:  prismstereo align frames/*.png --rig oak-1 --distance-mm 800 --picture seen.png\n\n"
    "           prismstereo align twin:plane:800 --rig oak-1 --unit tipped.toml",
)
@click.argument("frames", nargs=-1, type=click.Path(path_type=Path))
@click.option("--rig", "wish", help="What the rig should be: dslr-35mm, oak-1, pi-camera-v2, or a rig file.")
@click.option("--unit", help="The simulated unit behind twin:SCENE, as built: a rig file. Default: what it should be.")
@click.option("--distance-mm", type=float, help="Distance of a flat textured target that fills both views.")
@click.option(
    "--picture", type=click.Path(path_type=Path), help="Annotated picture to write: seam, matched rows, figures."
)
@json_option
def command(
    frames: tuple[Path, ...], wish: str | None, unit: str | None, distance_mm: float | None, picture: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Show how the unit that took FRAMES stands against its rig file, and what to turn.

    FRAMES are raw frames, a folder of them, a session, or twin:SCENE for a frame of the optical twin (twin:plane:800). The
    first eight are looked at together. Let the rig look at texture in all of its field. The exit code is 1 when something is
    out of tolerance.
    """
    from prismstereo.alignment import alignment
    from prismstereo_hw.files import write_picture

    rig, taken = _taken(frames, wish, unit)
    found = alignment(taken, rig, distance_mm)
    if picture is not None:
        from prismstereo.alignment_picture import alignment_picture

        write_picture(picture, alignment_picture(taken[0], found))
    result: dict[str, object] = {
        "rig": rig.name,
        "frames": found.frames,
        "matches": found.rows.count,
        "ok": found.ok,
        "figures": {figure.name: _object(figure) for figure in found.figures},
        **({"picture": picture} if picture else {}),
    }
    say(result, _lines(found, rig.name), as_json=as_json)
    click.get_current_context().exit(0 if found.ok else 1)


def _object(figure: Figure) -> dict[str, object]:
    return {
        "value": figure.value,
        "wish": figure.wish,
        "tolerance": figure.tolerance,
        "sigma": figure.sigma,
        "verdict": figure.verdict,
        "mend": figure.mend,
    }


def _lines(found: Alignment, rig: str) -> list[str]:
    lines = [f"{rig}: {found.rows.count} points in both views of {found.frames} frame{'s' if found.frames > 1 else ''}"]
    for figure in found.figures:
        name, _, unit = figure.name.rpartition("_")
        unit = "" if unit == "ratio" else unit
        value = "cannot be told" if math.isnan(figure.value) else f"{figure.value:9.2f} {unit:3}"
        bound = f"{'at most' if figure.at_most else 'wish'} {figure.wish:.2f} +- {figure.tolerance:.2f}"
        lines.append(f"  {_MARKS[figure.verdict]} {name.replace('_', ' '):16} {value}  {bound}")
        if figure.mend:
            lines.append(f"          {figure.mend}")
    lines.append("all in tolerance" if found.ok else "out of tolerance: adjust, then look again")
    return lines


def _taken(frames: tuple[Path, ...], wish: str | None, unit: str | None) -> tuple[AnyRig, list[RawFrame]]:
    """Return the rig as it should be, and frames of the rig as it is."""
    from prismstereo.frames import named_frames
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.session import Session

    if not frames:
        raise UsageError("give raw FRAMES, a session, or twin:SCENE: prismstereo align frames/*.png --rig oak-1")
    first = str(frames[0])
    if first.startswith(_TWIN):
        if len(frames) > 1 or wish is None:
            raise UsageError(f"{first} stands alone, with --rig: prismstereo align {first} --rig oak-1")
        return _simulated(first.removeprefix(_TWIN), wish, unit)
    if unit is not None:
        raise UsageError("--unit is a simulated unit, for twin:SCENE: a real unit is known by its frames")
    if len(frames) == 1 and (frames[0] / "session.toml").is_file():
        session = Session.open(frames[0])
        own = frames[0] / "rig.toml"
        rig = Rig.read(wish or (own if own.is_file() else session.info.rig))
        return rig, list(islice(session.frames("video"), _MOST_FRAMES))
    if wish is None:
        raise UsageError("say what the unit should be: --rig oak-1, or a rig file")
    return Rig.read(wish), [frame for _, frame in islice(named_frames(frames), _MOST_FRAMES)]


def _simulated(scene: str, wish: str, unit: str | None) -> tuple[AnyRig, list[RawFrame]]:
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.scene import named
    from prismstereo_hw.twin import Twin

    rig = Rig.read(wish)
    built = rig if unit is None else Rig.read(unit)
    return rig, [Twin(built, named(built, scene)).frame()]
