"""The quality report as one HTML page that needs nothing else: figures, plots, comparison, definitions.

Same input, same bytes: no date, no host, no random name. Every text from outside is escaped. No script, nothing is loaded.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from prismstereo.measuring.account import Account, FlatTarget, TrueScene
from prismstereo.measuring.charts import Curve, curves, level_bars
from prismstereo.measuring.comparison import Change
from prismstereo.measuring.definitions import DEFINITIONS
from prismstereo.measuring.gap import Gap
from prismstereo_calibration.judging.report.table import section, table

__all__ = ["html"]

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --paper: #ffffff; --faint: #767676; --line: #c8c8c8;
  --mark: #0b62a4; --other: #b3541e; --third: #1f7a3d; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #16181a; --faint: #9a9a9a; --line: #44484c;
  --mark: #6cb4ee; --other: #f0a060; --third: #6fcf8e; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 64rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; } figure { margin: 0; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .2rem .9rem .2rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); } td.number { font-variant-numeric: tabular-nums; }
dt { font-weight: bold; margin-top: .5rem; } dd { margin-left: 1rem; } .views { display: flex; flex-wrap: wrap; gap: 1rem; }
svg { max-width: 100%; height: auto; } svg text { font: 11px system-ui, sans-serif; fill: var(--ink); }
svg .name { text-anchor: end; } svg .middle { text-anchor: middle; } svg .bar { fill: var(--mark); }
svg .axis { stroke: var(--ink); fill: none; } svg .grid { stroke: var(--line); fill: none; stroke-width: .5; }
svg .curve { fill: none; stroke-width: 1.5; } svg polyline.curve0 { stroke: var(--mark); }
svg polyline.curve1 { stroke: var(--other); stroke-dasharray: 5 3; } svg polyline.curve2 { stroke: var(--third); }
svg .dot0, svg text.curve0 { fill: var(--mark); } svg .dot1, svg text.curve1 { fill: var(--other); }
svg .dot2, svg text.curve2 { fill: var(--third); }
@media print { body { margin: 0; max-width: none; } }
"""
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_MM = "distance, mm"


def html(account: Account, changes: Sequence[Change] = (), *, title: str = "Depth quality") -> str:
    """Return the page of an account, and of its changes against an earlier one."""
    sections = []
    if account.flat:
        sections.append(section("Flat targets", _flat(account.flat)))
    sections += [section(f"Against the truth: {scene.source}", _scene(scene)) for scene in account.scenes]
    if changes:
        sections.append(section("Compared with the earlier report", _changes(changes)))
    meanings = "".join(f"<dt>{escape(key)}</dt><dd>{escape(text)}</dd>" for key, text in DEFINITIONS.items())
    sections.append(section("Definitions", f"<dl>{meanings}</dl>"))
    body = "\n".join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{escape(title)}</h1>\n{body}\n"
        "</body>\n</html>\n"
    )


def _flat(targets: Sequence[FlatTarget]) -> str:
    head = (
        "target", "distance, mm", "true, mm", "tilt, deg", "fill, %", "Z accuracy, %", "plane-fit RMS, mm", "% of distance",
        "sub-pixel RMS, px", "temporal noise, median, rms mm (frames)", "plane fit, mean mm", "gap, mean mm", "levels",
    )  # fmt: skip
    rows = []
    for target in targets:
        one = target.figures
        rows.append((
            target.source, f"{one.distance_mm:.2f}", _known(one.true_mm, ".2f"), f"{one.tilt_deg:.2f}",
            f"{one.fill_percent:.2f}", _known(one.z_accuracy_percent, "+.3f"), f"{one.plane_rms_mm:.4f}",
            f"{one.plane_rms_percent:.4f}", f"{one.subpixel_rms_px:.4f}",
            f"{_known(one.temporal_noise_mm, '.4f')}, {_known(one.temporal_rms_mm, '.4f')} ({one.frames})",
            f"{one.plane_fit_mm.mean:.4f}",
            _gap(target.triangulation_gap_mm), f"{target.levels.in_use}",
        ))  # fmt: skip
    return table(head, rows) + _figures(_flat_plots(targets))


def _flat_plots(targets: Sequence[FlatTarget]) -> list[str]:
    places = [(target.figures.distance_mm, target) for target in targets]
    return [
        curves(
            [
                Curve("plane-fit RMS", tuple((x, one.figures.plane_rms_mm) for x, one in places)),
                Curve("worth of sub-pixel RMS", tuple((x, one.expected_rms_mm) for x, one in places)),
                Curve(
                    "temporal noise",
                    tuple((x, noise) for x, one in places if (noise := one.figures.temporal_rms_mm) is not None),
                ),
            ],
            _MM,
            "mm",
        ),
        curves([Curve("sub-pixel RMS", tuple((x, one.figures.subpixel_rms_px) for x, one in places))], _MM, "px"),
        curves([Curve("fill rate", tuple((x, one.figures.fill_percent) for x, one in places))], _MM, "%"),
    ]


def _scene(scene: TrueScene) -> str:
    head = (
        "from, mm", "to, mm", "pixels", "fill, %", "over 1 px off, %", "disparity bias, px", "disparity RMS, px",
        "depth bias, %", "depth RMS, %", "depth RMS, mm", "predicted, mm",
    )  # fmt: skip
    rows, measured, predicted = [], [], []
    for one in scene.by_distance:
        cells = [
            f"{one.from_mm:.1f}",
            f"{one.to_mm:.1f}",
            f"{one.pixels}",
            f"{one.fill_percent:.1f}",
            f"{one.bad_percent:.2f}",
        ]
        found = one.errors
        if found is None:
            rows.append((*cells, *["-"] * 6))
            continue
        cells += [
            f"{found.disparity_bias_px:+.4f}",
            f"{found.disparity_rms_px:.4f}",
            f"{found.depth_bias_percent:+.4f}",
        ]
        cells += [f"{found.depth_rms_percent:.4f}", f"{found.depth_rms_mm:.3f}", f"{found.predicted_rms_mm:.3f}"]
        rows.append(tuple(cells))
        middle = (one.from_mm + one.to_mm) / 2
        measured.append((middle, found.depth_rms_mm))
        predicted.append((middle, found.predicted_rms_mm))
    text = (
        f"<p>{scene.frames} frames, {scene.fill_percent:.1f} % matched of what has a match in truth, "
        f"{scene.levels.in_use} disparity levels in use, triangulation gap {_gap(scene.triangulation_gap_mm)} mm.</p>"
    )
    plots = [
        curves([Curve("depth RMS", tuple(measured)), Curve("predicted", tuple(predicted))], _MM, "mm"),
        level_bars(scene.levels),
    ]
    return text + table(head, rows) + _figures(plots)


def _changes(changes: Sequence[Change]) -> str:
    rows = [(one.figure, one.where, f"{one.before:.4g}", f"{one.after:.4g}", one.verdict) for one in changes]
    return table(("figure", "where", "before", "after", "verdict"), rows)


def _figures(plots: Sequence[str]) -> str:
    return '<div class="views">' + "".join(f"<figure>{plot}</figure>" for plot in plots if plot) + "</div>"


def _known(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _gap(gap: Gap | None) -> str:
    return "-" if gap is None else f"{gap.mean:.4f}"
