"""A sheet as a vector PDF of exact size; the same sheet gives the same bytes."""

from __future__ import annotations

import io

from prismstereo_calibration.target.sheet import Sheet

__all__ = ["pdf"]

_POINT_MM = 25.4 / 72


def pdf(sheet: Sheet) -> bytes:
    """Write a page; its viewer is told not to scale it. All ink is one path, so that no light shows between its rectangles."""
    from reportlab.pdfgen.canvas import Canvas

    height_mm, file = sheet.page.height_mm, io.BytesIO()
    size = sheet.page.width_mm / _POINT_MM, height_mm / _POINT_MM
    canvas = Canvas(file, pagesize=size, pageCompression=1, invariant=1)  # invariant: no date, no random name
    canvas.setTitle(f"prismstereo target {sheet.board.name}, {sheet.board.square:g} mm")
    canvas.setAuthor("prismstereo")
    canvas.setSubject("calibration board of exact size: print at 100 %")
    canvas.setViewerPreference("PrintScaling", "None")
    path = canvas.beginPath()
    for x0, y0, x1, y1 in sheet.ink.rectangles / _POINT_MM:
        path.rect(x0, size[1] - y1, x1 - x0, y1 - y0)
    canvas.drawPath(path, stroke=0, fill=1)
    for line in sheet.lines:
        canvas.setFont("Helvetica", line.size_mm / _POINT_MM)
        canvas.drawString(line.x_mm / _POINT_MM, (height_mm - line.y_mm) / _POINT_MM, line.text)
    canvas.showPage()
    canvas.save()
    return file.getvalue()
