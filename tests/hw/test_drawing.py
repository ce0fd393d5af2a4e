"""The drawing: well-formed, to scale, with the dimensions of the rig and the rays of the exact optics."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.sketch.drawing import draw
from prismstereo_hw.sketch.ray_drawing import draw_rays
from prismstereo_hw.sketch.ray_paths import ray_paths
from prismstereo_hw.sketch.svg import Panel, document

SVG = "{http://www.w3.org/2000/svg}"
Shape = list[tuple[float, float]]


def shapes(picture: ET.Element, style: str) -> list[Shape]:
    found = [
        element for element in picture.iter() if element.get("class") == style and element.get("points") is not None
    ]
    return [[tuple(map(float, pair.split(","))) for pair in element.get("points", "").split()] for element in found]


@pytest.fixture(scope="module")
def picture(rig: Rig) -> ET.Element:
    return ET.fromstring(draw(rig))


def test_the_drawing_is_one_picture_with_a_title_and_a_background(rig: Rig, picture: ET.Element) -> None:
    assert picture.tag == f"{SVG}svg"
    assert rig.name in (picture.findtext(f"{SVG}title") or "")
    background = picture.find(f"{SVG}rect")
    assert background is not None
    assert background.get("fill") == "var(--paper)"
    style = picture.findtext(f"{SVG}style") or ""
    assert "prefers-color-scheme: dark" in style


def test_every_shape_lies_on_the_paper(picture: ET.Element) -> None:
    width, height = float(picture.get("width", "0")), float(picture.get("height", "0"))
    points = [
        tuple(map(float, pair.split(","))) for element in picture.iter() for pair in element.get("points", "").split()
    ]
    assert len(points) > 100
    assert all(0 <= x <= width and 0 <= y <= height for x, y in points)
    words = [(float(t.get("x", "nan")), float(t.get("y", "nan"))) for t in picture.iter(f"{SVG}text")]
    assert all(0 <= x <= width and 0 <= y <= height for x, y in words)


def test_every_class_that_is_used_has_a_style(picture: ET.Element) -> None:
    style = picture.findtext(f"{SVG}style") or ""
    used = {name for element in picture.iter() for name in (element.get("class") or "").split()}
    assert {name for name in used if f".{name}" not in style} <= {"camera"}


def test_the_parts_are_to_scale(rig: Rig, picture: ET.Element) -> None:
    (prism,) = shapes(picture, "glass")
    scale = math.dist(prism[0], prism[1]) / rig.prism.side_mm
    assert math.dist(prism[1], prism[2]) == pytest.approx(rig.prism.side_mm * scale, rel=1e-3)
    mirrors = shapes(picture, "mirror")
    assert len(mirrors) == 2
    for begin, end in mirrors:
        assert math.dist(begin, end) == pytest.approx(rig.mirrors.length_mm * scale, rel=1e-3)
        steep = math.degrees(math.atan2(begin[1] - end[1], abs(end[0] - begin[0])))
        assert steep == pytest.approx(rig.mirrors.angle_deg, abs=0.05)
    (pupil,) = shapes(picture, "pupil")
    assert prism[0][1] == pytest.approx(pupil[0][1] - rig.prism.pupil_to_prism_mm * scale, abs=0.02)


def test_the_dimensions_are_written_down(rig: Rig, picture: ET.Element) -> None:
    said = " | ".join(text.text or "" for text in picture.iter(f"{SVG}text"))
    for words in (
        f"baseline {figures(rig).baseline_mm:.1f} mm",
        f"prism side {rig.prism.side_mm:g}",
        f"mirror {rig.mirrors.length_mm:g}",
        f"{rig.mirrors.angle_deg:.2f}\N{DEGREE SIGN}",
        f"{rig.prism.pupil_to_prism_mm:.1f}",
        f"{rig.mirrors.offset_mm:.1f}",
        f"{rig.mirrors.near_edge_mm:.1f}",
        "left viewpoint",
        "right viewpoint",
        f"{rig.range.near_mm:.0f} mm: near end",
    ):
        assert words in said


def test_the_views_are_crossed_and_mirror_images_of_each_other(rig: Rig) -> None:
    left, right = ray_paths(rig, "left", 2), ray_paths(rig, "right", 2)
    assert np.all(left.points_mm[:, 1, 0] > 0)  # enters the prism on the right
    assert np.all(left.points_mm[:, -1, 0] < 0)  # leaves by the left mirror
    np.testing.assert_allclose(left.points_mm[::-1] * [-1, 1], right.points_mm, atol=1e-9)


def test_the_drawn_rays_end_where_the_exact_ones_do(rig: Rig) -> None:
    path = ray_paths(rig, "left", 5)
    entrance = path.points_mm[:, 1]
    slopes = np.stack([entrance[:, 0] / entrance[:, 1], np.zeros(5)], axis=-1)
    exact = view_fates(rig, "left", slopes)
    np.testing.assert_allclose(exact.point_mm[:, [0, 2]], path.points_mm[:, -1], atol=1e-9)
    np.testing.assert_allclose(exact.direction[:, [0, 2]], path.direction, atol=1e-12)


def test_a_panel_keeps_shapes_and_turns_z_upwards() -> None:
    panel = Panel(10, 20, 200, 100, (-1.0, 0.0), (1.0, 4.0))
    assert panel.scale == 25
    assert panel.at((0.0, 2.0)) == (110, 70)
    assert panel.at((1.0, 3.0)) == (135, 45)


def test_words_cannot_break_the_picture() -> None:
    panel = Panel(0, 0, 100, 100, (0.0, 0.0), (1.0, 1.0))
    text = document(100, 100, "<&>", [panel.label((0.5, 0.5), "a < b & c")])
    assert ET.fromstring(text).findtext(f"{SVG}text") == "a < b & c"


@pytest.mark.parametrize(
    ("name", "baseline_mm"),
    [
        ("two-mirrors", 110.26),
        ("three-mirrors", 60.0),
        ("single-mirror", 120.0),
        ("four-mirrors", 76.19),
        ("wedge", 177.9),
    ],
)
def test_rigs_of_mirrors_alone_are_drawn_with_the_viewpoints_of_the_reference(name: str, baseline_mm: float) -> None:
    picture = ET.fromstring(draw_rays(Rig.read(name)))
    said = [text.text or "" for text in picture.iter(f"{SVG}text")]
    (apart,) = (words for words in said if words.startswith("viewpoints "))
    assert float(apart.split()[1]) == pytest.approx(baseline_mm, abs=0.06)
    assert {"left viewpoint", "right viewpoint", "entrance pupil"} <= set(said)
    assert shapes(picture, "mirror")


@pytest.mark.parametrize("name", ["biprism", "plate"])
def test_rigs_of_glass_are_drawn_with_the_surfaces_that_bend_their_rays(name: str) -> None:
    picture = ET.fromstring(draw_rays(Rig.read(name)))
    assert len(shapes(picture, "glass")) >= 3
    assert all(len(way) == 4 for way in shapes(picture, "left"))  # pupil, into the glass, out of it, and on


def test_a_prism_rig_can_be_drawn_without_its_dimensions_too(rig: Rig) -> None:
    picture = ET.fromstring(draw_rays(rig))
    width, height = float(picture.get("width", "0")), float(picture.get("height", "0"))
    for way in shapes(picture, "left") + shapes(picture, "right"):
        assert len(way) == 6
        assert all(0 <= x <= width and 0 <= y <= height for x, y in way)
