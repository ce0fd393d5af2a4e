"""A drawing of a prism rig for people: the parts to scale with their dimensions and rays, and the field both views share.

On the left the rig seen from above, the camera at the bottom; on the right the scene in front of it, at a smaller scale.
Blue belongs to the left view, orange to the right one, green is seen by both. Broken lines lead back to the viewpoints
from which the views are taken as if by two cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.optics.figures import RigFigures, figures
from prismstereo_hw.sketch.ray_paths import RayPaths, ray_paths
from prismstereo_hw.sketch.svg import Panel, Point, document, words
from prismstereo_hw.view import Side

__all__ = ["draw"]

_WIDTH_PX, _HEIGHT_PX = 1080, 760
_TOP_PX, _PANEL_HEIGHT_PX = 66, 640
_RIG_PX, _FIELD_PX = 640, 360
_BEYOND_MM = 14.0  # of the outgoing rays above the mirrors
_ROOM_PX = 75  # between lens and prism for two dimensions
_FIELD_NEARS = 3.0  # the field is shown up to so many times the near end
_SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True, slots=True)
class _Subject:
    rig: PrismRig
    found: RigFigures
    paths: dict[Side, RayPaths]

    @property
    def base_mm(self) -> float:
        return self.rig.prism.pupil_to_prism_mm

    @property
    def near_edge(self) -> Point:
        return self.rig.mirrors.near_edge_mm, self.base_mm + self.rig.mirrors.offset_mm

    @property
    def far_edge(self) -> Point:
        mirrors, (x, z) = self.rig.mirrors, self.near_edge
        mu = math.radians(mirrors.angle_deg)
        return x + mirrors.length_mm * math.cos(mu), z + mirrors.length_mm * math.sin(mu)


def draw(rig: PrismRig) -> str:
    """Return the drawing of a prism rig as the text of an SVG file; `RigError` for a rig that shows nothing."""
    subject = _Subject(rig, figures(rig), {side: ray_paths(rig, side) for side in _SIDES})
    plan, field = _plan(subject), _field_panel(subject)
    return document(
        _WIDTH_PX,
        _HEIGHT_PX,
        f"{rig.name}: rays and dimensions",
        [
            words(24, 30, f"{rig.name}: {rig.camera.name}", "title"),
            words(24, 50, _summary(subject), "small"),
            *_bundles(plan, subject),
            *_parts(plan, subject),
            *_dimensions(plan, subject),
            *_fans(field, subject),
            *_field_marks(field, subject),
            *_legend(),
        ],
    )


def _summary(subject: _Subject) -> str:
    found, prism = subject.found, subject.rig.prism
    return (
        f"baseline {found.baseline_mm:.1f} mm, vergence {found.vergence_deg:.1f}\N{DEGREE SIGN}, "
        f"{100 * found.columns_kept:.1f} % of the columns, {prism.glass} prism {prism.side_mm:g} x {prism.length_mm:g} mm, "
        f"mirrors {subject.rig.mirrors.length_mm:g} x {subject.rig.mirrors.height_mm:g} mm"
    )


def _plan(subject: _Subject) -> Panel:
    viewpoints = [path.viewpoint_mm for path in subject.paths.values()]
    wide = max(subject.far_edge[0] + 6, *(abs(x) + 20 for x, _ in viewpoints))
    low = min(*(z for _, z in viewpoints), 0.0) - 18
    return Panel(12, _TOP_PX, _RIG_PX, _PANEL_HEIGHT_PX, (-wide, low), (wide, subject.far_edge[1] + _BEYOND_MM))


def _bundles(plan: Panel, subject: _Subject) -> list[str]:
    """Draw each view's bundle as an area, its edge and middle rays as lines, and the lines back to its viewpoint."""
    top = plan.high[1]
    drawn = []
    for side, path in subject.paths.items():
        ways = [
            [(float(x), float(z)) for x, z in points] + [(float(end), top)]
            for points, end in zip(path.points_mm, path.at_depth(top), strict=True)
        ]
        drawn.append(plan.line([*ways[0], *reversed(ways[-1])], f"{side} area", closed=True))
        drawn += [plan.line(way, side) for way in ways]
        drawn += [plan.line([path.viewpoint_mm, way[-2]], f"{side} behind") for way in ways]
        drawn.append(plan.dot(path.viewpoint_mm, f"{side} camera"))
    return drawn


def _parts(plan: Panel, subject: _Subject) -> list[str]:
    prism, base = subject.rig.prism, subject.base_mm
    half, pupil = prism.side_mm / 2, subject.rig.camera.pupil_diameter_mm / 2
    mirrors = [
        plan.line(
            [(s * subject.near_edge[0], subject.near_edge[1]), (s * subject.far_edge[0], subject.far_edge[1])], "mirror"
        )
        for s in (-1, 1)
    ]
    return [
        plan.line([(0, plan.low[1] + 8), (0, plan.high[1])], "line axis"),
        plan.line([(-half, base), (half, base), (0, base + prism.height_mm)], "glass", closed=True),
        *mirrors,
        plan.line([(-pupil, 0), (pupil, 0)], "pupil"),
        plan.label((0, -1.2 - 10 / plan.scale), "entrance pupil of the lens", "small"),
        *(
            plan.label((x, z - 14 / plan.scale), f"{side} viewpoint", "small", "end" if side == "left" else "start")
            for side, (x, z) in ((side, path.viewpoint_mm) for side, path in subject.paths.items())
        ),
    ]


def _dimensions(plan: Panel, subject: _Subject) -> list[str]:
    px, base = 1 / plan.scale, subject.base_mm
    # below the prism where the lens leaves room, else below the lens
    rows = (base - 16 * px, base - 44 * px) if base > _ROOM_PX * px else (-30 * px, -56 * px)
    return [
        *_baseline_dimension(plan, subject, rows[1]),
        *_prism_dimensions(plan, subject, rows[0]),
        *_mirror_dimensions(plan, subject, rows[1]),
    ]


def _baseline_dimension(plan: Panel, subject: _Subject, row: float) -> list[str]:
    (left_x, left_z), (right_x, right_z) = (subject.paths[side].viewpoint_mm for side in _SIDES)
    low = min(left_z, right_z, row, -14 / plan.scale) - 34 / plan.scale
    return [
        plan.line([(left_x, left_z), (left_x, low)], "dimension"),
        plan.line([(right_x, right_z), (right_x, low)], "dimension"),
        *plan.dimension((left_x, low), (right_x, low), f"baseline {subject.found.baseline_mm:.1f} mm"),
    ]


def _prism_dimensions(plan: Panel, subject: _Subject, row: float) -> list[str]:
    px, base, half = 1 / plan.scale, subject.base_mm, subject.rig.prism.side_mm / 2
    outside = -half - 20 * px
    return [
        *(plan.line([(x, base), (x, row - 4 * px)], "dimension") for x in (-half, half)),
        *plan.dimension((-half, row), (half, row), f"prism side {subject.rig.prism.side_mm:g}", 13.0),
        plan.line([(-half, base), (outside - 6 * px, base)], "dimension"),
        plan.line([(0, 0), (outside - 6 * px, 0)], "dimension"),
        *plan.dimension((outside, 0), (outside, base), f"{base:.1f}"),
    ]


def _mirror_dimensions(plan: Panel, subject: _Subject, row: float) -> list[str]:
    mirrors, base, px = subject.rig.mirrors, subject.base_mm, 1 / plan.scale
    (near_x, near_z), (far_x, far_z) = subject.near_edge, subject.far_edge
    mu, aside, outside = math.radians(mirrors.angle_deg), 14 * px, near_x + 48 * px
    beside = (aside * math.sin(mu), -aside * math.cos(mu))
    arc = [
        (near_x + 40 * px * math.cos(mu * step / 12), near_z + 40 * px * math.sin(mu * step / 12)) for step in range(13)
    ]
    return [
        plan.line([(subject.rig.prism.side_mm / 2, base), (outside + 6 * px, base)], "dimension"),
        plan.line([(near_x, near_z), (outside + 6 * px, near_z)], "dimension"),
        *plan.dimension((outside, base), (outside, near_z), f"{mirrors.offset_mm:.1f}", 13.0),
        plan.line([(near_x, near_z), (near_x, row - 4 * px)], "dimension"),
        *plan.dimension((0, row), (near_x, row), f"{near_x:.1f}", 13.0),
        *plan.dimension(
            (near_x + beside[0], near_z + beside[1]),
            (far_x + beside[0], far_z + beside[1]),
            f"mirror {mirrors.length_mm:g}",
            13.0,
        ),
        plan.line(arc, "dimension"),
        plan.label((near_x + 54 * px, near_z + 10 * px), f"{mirrors.angle_deg:.2f}\N{DEGREE SIGN}", "small", "start"),
    ]


def _field_panel(subject: _Subject) -> Panel:
    low, top = subject.found.viewpoint_mm[1], _height_mm(subject, _depths_mm(subject)[1])
    wide = 1.05 * max(float(abs(path.at_depth(top)).max()) for path in subject.paths.values())
    below = min(low, 0.0) - 0.02 * top
    return Panel(_RIG_PX + 40, _TOP_PX + 20, _FIELD_PX, _PANEL_HEIGHT_PX - 40, (-wide, below), (wide, top))


def _depths_mm(subject: _Subject) -> tuple[float, float]:
    """Return the depths of the near end, and of the far end or of how far the field is shown."""
    wish = subject.rig.range
    return wish.near_mm, min(wish.far_mm, _FIELD_NEARS * wish.near_mm)


def _height_mm(subject: _Subject, depth_mm: float) -> float:
    """Return z in the rig frame at a depth, which counts from the viewpoints."""
    return depth_mm + subject.found.viewpoint_mm[1]


def _fans(field: Panel, subject: _Subject) -> list[str]:
    near, top = (_height_mm(subject, depth) for depth in _depths_mm(subject))
    drawn = []
    for side, path in subject.paths.items():
        ends = path.at_depth(top)
        corners = [path.viewpoint_mm, (float(ends.min()), top), (float(ends.max()), top)]
        drawn += [
            field.line(corners, f"{side} area", closed=True),
            field.line([corners[1], corners[0], corners[2]], side),
            field.dot(path.viewpoint_mm, f"{side} camera", 3.0),
        ]
    outline = _common_outline(subject, near, top)
    return [*drawn, field.line(outline, "both area", closed=True)] if outline else drawn


def _common(subject: _Subject, z_mm: float) -> Point | None:
    """Return the borders of the field that both views share at a height z; None where there is none."""
    ends = [path.at_depth(z_mm) for path in subject.paths.values()]
    begin, end = max(float(x.min()) for x in ends), min(float(x.max()) for x in ends)
    return (begin, end) if begin < end else None


def _common_outline(subject: _Subject, low_mm: float, top_mm: float) -> list[Point]:
    heights = [low_mm + (top_mm - low_mm) * step / 60 for step in range(61)]
    spans = [(span, z) for z in heights if (span := _common(subject, z)) is not None]
    return [(span[0], z) for span, z in spans] + [(span[1], z) for span, z in reversed(spans)]


def _field_marks(field: Panel, subject: _Subject) -> list[str]:
    near, reach = _depths_mm(subject)
    edge = field.high[0]
    drawn = []
    for depth, end in ((near, "near end"), (reach, "far end" if reach == subject.rig.range.far_mm else "and on")):
        z = _height_mm(subject, depth)
        span = _common(subject, z)
        width = f", {span[1] - span[0]:.0f} mm common" if span else ", nothing in common"
        drawn += [
            field.line([(-edge, z), (edge, z)], "dimension"),
            field.label((0, z + 5 / field.scale), f"{depth:.0f} mm: {end}{width}", "small"),
        ]
    words_at = (0, field.low[1] - 14 / field.scale)
    return [*drawn, field.label(words_at, "the viewpoints, at the scale of their field", "small")]


def _legend() -> list[str]:
    y = _HEIGHT_PX - 18
    entries = ((24, "left", "left view"), (130, "right", "right view"), (244, "both", "seen by both"))
    boxes = [
        f'<rect x="{x}" y="{y - 10}" width="16" height="12" class="{style} area"/>' + words(x + 22, y, meaning, "small")
        for x, style, meaning in entries
    ]
    return [*boxes, words(370, y, "broken: back to the virtual viewpoints. Lengths in mm.", "small")]
