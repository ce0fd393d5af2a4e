"""The dimensioned drawing of one mount, an A3 sheet at 1:1: a cut through the optical axis, rear, side, base plate."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from prism_mount.assembly import Assembly
from prism_mount.layout import DEPTHS
from prism_mount.projection import View, cut_below
from prism_mount.sheet import Sheet

__all__ = ["draw"]

X, Y_UP, Z = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)
_RAYS = 5


def draw(assembly: Assembly, path: Path) -> None:
    """Draw a mount and write the sheet as SVG."""
    sheet = Sheet(420.0, 297.0)
    sheet.elements.append('<rect x="5" y="5" width="410" height="287" style="fill:none;stroke:#111;stroke-width:0.5"/>')
    _section(assembly, sheet)
    _rear(assembly, sheet)
    _side(assembly, sheet)
    _plate(assembly, sheet)
    _title(assembly, sheet)
    path.write_text(sheet.text(), "utf-8")


def _excess(assembly: Assembly) -> float:
    """Return how much farther forward a mount reaches than the sheet was laid out for."""
    return max(0.0, float(assembly.layout.outline()[:, 1].max()) - 58.0)


def _section(assembly: Assembly, sheet: Sheet) -> None:
    layout, view = assembly.layout, View(X, Z, (108.0, 112.0 + _excess(assembly)))
    rest, faces = cut_below(assembly.parts.values(), 0.0)
    view.fill(sheet, faces, "#d9d4c5")
    view.draw(sheet, rest)
    for glass in assembly.glass.values():
        _, cut = cut_below([glass], 0.0)
        view.fill(sheet, cut, "#cfe5f7")
        view.draw(sheet, [glass], "glass")
    _draw_rays(assembly, sheet, view)
    mirrors, seat = layout.rig.mirrors, layout.seat(1.0)
    near, far = view.place(seat.origin), view.place(seat.point(mirrors.length_mm, 0, 0))
    left_near = view.place(layout.seat(-1.0).origin)
    half = layout.rig.prism.side_mm / 2
    base = view.place((half, 0, layout.base_mm))
    pupil = view.place((0, 0, 0))
    sheet.polyline([view.place((0, 0, -8)), view.place((0, 0, layout.baffle_mm[1] + 14))], "axis")
    sheet.polyline([(pupil[0] - 3, pupil[1]), (pupil[0] + 3, pupil[1])], "thin")
    sheet.leader(pupil, (pupil[0] - 36, pupil[1] + 14), "entrance pupil")
    out = view.place((-78.0, 0, 0))[0]
    sheet.dimension((out + 8, pupil[1]), (out + 8, base[1]), (0, -1), -2.0, f"{layout.base_mm:.1f}")
    sheet.polyline([(out + 6, base[1]), (base[0] - 2 * half, base[1])], "thin")
    sheet.polyline([(out + 6, pupil[1]), (pupil[0] - 3, pupil[1])], "thin")
    sheet.dimension((base[0], base[1]), (base[0], near[1]), (0, -1), 62.0, f"{mirrors.offset_mm:.1f}")
    sheet.dimension(left_near, near, (1, 0), -60.0, f"2 x {mirrors.near_edge_mm:.1f} = {2 * mirrors.near_edge_mm:.1f}")
    sheet.dimension(near, far, (far[0] - near[0], far[1] - near[1]), 40.0, f"mirror {mirrors.length_mm:.1f}")
    sheet.leader(
        view.place(seat.point(30, 0, 0)), (far[0] - 8, far[1] - 14), f"{mirrors.angle_deg:.2f}° from the x axis"
    )
    top = view.place((0, 0, layout.baffle_mm[1]))
    sheet.leader(
        (top[0], top[1] + 6), (66.0, 30.0 + _excess(assembly)), f"baffle, ends at z = {layout.baffle_mm[1]:.1f}"
    )
    sheet.write(
        (12, 14), "Section through the optical axis, seen from above (glass blue, light of the middle row red)", 3.5
    )


def _draw_rays(assembly: Assembly, sheet: Sheet, view: View) -> None:
    for bundle in assembly.layout.bundles:
        points = bundle.points_mm
        middle = (np.abs(points[:, :, 1]).max(axis=1) < 0.8) & (np.hypot(*points[:, 0, :2].T) < 1e-9)
        order = np.argsort(points[middle][:, 1, 0])
        for index in order[np.linspace(0, len(order) - 1, _RAYS).astype(int)]:
            path = points[middle][index]
            end = path[4] + bundle.direction[middle][index] * 45.0
            sheet.polyline([view.place(p) for p in (*path, end)], "ray")


def _rear(assembly: Assembly, sheet: Sheet) -> None:
    layout, view = assembly.layout, View(X, Y_UP, (108.0, 232.0))
    view.draw(sheet, [part for name, part in assembly.parts.items() if name != "bracket"])
    holes = layout.bracket_holes
    left, right, low = (view.place((*holes[i], 0.0)) for i in (0, 2, 1))
    sheet.dimension(left, right, (1, 0), -32.0, f"{holes[2][0] - holes[0][0]:.1f}")
    sheet.dimension(left, low, (0, 1), -9.0, f"{holes[1][1] - holes[0][1]:.1f}")
    top, under = view.place((0, layout.top_mm - 5.0, 0)), view.place((0, layout.underside_mm, 0))
    edge = float(layout.outline()[:, 0].max())
    wide = [view.place((x, layout.underside_mm, 0)) for x in (-edge, edge)]
    sheet.dimension(wide[0], wide[1], (1, 0), 10.0, f"{2 * edge:.1f}")
    corner = view.place((edge, layout.underside_mm, 0))
    sheet.dimension((corner[0], top[1]), corner, (0, 1), -16.0, f"{layout.underside_mm - layout.top_mm + 5.0:.1f}")
    centre = view.place((0, 0, 0))
    sheet.dimension((corner[0], centre[1]), (corner[0], under[1]), (0, 1), -8.0, f"{layout.underside_mm:.1f}")
    sheet.polyline([(centre[0] - 40, centre[1]), (centre[0] + 80, centre[1])], "axis")
    sheet.polyline([(centre[0], centre[1] - 46), (centre[0], centre[1] + 40)], "axis")
    rear = layout.wall_rear_mm
    bore = layout.bore_mm(rear, rear + 3.0)
    sheet.leader(
        (centre[0] + 0.7 * bore, centre[1] - 0.7 * bore), (centre[0] + 44, centre[1] - 44), f"bore Ø{2 * bore:.1f}"
    )
    sheet.leader(left, (left[0] - 22, left[1] - 24), "4x insert M3 (Ø4.0 x 6)")
    seat = layout.seat(-1.0)
    for name, (u, v) in layout.adjusters.items():
        at = view.place(seat.point(u, v, DEPTHS.plate_back))
        words = "pivot" if name == "pivot" else f"{name} ±{layout.travel_deg[name]:.1f}°"
        to = {"pivot": (36.0, 259.0), "vergence": (36.0, 244.0), "tip": (36.0, 206.0)}[name]
        sheet.leader(at, to, words)
    sheet.write((12, 178), "Seen from the camera, bracket left out", 3.5)


def _side(assembly: Assembly, sheet: Sheet) -> None:
    layout, view = assembly.layout, View(Z, Y_UP, (244.0 - _excess(assembly), 232.0))
    view.draw(sheet, assembly.parts.values())
    centre = view.place((0, 0, 0))
    sheet.polyline([(centre[0] - 12, centre[1]), (centre[0] + 88, centre[1])], "axis")
    rear = view.place((0, layout.underside_mm, layout.wall_rear_mm))
    front = view.place((0, layout.underside_mm, float(layout.outline()[:, 1].max())))
    words = f"{float(layout.outline()[:, 1].max()) - layout.wall_rear_mm:.1f}"
    sheet.dimension(rear, front, (1, 0), 10.0, words)
    sheet.write((222, 178), "Seen from the right, light leaves to the right", 3.5)


def _plate(assembly: Assembly, sheet: Sheet) -> None:
    layout, view = assembly.layout, View(X, Z, (318.0, 118.0 + _excess(assembly)))
    rest, faces = cut_below([assembly.parts["body"]], layout.floor_mm + 2.5)
    view.fill(sheet, faces, "#e8e4d8")
    view.draw(sheet, rest)
    feet = [hole for hole in assembly.holes if hole.purpose.startswith("M4")]
    tripod = next(hole for hole in assembly.holes if "tripod" in hole.purpose)
    at = sorted((view.place(hole.start) for hole in feet), key=lambda p: (p[1], p[0]))
    far_left, far_right, near_left, near_right = at
    sheet.dimension(near_left, near_right, (1, 0), 30.0, f"{near_right[0] - near_left[0]:.1f}")
    sheet.dimension(far_left, far_right, (1, 0), -48.0, f"{far_right[0] - far_left[0]:.1f}")
    sheet.dimension(far_right, near_right, (0, 1), -28.0, f"{near_right[1] - far_right[1]:.1f}")
    middle, wall = view.place(tripod.start), view.place((0, 0, layout.wall_rear_mm))
    sheet.dimension((wall[0] - 30, wall[1]), middle, (0, -1), -62.0, f"{wall[1] - middle[1]:.1f}")
    sheet.dimension((wall[0] - 30, wall[1]), near_left, (0, -1), -72.0, f"{wall[1] - near_left[1]:.1f}")
    sheet.polyline([(wall[0], wall[1] + 8), (wall[0], wall[1] - 90)], "axis")
    sheet.leader(middle, (middle[0] + 30, wall[1] + 24), "tripod 1/4-20: Ø6.6, nut 7/16 in above")
    sheet.leader(far_left, (far_left[0] - 4, far_left[1] - 26), "4x Ø4.4 for M4")
    sheet.write((238, 14), "Base plate, cut 2.5 below its upper side; the openings are where light passes", 3.5)


def _title(assembly: Assembly, sheet: Sheet) -> None:
    layout = assembly.layout
    rig = layout.rig
    View.from_above((0.35, -0.62, 0.7), (366.0, 200.0), 0.5).draw(sheet, assembly.parts.values())
    sheet.elements.append(
        '<rect x="308" y="246" width="107" height="46" style="fill:#fff;stroke:#111;stroke-width:0.4"/>'
    )
    lines = (
        f"prismstereo mount for {rig.name}",
        f"camera: {rig.camera.name}; held by {layout.interface.name}",
        f"prism {rig.prism.side_mm} x {rig.prism.length_mm} {rig.prism.glass}; mirrors {rig.mirrors.length_mm} x "
        f"{rig.mirrors.height_mm} x 3, first surface",
        "printed PETG or ASA, 4 perimeters, 40 % infill, 0.2 layers; tolerance ±0.2",
        "millimetres, 1:1 on A3 (picture lower right smaller); views in third angle",
        f"volume {sum(p.volume for p in assembly.parts.values()) / 1000:.0f} cm3 in {len(assembly.parts)} printed parts",
    )
    for row, words in enumerate(lines):
        sheet.write((311, 253 + 7.2 * row), words, 4.4 if row == 0 else 2.5)
