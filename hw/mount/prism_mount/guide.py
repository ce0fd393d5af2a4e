"""Pictures of the assembly guide: the parts apart, one mirror seat cut open, what the live picture should show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from build123d import Location, Part

from prism_mount.assembly import Assembly
from prism_mount.layout import DEPTHS, SeatFrame
from prism_mount.projection import View, cut_below
from prism_mount.sheet import STYLES, Point, Sheet
from prism_mount.stock import STOCK

__all__ = ["draw_guide"]

Z = (0.0, 0.0, 1.0)
_APART = {  # how far each thing is moved out of its place, and its number in the guide
    "body": ((0.0, 0.0, 0.0), "1"),
    "carrier-left": ((-30.0, 0.0, 62.0), "2"),
    "carrier-right": ((30.0, 0.0, 62.0), "3"),
    "clamp": ((0.0, -92.0, 0.0), "4"),
    "bracket": ((0.0, 0.0, -48.0), "5"),
    "prism": ((0.0, -64.0, 0.0), "6"),
    "mirror-left": ((-14.0, 0.0, 92.0), "7"),
    "mirror-right": ((14.0, 0.0, 92.0), "7"),
}


def draw_guide(assembly: Assembly, folder: Path) -> None:
    """Write the guide's pictures as SVG."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, sheet in (
        ("parts.svg", _parts(assembly)),
        ("mirror-seat.svg", _mirror_seat(assembly)),
        ("live-picture.svg", _live_picture()),
    ):
        (folder / name).write_text(sheet.text(), "utf-8")


def _parts(assembly: Assembly) -> Sheet:
    sheet = Sheet(240.0, 216.0)
    view = View.from_above((0.42, -0.55, 0.72), (108.0, 118.0), 0.72)
    moved = {
        name: Part() + part.moved(Location(_APART[name][0]))
        for name, part in {**assembly.parts, **assembly.glass}.items()
    }
    view.draw(sheet, moved.values())
    for name, part in moved.items():
        box = part.bounding_box()
        middle = (box.min + box.max) / 2
        at = view.place((middle.X, middle.Y, middle.Z))
        away = np.array([at[0] - 108.0, at[1] - 104.0])
        away = away / max(np.linalg.norm(away), 1.0)
        reach = 46.0 if name == "body" else 30.0
        if name == "body":
            at, away = view.place((48.0, assembly.layout.underside_mm - 3.0, 30.0)), np.array([0.3, 1.0])
            reach = 22.0
        sheet.balloon(at, (at[0] + reach * away[0], at[1] + reach * away[1]), _APART[name][1])
    names = "1 body; 2, 3 carriers; 4 clamp; 5 camera bracket; 6 prism; 7 mirrors (silvered sides to the front)"
    sheet.write((8, 211), names, 4.0)
    return sheet


def _outline(sheet: Sheet, points: list[Point], fill: str) -> None:
    path = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    sheet.elements.append(f'<polygon points="{path}" style="{STYLES["thin"]};fill:{fill}"/>')


def _screw(sheet: Sheet, view: View, seat: SeatFrame, u: float, *, sprung: bool) -> None:
    """Draw screw, nut and spring of one adjuster at u, in the cut's plane."""

    def box(half: float, w: tuple[float, float], fill: str) -> None:
        corners = ((u - half, w[0]), (u + half, w[0]), (u + half, w[1]), (u - half, w[1]))
        _outline(sheet, [view.place(seat.point(a, 0.0, b)) for a, b in corners], fill)

    head = DEPTHS.plate_back + 0.5
    box(1.5, (head - 16.0, head), "#9aa0a6")
    box(2.75, (head, head + 3.0), "#9aa0a6")
    box(3.5, (DEPTHS.plate_back, head), "#c9cdd1")
    box(2.75, (5.1, 7.5), "#6b7075")
    if sprung:
        for side in (-1.0, 1.0):
            steps = np.linspace(DEPTHS.carrier_back, DEPTHS.plate_front + STOCK.spring_pocket_mm, 8)
            path = [seat.point(u + side * (1.8 + 1.1 * (n % 2)), 0.0, w) for n, w in enumerate(steps)]
            sheet.polyline([view.place(point) for point in path], "outline")


def _mirror_seat(assembly: Assembly) -> Sheet:
    layout, seat = assembly.layout, assembly.layout.seat(1.0)
    scale = 2.2
    start = seat.point(26.0, 0.0, 9.0)
    view = View((1.0, 0.0, 0.0), Z, (112.0 - scale * start[0], 92.0 + scale * start[2]), scale)
    sheet = Sheet(240.0, 190.0)
    level = layout.adjusters["pivot"][1]
    rest, faces = cut_below([assembly.parts["carrier-right"], assembly.parts["body"]], level)
    view.fill(sheet, faces, "#d9d4c5")
    near = [part for part in rest if part.bounding_box().max.X > 0]
    view.draw(sheet, near)
    glass = [(0.0, 0.0), (layout.rig.mirrors.length_mm, 0.0), (layout.rig.mirrors.length_mm, 3.0), (0.0, 3.0)]
    _outline(sheet, [view.place(seat.point(u, 0, w)) for u, w in glass], "#cfe5f7")
    for name in ("pivot", "vergence"):
        _screw(sheet, view, seat, layout.adjusters[name][0], sprung=name == "vergence")
    sheet.elements.append('<rect x="0" y="0" width="34" height="190" fill="#fff"/>')
    notes = (
        ((25.0, 0.0), (52.0, 34.0), "reflecting side of the mirror"),
        ((9.0, 3.2), (40.0, 52.0), "silicone on three pads"),
        ((43.8, 6.3), (150.0, 14.0), "M3 nut, put in before the mirror"),
        ((43.8, 12.5), (186.0, 34.0), "spring"),
        ((43.8, 22.0), (196.0, 62.0), "vergence screw M3x16"),
        ((7.0, 12.5), (172.0, 150.0), "pivot: printed cone"),
        ((7.0, 22.0), (172.0, 164.0), "pivot screw M3x16"),
    )
    for (u, w), to, words in notes:
        sheet.leader(view.place(seat.point(u, 0, w)), to, words)
    sheet.write(
        (8, 184),
        "Right mirror seat, cut level through pivot and vergence screw; the tip screw stands above the pivot",
        4.0,
    )
    return sheet


def _live_picture() -> Sheet:
    """Draw the raw picture of a mark one metre ahead: right, vergence off, tip off."""
    sheet = Sheet(240.0, 74.0)
    cases = (
        ("good: same height, mark in both halves", (0.0, 0.0), (0.0, 0.0)),
        ("tip off: turn a tip screw", (0.0, 5.0), (0.0, -5.0)),
        ("vergence off: turn a vergence screw", (-12.0, 0.0), (12.0, 0.0)),
    )
    for number, (words, left, right) in enumerate(cases):
        x0, y0 = 8.0 + 78.0 * number, 10.0
        sheet.elements.append(f'<rect x="{x0}" y="{y0}" width="70" height="40" style="fill:#eef1f4;stroke:#111"/>')
        sheet.elements.append(f'<rect x="{x0 + 33.5}" y="{y0}" width="3" height="40" style="fill:#8a9199"/>')
        for middle, (dx, dy) in ((17.0, left), (53.0, right)):
            x, y = x0 + middle + dx, y0 + 20 + dy
            sheet.polyline([(x - 5, y), (x + 5, y)], "outline")
            sheet.polyline([(x, y - 5), (x, y + 5)], "outline")
        sheet.polyline([(x0, y0 + 20), (x0 + 70, y0 + 20)], "hidden")
        sheet.write((x0 + 35, y0 + 48), words, 3.4, "middle")
    sheet.write((8, 70), "Raw picture of one mark 1 m ahead; the grey band is the seam (the prism's apex)", 3.4)
    return sheet
