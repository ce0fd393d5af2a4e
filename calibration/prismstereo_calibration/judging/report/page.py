"""The page: its head, its style, and its sections in the order in which a person asks.

Same input, same bytes: no date, no host, no random name. Every text from outside is escaped. No script, nothing is loaded.
"""

from __future__ import annotations

from html import escape

from prismstereo_calibration.judging.criteria import Verdict
from prismstereo_calibration.judging.quality import Quality
from prismstereo_calibration.judging.report import accuracy, advice, frames
from prismstereo_calibration.judging.report.table import section
from prismstereo_calibration.solving.solve import Solution

__all__ = ["html"]

_SENTENCE: dict[Verdict, str] = {
    "good": "Good: every figure is within its first limit.",
    "usable": "Usable: a figure is beyond its first limit. It measures, with less than the accuracy this unit can have.",
    "redo": "Redo: a figure is beyond its last limit. Do not measure with this calibration.",
}

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --paper: #ffffff; --faint: #767676; --line: #c8c8c8;
  --mark: #0b62a4; --other: #6a9cc4; --warn: #b3541e; --good: #1f7a3d; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #16181a; --faint: #9a9a9a; --line: #44484c;
  --mark: #6cb4ee; --other: #3d76a3; --warn: #f0a060; --good: #6fcf8e; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 56rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .2rem .9rem .2rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); } td.number { font-variant-numeric: tabular-nums; }
.verdict { font-size: 1.2rem; padding: .5rem .8rem; border-left: .4rem solid; }
.good { color: var(--good); } .usable { color: var(--warn); } .redo { color: var(--warn); font-weight: bold; }
.note { color: var(--faint); } .views { display: flex; flex-wrap: wrap; gap: 1rem; } figure { margin: 0; }
.views figure { max-width: 24rem; } .maps figure { max-width: 16rem; } rect.heat { shape-rendering: crispEdges; }
svg { max-width: 100%; height: auto; } svg text { font: 11px system-ui, sans-serif; fill: var(--ink); }
svg .name { text-anchor: end; } svg .middle { text-anchor: middle; } svg .bar, svg .cell { fill: var(--mark); }
svg .side1 { fill: var(--other); } svg .over { fill: var(--warn); }
svg .limit { stroke: var(--warn); stroke-dasharray: 4 3; } svg .dot { fill: var(--ink); }
svg .border { fill: none; stroke: var(--line); } svg .arrow { stroke: var(--warn); fill: none; }
svg .beyond { fill: none; stroke: var(--warn); stroke-width: 1.5; }
svg .scale { stroke: var(--ink); stroke-width: 2; fill: none; }
@media print { body { margin: 0; max-width: none; } }
"""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def html(solution: Solution, quality: Quality, *, title: str = "Calibration report") -> str:
    """Return the report page of a solution and its quality."""
    calibration = solution.calibration
    sections = [
        f'<p class="verdict {quality.verdict}">{escape(_SENTENCE[quality.verdict])}</p>',
        section("What the verdict rests on", accuracy.criteria(quality)),
        section("What to add next", advice.next_views(quality)),
        section("Cameras", accuracy.cameras(solution)),
        section("Accuracy on the board", accuracy.figures(quality)),
        section("Frames", frames.bars_and_rejections(solution)),
        section("Where the corners were", frames.coverage(solution, quality)),
        section("What is left over", frames.leftover(solution)),
        section("Rows after rectification", frames.rows(quality)),
        section("How far off a depth may be", accuracy.maps(quality)),
        section("How well the rig is put together", advice.assembly(quality)),
        section("Made with", advice.versions(calibration)),
    ]
    body = "\n".join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}: {escape(calibration.rig)}</h1>\n{body}\n</body>\n</html>\n"
    )
