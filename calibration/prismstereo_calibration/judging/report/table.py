"""Sections and tables of the report, and how its units are written. Text from outside is escaped here."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from prismstereo_calibration.model import Unit

__all__ = ["section", "table", "unit_name"]


def section(heading: str, content: str) -> str:
    """Return a section; its content is HTML already."""
    return f"<section>\n<h2>{escape(heading)}</h2>\n{content}\n</section>"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of plain text; every cell but the first of a row is a number or a short word."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = []
    for row in rows:
        first, *rest = row
        cells = "".join(f'<td class="number">{escape(cell)}</td>' for cell in rest)
        lines.append(f"<tr><td>{escape(first)}</td>{cells}</tr>")
    return f"<table>\n<thead><tr>{top}</tr></thead>\n<tbody>\n{chr(10).join(lines)}\n</tbody>\n</table>"


def unit_name(unit: Unit) -> str:
    """Return a unit as people write it behind a number."""
    return "mm" if unit == "mm" else "squares"
