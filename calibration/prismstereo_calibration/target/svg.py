"""A sheet as SVG in millimetres."""

from __future__ import annotations

from html import escape

from prismstereo_calibration.target.ink import Ink
from prismstereo_calibration.target.sheet import Sheet

__all__ = ["svg"]


def svg(sheet: Sheet) -> bytes:
    """Write a drawing whose user unit is one millimetre; pattern, code and bar are one path each."""
    width, height = _number(sheet.page.width_mm), _number(sheet.page.height_mm)
    inks = {"pattern": sheet.pattern, "code": sheet.code, "bar": sheet.bar}
    words = [
        f'<text x="{_number(line.x_mm)}" y="{_number(line.y_mm)}" font-size="{_number(line.size_mm)}">'
        f"{escape(line.text)}</text>"
        for line in sheet.lines
    ]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}">',
            f"<title>prismstereo target {escape(sheet.board.name)}, {sheet.board.square:g} mm</title>",
            f'<rect width="{width}" height="{height}" fill="white"/>',
            *(f'<path id="{name}" d="{_path(ink)}"/>' for name, ink in inks.items() if ink is not None),
            '<g font-family="Helvetica, Arial, sans-serif">',
            *words,
            "</g>",
            "</svg>",
            "",
        ]
    ).encode()


def _path(ink: Ink) -> str:
    return "".join(
        f"M{_number(x0)} {_number(y0)}H{_number(x1)}V{_number(y1)}H{_number(x0)}Z" for x0, y0, x1, y1 in ink.rectangles
    )


def _number(value: float) -> str:
    """Write a length to a nanometre, without idle zeros."""
    return f"{value:.6f}".rstrip("0").rstrip(".")
