"""`prismstereo replay`: a recording through the same driver as a sensor, or its depth computed anew."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import DataError, UsageError

if TYPE_CHECKING:
    from prismstereo.recording import Recording
    from prismstereo.recording.rematching import RecordedRaw
    from prismstereo.recording.verification import Verification
    from prismstereo_device.pipeline import Pipeline


@click.command("replay", epilog="Example:  prismstereo replay 20260101-120000-0011223344556677.mcap")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--calibration", type=click.Path(path_type=Path),
              help="Compute depth with this calibration; else with the recorded one.")  # fmt: skip
@matching_options
@click.option("--out", "-o", type=click.Path(path_type=Path), help="Folder for the depth that is computed anew.")
@json_option
def command(file: Path, calibration: Path | None, matching: Matching, out: Path | None, as_json: bool) -> None:
    """Replay a recording and say whether it is whole; or compute its depth anew, by --matcher or --calibration.

    Without options every packet, every frame and the whole file are verified, and the exit code is 1 where something is
    damaged. Depth is computed of the raw frames that `record --raw` kept: each gives NAME_disparity.pfm, NAME_depth.pfm,
    NAME_depth.png (the picture) and NAME.ply.
    """
    from prismstereo.recording import Recording

    if matching.matcher is None and calibration is None and out is None:
        _verify(file, as_json=as_json)
        return
    if out is None:
        raise UsageError("say where the depth that is computed anew is to go: --out FOLDER")
    with Recording(file) as recording:
        _recompute(recording, calibration, matching, out, as_json=as_json)


def _verify(file: Path, *, as_json: bool) -> None:
    from prismstereo.recording.verification import verify

    found = verify(file)
    say(_object(file, found), _lines(file, found), as_json=as_json)
    if not found.whole:
        click.get_current_context().exit(1)


def _object(file: Path, found: Verification) -> dict[str, object]:
    return {
        "file": file,
        "whole": found.whole,
        "finished": found.finished,
        "why_cut": found.why_cut or None,
        "seconds": found.seconds,
        "frames": found.frames,
        "frames_identical": found.identical,
        "frames_partial": found.partial,
        "frames_lost": found.lost,
        "raw_frames": found.pictures,
        "packets": found.packets,
        "packets_dropped": found.dropped,
        "packets_damaged": found.damage.packets,
        "chunks_damaged": found.damage.chunks,
        "notes_damaged": found.damage.notes,
        "sum_is_right": found.sum_is_right,
        "sessions": found.sessions,
        "events": [{"kind": event.kind, "session": event.session, "text": event.text} for event in found.events],
    }


def _lines(file: Path, found: Verification) -> Iterator[str]:
    said = {True: "right", False: "WRONG", None: "none, the file was cut"}[found.sum_is_right]
    rows = (
        ("length", f"{found.seconds:.1f} s, {found.sessions} sessions with the sensor"),
        ("frames", f"{found.frames}, of which {found.identical} replay bit by bit"),
        ("partial, lost", f"{found.partial}, {found.lost}"),
        ("raw frames", f"{found.pictures}"),
        ("packets", f"{found.packets}, {found.dropped} dropped by the recorder"),
        ("damaged", f"{found.damage.packets} packets, {found.damage.chunks} chunks, {found.damage.notes} notes"),
        ("sum of the file", said),
    )
    yield f"{file}: {'whole' if found.whole else 'DAMAGED'}"
    for name, value in rows:
        yield f"  {name:<16} {value}"
    for event in found.events:
        if event.kind != "recording":
            yield f"  session {event.session:<8} {event.kind}: {event.text}"
    if not found.finished:
        yield f"  it was cut: {found.why_cut}; `prismstereo recover {file} -o NEW.mcap` gives it an index"


def _recompute(recording: Recording, calibration: Path | None, matching: Matching, out: Path, *, as_json: bool) -> None:
    from prismstereo.depth import depth_of
    from prismstereo.recording import Damage
    from prismstereo.recording.rematching import raw_frames

    damage = Damage()
    pipelines = _Pipelines(calibration, matching)
    results: list[dict[str, object]] = []
    lines: list[str] = []
    for raw in with_progress(raw_frames(recording, damage), None, "depth"):
        name = f"{raw.session:02d}-{raw.frame.index:06d}"
        found = depth_of(pipelines.of(raw), raw.frame)
        found.write(out, name)
        share = found.disparity.density
        results.append({"file": name, "milliseconds": found.milliseconds, "density": share, "unit": found.unit,
                        "median_depth": found.median_depth})  # fmt: skip
        lines.append(f"{name}: {100 * share:.1f} % matched, median depth {found.median_depth:.4g} {found.unit}, "
                     f"{found.milliseconds:.0f} ms")  # fmt: skip
    if not results:
        raise DataError(f"{recording.path} holds no raw frames to compute depth of: record with --raw")
    lines.append(f"wrote disparity, depth, picture and cloud of {len(results)} frames to {out}")
    result = {"frames": results, "out": out, "matcher": matching.name, "packets_damaged": damage.packets}
    say(result, lines, as_json=as_json)


class _Pipelines:
    """The pipeline of each frame: made anew only where the calibration changes."""

    def __init__(self, calibration: Path | None, matching: Matching) -> None:
        from prismstereo_calibration.store import read

        self._given = None if calibration is None else read(calibration)
        self._matching = matching
        self._made: tuple[bytes, Pipeline] | None = None

    def of(self, raw: RecordedRaw) -> Pipeline:
        """Give the pipeline for a frame; `DataError` where nobody knows its calibration."""
        from prismstereo_calibration import flash
        from prismstereo_device.pipeline import Pipeline

        key = b"" if self._given is not None else raw.calibration
        if self._made is None or self._made[0] != key:
            if self._given is None and not raw.calibration:
                raise DataError(
                    f"frame {raw.frame.index} was recorded with no calibration: give one with --calibration"
                )
            unit = self._given if self._given is not None else flash.unpack(raw.calibration)
            self._made = key, Pipeline(unit, self._matching.create(), filters=self._matching.chain())
        return self._made[1]
