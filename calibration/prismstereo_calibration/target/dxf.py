"""A sheet as DXF for plate makers: closed outlines in millimetres, y up, on layers PATTERN, CODE, BAR and TEXT.

The file is ASCII of release 12, which every program reads: one closed polyline of no width around each black rectangle, and no
two overlap. Release 12 has no unit; the bar says which it is.
"""

from __future__ import annotations

from collections.abc import Iterator

from prismstereo_calibration.target.footer import Line
from prismstereo_calibration.target.sheet import Sheet

__all__ = ["dxf"]

_LAYERS = ("PATTERN", "CODE", "BAR", "TEXT")
_CONTOUR = "CONTINUOUS"
Pair = tuple[int, str | int | float]


def dxf(sheet: Sheet) -> bytes:
    """Write the drawing; the origin is the lower left corner of the page."""
    return "".join(f"{code}\n{_value(value)}\n" for code, value in _pairs(sheet)).encode("ascii")


def _value(value: str | int | float) -> str:
    return f"{value:.6f}" if isinstance(value, float) else str(value)


def _pairs(sheet: Sheet) -> Iterator[Pair]:
    width, height = sheet.page.width_mm, sheet.page.height_mm
    yield from ((999, f"prismstereo target {sheet.board.name}, millimetres"), (0, "SECTION"), (2, "HEADER"))
    yield from ((9, "$ACADVER"), (1, "AC1009"))
    yield from ((9, "$EXTMIN"), (10, 0.0), (20, 0.0), (9, "$EXTMAX"), (10, float(width)), (20, float(height)))
    yield from ((0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LTYPE"), (70, 1), (0, "LTYPE"))
    yield from ((2, _CONTOUR), (70, 0), (3, "Solid line"), (72, 65), (73, 0), (40, 0.0), (0, "ENDTAB"))
    yield from ((0, "TABLE"), (2, "LAYER"), (70, len(_LAYERS)))
    for name in _LAYERS:
        yield from ((0, "LAYER"), (2, name), (70, 0), (62, 7), (6, _CONTOUR))
    yield from ((0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"))
    for name, ink in zip(_LAYERS, (sheet.pattern, sheet.code, sheet.bar), strict=False):
        for x0, y0, x1, y1 in [] if ink is None else ink.rectangles.tolist():
            yield from _outline(name, x0, height - y1, x1, height - y0)
    for line in sheet.lines:
        yield from _text(line, height)
    yield from ((0, "ENDSEC"), (0, "EOF"))


def _outline(layer: str, x0: float, y0: float, x1: float, y1: float) -> Iterator[Pair]:
    yield from ((0, "POLYLINE"), (8, layer), (66, 1), (10, 0.0), (20, 0.0), (30, 0.0), (70, 1))
    for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
        yield from ((0, "VERTEX"), (8, layer), (10, x), (20, y), (30, 0.0))
    yield from ((0, "SEQEND"), (8, layer))


def _text(line: Line, height: float) -> Iterator[Pair]:
    yield from ((0, "TEXT"), (8, _LAYERS[-1]), (10, line.x_mm), (20, height - line.y_mm), (30, 0.0))
    yield from ((40, 0.72 * line.size_mm), (1, line.text))  # DXF counts the height of a capital letter
