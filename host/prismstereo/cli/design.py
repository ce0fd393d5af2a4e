"""`prismstereo design`: what the optics of a rig give, or the rig for a wish."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, parse_range, say
from prismstereo_hw.errors import RigError, UsageError

if TYPE_CHECKING:
    from prismstereo_hw.design.designer import Design
    from prismstereo_hw.rig import Rig

_DEFAULT_RANGE = "400:inf"
_MOST_LABELS = 1024


@dataclass(frozen=True, slots=True)
class _Wish:
    """The flags, as they were given."""

    camera: str | None
    baseline_mm: float | None
    range_mm: str | None
    labels: int | None
    glass: str | None

    @property
    def empty(self) -> bool:
        return all(value is None for value in (self.camera, self.baseline_mm, self.range_mm, self.labels, self.glass))


@click.command(
    "design", epilog="Example:  prismstereo design --camera oak-1 --baseline-mm 60 -o my-rig.toml --svg rays.svg"
)
@click.argument("rig", required=False)
@click.option("--camera", help="Design a rig for a camera of the catalogue (see --cameras).")
@click.option("--baseline-mm", type=float, help="Baseline wished for; with RIG, its camera gets a new rig.")
@click.option(
    "--range-mm", metavar="A:Z", help=f"Depths wished for in mm, Z may be inf. Default: {_DEFAULT_RANGE}, or RIG's."
)
@click.option(
    "--max-disparity", "labels", type=click.IntRange(16, 1024), help="Search labels 0..N-1. Default: as needed."
)
@click.option("--glass", help="Glass of the prism by name, or its index. Default: N-BK7, or RIG's.")
@click.option("--out", "-o", type=click.Path(path_type=Path), help="Rig file to write.")
@click.option("--svg", type=click.Path(path_type=Path), help="Ray drawing to write.")
@click.option("--toml", "as_toml", is_flag=True, help="Print the rig file itself: a start for your own.")
@click.option("--cameras", "catalogue", is_flag=True, help="List the cameras that can be designed for.")
@json_option
def command(
    rig: str | None, camera: str | None, baseline_mm: float | None, range_mm: str | None, labels: int | None,
    glass: str | None, out: Path | None, svg: Path | None, as_toml: bool, catalogue: bool, as_json: bool,
) -> None:  # fmt: skip
    """Print the figures of RIG, or of the rig for a wish.

    RIG is dslr-35mm, oak-1, pi-camera-v2, or the path of a rig file.
    """
    if catalogue:
        _list_cameras(as_json=as_json)
        return
    built, design = _rig(
        rig, _Wish(camera, baseline_mm, range_mm, labels, glass), "my-rig" if out is None else out.stem
    )
    _write(built, out, svg)
    if as_toml:
        click.echo(built.toml(), nl=False)
        return
    _report(built, design, {"out": out, "svg": svg}, as_json=as_json)


def _list_cameras(*, as_json: bool) -> None:
    from prismstereo_hw.catalogue import cameras

    rows = [
        {
            "name": name,
            "title": entry.title,
            "sensor": entry.sensor,
            "sensor_width_mm": entry.sensor_width_mm,
            "focal_mm": entry.focal_mm,
            "f_number": entry.f_number,
            "hfov_deg": entry.hfov_deg,
            "pupil_to_prism_mm": entry.pupil_to_prism_mm,
            "sources": entry.sources,
        }
        for name, entry in cameras().items()
    ]
    lines = [f"{row['name']:14s} {row['hfov_deg']:5.1f} deg  {row['title']} ({row['sensor']})" for row in rows]
    say({"cameras": rows}, lines, as_json=as_json)


def _rig(name: str | None, wish: _Wish, new_name: str) -> tuple[Rig, Design | None]:
    """Return the rig that is meant; its design too if it is new, or of the kind that can be designed."""
    from prismstereo_hw.design.designer import examine
    from prismstereo_hw.kinds.prism_tir import PrismRig
    from prismstereo_hw.rig import Rig

    if name is None:
        new = _for_camera(wish, new_name)
        return new.rig, new
    if wish.camera is not None:
        raise UsageError(f"RIG {name!r} has a camera already: give RIG or --camera {wish.camera}, not both")
    found: Rig = Rig.read(name)
    if not isinstance(found, PrismRig):
        if not wish.empty:
            raise RigError(
                f"rig {found.name!r} is no prism rig, and only those can be designed: change its file by hand"
            )
        return found, None
    new = examine(found) if wish.empty else _redesigned(found, wish, new_name)
    return new.rig, new


def _for_camera(wish: _Wish, name: str) -> Design:
    from prismstereo_hw.catalogue import camera, cameras
    from prismstereo_hw.design.designer import design

    if wish.camera is None:
        raise UsageError(
            "say what to design: a RIG, or --camera and --baseline-mm (cameras: " + ", ".join(cameras()) + ")"
        )
    if wish.baseline_mm is None:
        raise UsageError(f"--camera {wish.camera} needs --baseline-mm: the distance of the two views, 50 for example")
    entry, wanted = camera(wish.camera), parse_range(wish.range_mm or _DEFAULT_RANGE, _MOST_LABELS)
    assert wanted is not None
    return design(
        entry.camera, wish.baseline_mm, wanted.near_mm, wanted.far_mm, wish.labels, wish.glass or "N-BK7",
        pupil_to_prism_mm=entry.pupil_to_prism_mm, name=name,
    )  # fmt: skip


def _redesigned(rig: Rig, wish: _Wish, name: str) -> Design:
    """Design anew for the camera of a rig; what is not wished for stays."""
    from prismstereo_hw.design.designer import design
    from prismstereo_hw.kinds.prism_tir import PrismRig
    from prismstereo_hw.optics.figures import figures

    assert isinstance(rig, PrismRig)
    wanted = parse_range(wish.range_mm, _MOST_LABELS) or rig.range
    baseline = figures(rig).baseline_mm if wish.baseline_mm is None else wish.baseline_mm
    return design(
        rig.camera, baseline, wanted.near_mm, wanted.far_mm, wish.labels, wish.glass or rig.prism.glass,
        pupil_to_prism_mm=rig.prism.pupil_to_prism_mm, name=name,
    )  # fmt: skip


def _write(rig: Rig, out: Path | None, svg: Path | None) -> None:
    from prismstereo_hw.files import write_whole

    if svg is not None:
        write_whole(svg, _drawn(rig).encode())
    if out is not None:
        write_whole(out, rig.toml().encode())


def _drawn(rig: Rig) -> str:
    from prismstereo_hw.kinds.prism_tir import PrismRig
    from prismstereo_hw.sketch.drawing import draw
    from prismstereo_hw.sketch.ray_drawing import draw_rays

    return draw(rig) if isinstance(rig, PrismRig) else draw_rays(rig)


def _report(rig: Rig, design: Design | None, files: dict[str, Path | None], *, as_json: bool) -> None:
    from prismstereo.cli.design_lines import design_lines, figure_lines
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.rectification import rectification
    from prismstereo_hw.optics.figures import figures

    found = figures(rig) if design is None else design.figures
    window = rectification(Calibration.nominal(rig)).window
    result: dict[str, object] = {
        **asdict(found),
        "range_min_mm": window.nearest,
        "range_max_mm": window.farthest,
        "labels": window.labels,
    }
    lines = figure_lines(rig, found, window)
    if design is not None:
        result |= {
            "limits": [asdict(limit) for limit in design.limits],
            "sensitivities": asdict(design.sensitivities),
            "box": asdict(design.box),
            "assembly": asdict(design.assembly),
        }
        lines += design_lines(design)
    written = {kind: path for kind, path in files.items() if path is not None}
    say(result | written, [*lines, *(f"wrote {path}" for path in written.values())], as_json=as_json)
