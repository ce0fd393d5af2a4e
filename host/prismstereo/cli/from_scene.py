"""`prismstereo calibrate --from-scene`: any textured scene to a rectification without a scale."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from prismstereo.cli.output import say

if TYPE_CHECKING:
    from prismstereo_calibration.boards.detection import NamedFrame
    from prismstereo_calibration.uncalibrated.form_figures import FormFigures
    from prismstereo_calibration.uncalibrated.scene_matches import SceneMatches
    from prismstereo_calibration.uncalibrated.scene_rectification import SceneRectification
    from prismstereo_hw.lens import Lens
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.view import View

__all__ = ["from_scene"]

_MOST_ROW_ERROR_PX = 1.0  # mean over held-back matches, in rectified pixels: beyond, matchers lose fine texture


def from_scene(
    frames: Sequence[NamedFrame],
    views: tuple[View, View],
    rig: Rig | None,
    out: Path,
    *,
    one_lens: bool | None = None,
    most_labels: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    as_json: bool = False,
) -> int:
    """Match the frames' views, find the rectification, write it to `out`, say its figures; return the exit code.

    Exit code 1 when the rows do not fit well enough to match on; the file is written all the same. `one_lens` says for a
    layout whether both views were taken through one lens (default: if one of them is mirrored); a rig always has one.
    `UsageError`, `ImageError` and `CalibrationError` for wishes and pictures of which nothing can be made.
    """
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.rectification import rectification
    from prismstereo_calibration.uncalibrated.scene_fit import MOST_LABELS, fit_scene
    from prismstereo_calibration.uncalibrated.scene_matches import scene_matches
    from prismstereo_calibration.uncalibrated.store import write

    expected = None if rig is None else rectification(Calibration.nominal(rig))
    matches = scene_matches(frames, views, expected, progress)
    made = fit_scene(
        matches,
        rig="" if rig is None else rig.name,
        lens=None if rig is None else _lens(rig, matches),
        one_lens=one_lens,
        most_labels=most_labels or MOST_LABELS,
    )
    write(out, made)
    good = made.scale * made.chosen.row_error_mean_px <= _MOST_ROW_ERROR_PX
    say(_result(made, matches, out), _lines(made, matches, out, good=good), as_json=as_json)
    return 0 if good else 1


def _lens(rig: Rig, matches: SceneMatches) -> Lens:
    """Return the rig's lens in the frames' own pixels: in the mode they were taken in, or in video made larger or smaller."""
    size = matches.frame_width, matches.frame_height
    for mode in (rig.camera.video, rig.camera.still):
        if size == (mode.width, mode.height):
            return rig.lens(mode)
    return rig.lens().scaled(matches.frame_width / rig.camera.video.width)


def _result(made: SceneRectification, matches: SceneMatches, out: Path) -> dict[str, object]:
    return {
        "form": made.form,
        "reason": made.reason,
        **_figures(made.chosen),
        "forms": [{"form": one.form, **_figures(one)} for one in made.figures],
        "matches": made.matches,
        "frames_used": matches.frames,
        "frames_rejected": [{"file": one.name, "reason": one.reason} for one in matches.rejected],
        "width_px": made.width,
        "height_px": made.height,
        "labels": made.window.labels,
        "scale": made.scale,
        "unit": None,
        "out": out,
    }


def _figures(one: FormFigures) -> dict[str, object]:
    return {
        "focal_px": one.focal_px,
        "row_error_mean_px": one.row_error_mean_px,
        "row_error_median_px": one.row_error_median_px,
        "row_error_p95_px": one.row_error_p95_px,
        "sampson_px": one.sampson_px,
        "skew_deg": one.skew_deg,
        "aspect": one.aspect,
        "area_ratio": one.area_ratio,
    }


def _lines(made: SceneRectification, matches: SceneMatches, out: Path, *, good: bool) -> list[str]:
    verdict = (
        "good enough to match on"
        if good
        else f"rows miss each other by more than {_MOST_ROW_ERROR_PX:g} px: give more frames, or calibrate with a board"
    )
    return [
        f"{out}: {made.form}, {made.matches} matches of {matches.frames} frames, {len(matches.rejected)} rejected",
        *(f"  rejected {entry.name}: {entry.reason}" for entry in matches.rejected),
        f"  taken: {made.reason}",
        "  held-back matches   row error mean, median, 95 % in px;  skew, aspect, area ratio of the worse view",
        *(
            f"  {one.form:<19} {one.row_error_mean_px:.3f} {one.row_error_median_px:.3f} {one.row_error_p95_px:.3f};  "
            f"{one.skew_deg:.2f} deg {one.aspect:.3f} {one.area_ratio:.2f}"
            for one in made.figures
        ),
        f"  pictures            {made.width}x{made.height}, {made.scale:.3g} of the raw size, {made.window.labels} labels",
        f"  {verdict}; there is no scale, so no millimetres",
    ]
