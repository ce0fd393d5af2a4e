"""A drawing of any rig for people: its surfaces to scale, the rays of both views, and the viewpoints they seem to come from.

`drawing` shows prism rigs with all their dimensions; the other kinds of rigs differ too much for that, but a ray is a ray.
"""

from __future__ import annotations

import math

from prismstereo_hw.rig import Rig
from prismstereo_hw.sketch.ray_paths import RayPaths, ray_paths
from prismstereo_hw.sketch.svg import Panel, Point, document, words
from prismstereo_hw.view import Side

__all__ = ["draw_rays"]

_SIZE_PX = 820
_TOP_PX = 70
_ONWARD = 0.5  # of the drawing's own size: how far the outgoing rays are followed
_MARGIN = 0.12
_STYLES = {"reflect": "mirror", "refract": "glass", "total": "glass"}


def draw_rays(rig: Rig) -> str:
    """Return the ray drawing of a rig of any kind as the text of an SVG file; `RigError` for one that shows nothing."""
    paths: dict[Side, RayPaths] = {"left": ray_paths(rig, "left"), "right": ray_paths(rig, "right")}
    size = _size([*_fixed_points(rig, paths)])
    ways = {side: _ways(path, _ONWARD * size) for side, path in paths.items()}
    shown = [*_fixed_points(rig, paths), *(point for bundle in ways.values() for way in bundle for point in way)]
    panel = _panel(shown)
    apart = math.dist(*(path.viewpoint_mm for path in paths.values()))
    return document(
        _SIZE_PX,
        _SIZE_PX,
        f"{rig.name}: rays",
        [
            words(24, 30, f"{rig.name}: {rig.camera.name}", "title"),
            words(24, 50, f"viewpoints {apart:.1f} mm apart; blue: left view, orange: right view", "small"),
            *(shape for side, path in paths.items() for shape in _bundle(panel, side, path, ways[side])),
            *_parts(panel, rig),
            *_marks(panel, paths),
        ],
    )


def _fixed_points(rig: Rig, paths: dict[Side, RayPaths]) -> list[Point]:
    ends = [end for side in paths for surface in _strips(rig, side) for end in surface[1]]
    return [(0.0, 0.0), *ends, *(path.viewpoint_mm for path in paths.values())]


def _strips(rig: Rig, side: Side) -> list[tuple[str, tuple[Point, Point]]]:
    """Return what each surface does and the ends of its line in the xz plane."""
    found: list[tuple[str, tuple[Point, Point]]] = []
    for surface in rig.surfaces(side):
        near = surface.centre_mm - surface.along * surface.half_along_mm
        far = surface.centre_mm + surface.along * surface.half_along_mm
        found.append((surface.action, ((float(near[0]), float(near[2])), (float(far[0]), float(far[2])))))
    return found


def _size(points: list[Point]) -> float:
    return max(max(p[axis] for p in points) - min(p[axis] for p in points) for axis in (0, 1))


def _ways(path: RayPaths, onward_mm: float) -> list[list[Point]]:
    return [
        [(float(x), float(z)) for x, z in points]
        + [(float(points[-1, 0] + onward_mm * ahead[0]), float(points[-1, 1] + onward_mm * ahead[1]))]
        for points, ahead in zip(path.points_mm, path.direction, strict=True)
    ]


def _panel(points: list[Point]) -> Panel:
    room = _MARGIN * _size(points)
    low = min(x for x, _ in points) - room, min(z for _, z in points) - room
    high = max(x for x, _ in points) + room, max(z for _, z in points) + room
    return Panel(12, _TOP_PX, _SIZE_PX - 24, _SIZE_PX - _TOP_PX - 24, low, high)


def _bundle(panel: Panel, side: Side, path: RayPaths, ways: list[list[Point]]) -> list[str]:
    return [
        panel.line([*ways[0], *reversed(ways[-1])], f"{side} area", closed=True),
        *(panel.line(way, side) for way in ways),
        *(panel.line([path.viewpoint_mm, way[-2]], f"{side} behind") for way in ways),
    ]


def _parts(panel: Panel, rig: Rig) -> list[str]:
    both = [*_strips(rig, "left"), *_strips(rig, "right")]
    pupil = rig.camera.pupil_diameter_mm / 2
    drawn = [panel.line(ends, _STYLES[action]) for action, ends in both]
    return [*drawn, panel.line([(-pupil, 0.0), (pupil, 0.0)], "pupil")]


def _marks(panel: Panel, paths: dict[Side, RayPaths]) -> list[str]:
    line = 14 / panel.scale
    marks = [panel.label((0.0, -2 * line), "entrance pupil", "small")]
    leftmost = min(path.viewpoint_mm[0] for path in paths.values())
    for side, path in paths.items():
        x, z = path.viewpoint_mm
        anchor = "end" if x == leftmost else "start"  # away from each other: they may be close
        marks += [panel.dot((x, z), f"{side} camera"), panel.label((x, z - line), f"{side} viewpoint", "small", anchor)]
    return marks
