"""`prismstereo convert`: a calibration in the files of ROS, OpenCV, Kalibr, Luxonis or COLMAP, and back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, parse_range, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_calibration.convert.pair import StereoPairModel
    from prismstereo_calibration.model import Calibration
    from prismstereo_hw.rig import RangeWish, Rig
    from prismstereo_hw.view import View

_FORMATS = ("ros", "opencv", "kalibr", "luxonis", "colmap")
_LABELS = 128


@click.command("convert", epilog="Example:  prismstereo convert calibration.json --to ros -o camera_info")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--to", "target", type=click.Choice(_FORMATS), help="Format to write.")
@click.option("--from", "source", type=click.Choice(_FORMATS), help="Format of FILES, to make a calibration of them.")
@click.option("--rig", help="With --from: the unit's rig, for its views and range: a built-in name, or a rig file.")
@click.option("--layout", help="With --from: side-by-side, swapped, top-bottom, bottom-top, instead of a rig.")
@click.option(
    "--range-mm", "range_mm", metavar="A:Z", help="With --from: depths wished for, A:Z in mm. Default: the rig's."
)
@click.option("--frame-px", metavar="WxH", help="With --from: the raw frame's size, where the files do not tell it.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="File, or for ros and colmap folder.")
@json_option
def command(
    files: tuple[Path, ...], target: str | None, source: str | None, rig: str | None, layout: str | None,
    range_mm: str | None, frame_px: str | None, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Convert a calibration: FILES is calibration.json with --to, the files of another program with --from.

    Others take the two views as two cameras with pictures of their own, cut out of the raw frame and set upright.
    """
    if (target is None) == (source is None):
        raise UsageError("say which way: --to FORMAT for a calibration, or --from FORMAT for files of that format")
    if target is not None:
        if rig or layout or range_mm or frame_px:
            raise UsageError("--rig, --layout, --range-mm and --frame-px go with --from: a calibration knows its own")
        _write(files, target, out, as_json=as_json)
    if source is not None:
        _read(files, source, _Wishes(rig, layout, range_mm, frame_px), out, as_json=as_json)


@dataclass(frozen=True, slots=True)
class _Wishes:
    """What the command line says beyond the files."""

    rig: str | None
    layout: str | None
    range_mm: str | None
    frame_px: str | None


def _write(files: tuple[Path, ...], form: str, out: Path, *, as_json: bool) -> None:
    from prismstereo_calibration.convert.formats import FORMATS
    from prismstereo_calibration.convert.pair import pair_of
    from prismstereo_calibration.store import read
    from prismstereo_hw.files import write_whole

    if len(files) != 1:
        raise UsageError(f"{len(files)} files given: --to takes one calibration file")
    chosen, calibration = FORMATS[form], read(files[0])
    pair = pair_of(calibration)
    export = chosen.write(pair)
    written = [out / name for name in export.files] if chosen.folder else [out]
    for path, content in zip(written, export.files.values(), strict=True):
        write_whole(path, content)
    notes = [*export.notes, *_left_out(pair), *(_view_note(calibration, index) for index in range(2))]
    for note in notes:
        click.echo(f"note: {note}", err=True)
    result: dict[str, object] = {
        "format": form,
        "files": written,
        "lengths_in": chosen.unit if calibration.unit == "mm" else "squares",
        "residual_px": export.residual_px,
        "glass_rms_px": pair.glass_rms_px,
        "notes": notes,
    }
    say(result, [f"wrote {path}" for path in written], as_json=as_json)


def _left_out(pair: StereoPairModel) -> list[str]:
    kept = (
        "the range, the views' places in the frame, and what is known of the uncertainty stay in the calibration file"
    )
    if not pair.glass_shift:
        return [kept]
    return [
        kept,
        f"the glass before the lens has no place in this format: the pinholes that come nearest miss by "
        f"{pair.glass_rms_px:.3f} px rms, and the left one stands {pair.glass_shift:.2f} {pair.unit} further along its axis",
    ]


def _view_note(calibration: Calibration, index: int) -> str:
    view, side = calibration.views[index], ("left", "right")[index]
    x, y, w, h = view.rectangle(calibration.frame_width, calibration.frame_height)
    attitude = f", turned {view.turn_deg} degrees counter-clockwise" if view.turn_deg else ""
    attitude += ", then mirrored left-right" if view.mirrored else ""
    attitude += f", one row in {view.row_step} from row {view.row_start} on" if view.row_step > 1 else ""
    attitude += f", of exposure {view.exposure}" if view.exposures > 1 else ""
    return f"the {side} camera's picture is {w}x{h} px cut out of the raw frame at {x}, {y}{attitude}"


def _read(files: tuple[Path, ...], form: str, wishes: _Wishes, out: Path, *, as_json: bool) -> None:
    from prismstereo_calibration.convert.formats import FORMATS
    from prismstereo_calibration.store import write

    rig, views = _views(wishes)
    wish = parse_range(wishes.range_mm, rig.range.labels if rig else _LABELS)
    pair = FORMATS[form].read(files)
    if wish is None and rig is not None and pair.unit == "mm":
        wish = rig.range
    named = ", ".join(map(str, files))
    calibration = _calibration(pair, views, wish, wishes, rig, named)
    write(out, calibration)
    notes = [*pair.assumed, _taken(calibration, wishes), *_glass_note(rig)]
    for note in notes:
        click.echo(f"note: {note}", err=True)
    result: dict[str, object] = {
        "format": form,
        "out": out,
        f"baseline_{'mm' if calibration.unit == 'mm' else 'squares'}": calibration.baseline,
        "frame_width_px": calibration.frame_width,
        "frame_height_px": calibration.frame_height,
        "model": calibration.model,
        "notes": notes,
    }
    say(result, [f"wrote {out}: baseline {calibration.baseline:.3f} {calibration.unit}"], as_json=as_json)


def _views(wishes: _Wishes) -> tuple[Rig | None, tuple[View, View]]:
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.view import layout

    if (wishes.rig is None) == (wishes.layout is None):
        raise UsageError("these files do not tell where the views lie: give --rig oak-1, or --layout side-by-side")
    if wishes.rig is not None:
        built = Rig.read(wishes.rig)
        return built, built.views
    return None, layout(wishes.layout or "")


def _calibration(
    pair: StereoPairModel,
    views: tuple[View, View],
    wish: RangeWish | None,
    wishes: _Wishes,
    rig: Rig | None,
    named: str,
) -> Calibration:
    """Put the pair into a frame; whatever is wrong with its numbers is said of the files they come from."""
    from prismstereo_calibration.convert.frame_size import frame_size
    from prismstereo_calibration.convert.pair import calibration_of
    from prismstereo_calibration.errors import CalibrationError

    own = (rig.camera.video.width, rig.camera.video.height) if rig else None
    try:
        frame = frame_size(pair, views, own, _size(wishes.frame_px))
        return calibration_of(pair, views, frame, wish, rig.name if rig else wishes.layout or "")
    except CalibrationError as error:
        raise CalibrationError(f"{named}: {error}") from error


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    if not (width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise UsageError(f"--frame-px {text!r}: give width and height of the raw frame as WxH, e.g. 1280x720")
    return int(width), int(height)


def _taken(calibration: Calibration, wishes: _Wishes) -> str:
    """Say where that comes from which other formats do not know."""
    near, far = calibration.range.near_mm, calibration.range.far_mm
    origin = wishes.rig or wishes.layout
    return (
        f"views and name are those of {origin}, in a frame of {calibration.frame_width}x{calibration.frame_height} px; the "
        f"range {near:g}:{far:g} {calibration.unit} is from "
        f"{'--range-mm' if wishes.range_mm else wishes.rig or f'the {calibration.range.labels} labels searched'}"
    )


def _glass_note(rig: Rig | None) -> list[str]:
    from prismstereo_calibration.nominal import nominal_plate

    if rig is None or nominal_plate(rig) is None:
        return []
    return [
        "the rig has glass, but this format knows pinholes only, and so does the new calibration: calibrate the unit for better"
    ]
