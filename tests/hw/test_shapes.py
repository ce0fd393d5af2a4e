"""Shapes: where rays meet them, which way they face, how they move, and that engines of one kind agree with the other."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import Scene, named
from prismstereo_hw.shapes.box import Box
from prismstereo_hw.shapes.face import Face
from prismstereo_hw.shapes.height_field import HeightField
from prismstereo_hw.shapes.heights import GridHeights
from prismstereo_hw.shapes.mesh import Mesh
from prismstereo_hw.shapes.pose import Motion, Pose
from prismstereo_hw.shapes.rectangle import Ground, Rectangle
from prismstereo_hw.shapes.shape import Shape
from prismstereo_hw.shapes.sphere import Sphere
from prismstereo_hw.shapes.triangles import MOST_BY_NUMPY, Triangles, box_triangles, cylinder_triangles
from prismstereo_hw.texture import Noise, Plain

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)
CENTRE = np.array([30.0, -20.0, 500.0])
HALF = (40.0, 25.0, 60.0)
NOISE = Noise(seed=3, texel_mm=0.4)
PACE = st.tuples(*[st.floats(-200, 200)] * 3)
SECONDS = st.floats(-3, 3)
WITH_EMBREE = importlib.util.find_spec("trimesh") is not None and importlib.util.find_spec("embreex") is not None


def turned(seed: int = 5) -> Pose:
    """A pose that is along no axis."""
    return Pose(CENTRE, Motion(spin_deg_s=(40.0, -65.0, 20.0 + seed)).turn(1.0))


def rays(rng: np.random.Generator, count: int, aim: Array = CENTRE, spread: float = 90.0) -> tuple[Array, Array]:
    """Rays from around the origin to around an aim, unit directions."""
    origin = rng.uniform(-150, 150, (count, 3))
    ahead = aim + rng.uniform(-spread, spread, (count, 3)) - origin
    return origin, ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def met(shape: Shape, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
    """The points where rays meet a shape, their directions, and which rays they are."""
    reach = shape.distance(origin, direction)
    hit = np.isfinite(reach)
    return origin[hit] + reach[hit, None] * direction[hit], direction[hit], hit


def one_of_each() -> list[Shape]:
    """One of each kind, all about the same place."""
    pose, motion = turned(), Motion((30.0, -10.0, 5.0), (0.0, 50.0, 20.0))
    bowl = GridHeights(np.array([[0.0, 4, 9], [1, -6, 3], [5, 2, 8], [0, 3, 1]]), 50.0, 60.0)
    return [
        Sphere("ball", pose, 50.0, NOISE, motion),
        Box("box", pose, HALF, NOISE, motion),
        HeightField("bowl", pose, bowl, NOISE, motion),
        HeightField("face", pose, Face(), NOISE, motion),
        Mesh("can", pose, cylinder_triangles(40.0, 30.0), NOISE, motion=motion),
        Rectangle("sheet", CENTRE, pose.R[:, 0], pose.R[:, 1], 60.0, 40.0, NOISE, spin_deg_s=(0.0, 50.0, 20.0)),
    ]


SHAPES = pytest.mark.parametrize("shape", one_of_each(), ids=lambda shape: shape.name)


def test_rays_meet_a_ball_on_its_near_side_at_its_radius(rng: np.random.Generator) -> None:
    ball = Sphere("ball", Pose(CENTRE), 50.0, NOISE)
    point, direction, hit = met(ball, *rays(rng, 4000))
    assert 500 < hit.sum() < 3900
    np.testing.assert_allclose(np.linalg.norm(point - CENTRE, axis=1), 50.0, rtol=1e-12)
    assert np.all(np.einsum("ni,ni->n", ball.normals(point), direction) < 0)
    straight = ball.distance(np.array([[30.0, -20.0, 0.0], [30.0, 30.1, 0.0], CENTRE]), np.array([Z, Z, Z]))
    np.testing.assert_allclose(straight, [450.0, np.inf, 50.0])  # ahead, beside, and from the middle out


def test_a_far_small_ball_is_met_as_exactly_as_a_near_one() -> None:
    ball = Sphere("ball", Pose(np.array([0.0, 0.0, 3e6])), 1.0, NOISE)
    np.testing.assert_allclose(ball.distance(np.array([[0.6, 0.0, 0.0]]), Z[None]), 3e6 - 0.8, atol=1e-8)


def test_a_box_is_met_at_its_planes(rng: np.random.Generator) -> None:
    box = Box("box", Pose(CENTRE), HALF, NOISE)
    ahead = np.array([[30.0, -20.0, 0.0], [69.9, -20.0, 0.0], [70.1, -20.0, 0.0], [30.0, 4.9, 0.0], CENTRE])
    np.testing.assert_allclose(box.distance(ahead, np.tile(Z, (5, 1))), [440.0, 440.0, np.inf, 440.0, 60.0])
    np.testing.assert_array_equal(box.distance(np.array([[30.0, -20.0, 600.0]]), Z[None]), [np.inf])  # behind the ray
    point, direction, hit = met(Box("box", turned(), HALF, NOISE), *rays(rng, 4000))
    assert 500 < hit.sum() < 3900
    beyond = np.abs(turned().to_body(point)) - HALF
    np.testing.assert_allclose(beyond.max(axis=1), 0.0, atol=1e-10)
    assert np.all(np.einsum("ni,ni->n", Box("box", turned(), HALF, NOISE).normals(point), direction) < 0)


def test_the_six_faces_of_a_box_look_different_and_turn_with_it() -> None:
    box, fine = Box("box", Pose(CENTRE), (40.0, 40.0, 40.0), NOISE), np.full(50, 0.2)
    a, b = np.random.default_rng(1).uniform(-39, 39, (2, 50))
    flat = np.full(50, 40.0)
    sides = [np.stack(np.roll([s * flat, a, b], axis, axis=0), axis=1) for axis in range(3) for s in (-1, 1)]
    greys = [box.shade(CENTRE + side, fine) for side in sides]
    assert max(abs(np.corrcoef(greys)[np.triu_indices(6, 1)])) < 0.6
    pose = turned()
    again = [Box("box", pose, (40.0, 40.0, 40.0), NOISE).shade(CENTRE + side @ pose.R.T, fine) for side in sides]
    np.testing.assert_allclose(again, greys, atol=0.1)  # textures are looked up in 32 bits


def test_a_mesh_of_a_box_is_the_box(rng: np.random.Generator) -> None:
    pose, motion = turned(), Motion((10.0, 0.0, 5.0), (0.0, 30.0, 0.0))
    mesh = Mesh("mesh", pose, box_triangles(HALF), NOISE, motion=motion).at(0.7)
    box = Box("box", pose, HALF, NOISE, motion).at(0.7)
    origin, direction = rays(rng, 5000)
    np.testing.assert_allclose(mesh.distance(origin, direction), box.distance(origin, direction), rtol=0, atol=1e-9)
    point, _, _ = met(box, origin, direction)
    np.testing.assert_allclose(mesh.normals(point), box.normals(point), atol=1e-12)


def test_a_closed_mesh_lets_no_ray_through_its_edges() -> None:
    box = Mesh("box", Pose(CENTRE), box_triangles((10.0, 10.0, 10.0)), NOISE)
    grid = np.stack(np.meshgrid(np.linspace(-9.99, 9.99, 101), np.linspace(-9.99, 9.99, 101)), axis=-1).reshape(-1, 2)
    origin = np.column_stack([grid + CENTRE[:2], np.zeros(len(grid))])  # many of them on the faces' diagonals
    np.testing.assert_allclose(box.distance(origin, np.broadcast_to(Z, origin.shape)), 490.0, atol=1e-9)


def test_vertex_greys_run_linearly_over_a_triangle() -> None:
    corners = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])
    mesh = Mesh(
        "one", Pose(CENTRE), Triangles(corners, np.array([[0, 1, 2]])), vertex_grey=np.array([20.0, 120.0, 220.0])
    )
    inside = np.array([[1.0, 1, 0], [5, 5, 0], [2, 6, 0], [10, 0, 0]])
    np.testing.assert_allclose(mesh.shade(inside + CENTRE, np.ones(4)), [50.0, 170.0, 160.0, 120.0], atol=1e-6)


def test_a_many_sided_can_is_round() -> None:
    can = Mesh("can", Pose(CENTRE), cylinder_triangles(40.0, 30.0, sides=200), NOISE)
    start = np.array([[30.0, -20.0, 0.0], [30.0, -200.0, 500.0], [69.0, -200.0, 500.0], [71.0, -200.0, 500.0]])
    reach = can.distance(start, np.array([Z, Y, Y, Y]))
    np.testing.assert_allclose(reach[:3], [470.0, 140.0, 180 - math.sqrt(40**2 - 39**2)], atol=0.01)
    assert reach[3] == np.inf
    outward = np.einsum("fi,fi->f", can.triangles.normals, np.mean(can.triangles.corners, axis=0))
    assert np.all(outward > 0)


@pytest.mark.skipif(not WITH_EMBREE, reason="Embree: install the extra `twin`")
def test_embree_and_numpy_meet_the_same_triangles(rng: np.random.Generator) -> None:
    can = cylinder_triangles(40.0, 30.0, sides=300)
    origin, direction = rays(rng, 3000)
    cans = [Mesh("can", turned(), Triangles(can.vertices, can.faces, embree), NOISE) for embree in (False, True)]
    reaches = [mesh.distance(origin, direction) for mesh in cans]
    same = np.isfinite(reaches[0]) == np.isfinite(reaches[1])
    assert same.mean() > 0.999  # rims in 32 bits
    both = np.isfinite(reaches[0]) & np.isfinite(reaches[1])
    assert both.sum() > 300
    assert np.mean(np.abs(reaches[0][both] - reaches[1][both]) < 1e-9) > 0.99  # else the facet next door, near an edge
    np.testing.assert_allclose(reaches[0][both], reaches[1][both], atol=0.01)
    point, _, _ = met(cans[0], origin, direction)
    alike = np.einsum("ni,ni->n", cans[0].normals(point), cans[1].normals(point))
    assert np.mean(alike > 1 - 1e-12) > 0.98
    assert alike.min() > 0.99  # the facet next door


@pytest.mark.skipif(WITH_EMBREE, reason="the extra `twin` is installed: large meshes work")
def test_a_large_mesh_without_embree_names_the_extra() -> None:
    sides = MOST_BY_NUMPY // 4 + 1
    large = Mesh("can", Pose(CENTRE), cylinder_triangles(40.0, 30.0, sides), NOISE)
    with pytest.raises(
        UsageError, match=r"2004 triangles needs Embree.*pip install 'prismstereo\[twin\]'.*at most 2000"
    ):
        large.distance(np.zeros((1, 3)), CENTRE[None] / np.linalg.norm(CENTRE))


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        ([[0, 1, 3]], "vertices 0 to 3, but there are 3"),
        ([[0, 1]], r"faces \(1, 2\)"),
        ([[0, 1, -1]], "vertices -1 to 1"),
    ],
)
def test_triangles_that_cannot_be_are_refused(faces: list[list[int]], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Triangles(np.eye(3), np.array(faces))


def test_a_mesh_has_one_look() -> None:
    with pytest.raises(UsageError, match="either a texture or a grey level"):
        Mesh("bare", Pose(CENTRE), box_triangles(HALF))
    with pytest.raises(UsageError, match=r"\(3,\) grey levels for 8 vertices"):
        Mesh("odd", Pose(CENTRE), box_triangles(HALF), vertex_grey=np.zeros(3))


def test_a_tilted_flat_grid_of_heights_is_a_plane(rng: np.random.Generator) -> None:
    y, x = np.meshgrid(np.linspace(-60, 60, 13), np.linspace(-80, 80, 17), indexing="ij")
    sheet = HeightField("sheet", turned(), GridHeights(0.3 * x - 0.2 * y + 5, 80.0, 60.0), NOISE)
    origin, direction = rays(rng, 3000)
    o, d = turned().to_body(origin), turned().direction_to_body(direction)
    normal = np.array([-0.3, 0.2, 1.0])
    expected = (5 - o @ normal) / (d @ normal)
    at = o + expected[:, None] * d
    inside = (np.abs(at[:, 0]) < 80) & (np.abs(at[:, 1]) < 60) & (expected > 0)
    assert inside.sum() > 200
    np.testing.assert_allclose(sheet.distance(origin, direction), np.where(inside, expected, np.inf), atol=1e-4)


def test_rays_meet_a_face_on_its_skin_and_never_beyond_it(rng: np.random.Generator) -> None:
    face = HeightField("face", turned(), Face(), NOISE).at(0.8)
    origin, direction = rays(rng, 1500, spread=60.0)
    reach = face.distance(origin, direction)
    assert np.isfinite(reach).mean() > 0.4
    point, _, _ = met(face, origin, direction)
    body = turned().to_body(point)
    np.testing.assert_allclose(body[:, 2], face.heights.height(body[:, 0], body[:, 1]), atol=1e-5)
    for way in np.linspace(0.02, 0.998, 150):  # on the way there, every ray is on one side of the sheet
        before = turned().to_body(origin + (way * np.where(np.isfinite(reach), reach, 0))[:, None] * direction)
        outside = (np.abs(before[:, 0]) > face.heights.half_x_mm) | (np.abs(before[:, 1]) > face.heights.half_y_mm)
        gap = before[:, 2] - face.heights.height(before[:, 0], before[:, 1])
        arriving = turned().to_body(origin + (0.9999 * np.where(np.isfinite(reach), reach, 0))[:, None] * direction)
        side = np.sign(arriving[:, 2] - face.heights.height(arriving[:, 0], arriving[:, 1]))
        entered = ~outside & np.isfinite(reach)
        wrong = entered & (np.sign(gap) != side)
        assert not wrong.any()


@pytest.mark.parametrize(
    "heights", [Face(), Face(head_mm=90.0).at(1.0), one_of_each()[2].heights], ids=["face", "open", "grid"]
)
def test_heights_keep_their_promises(heights: Face | GridHeights, rng: np.random.Generator) -> None:
    x, y = rng.uniform(-1, 1, 4000) * heights.half_x_mm, rng.uniform(-1, 1, 4000) * heights.half_y_mm
    by_x, by_y = heights.gradient(x, y)
    step = 1e-5
    np.testing.assert_allclose(by_x, (heights.height(x + step, y) - heights.height(x - step, y)) / 2e-5, atol=1e-5)
    np.testing.assert_allclose(by_y, (heights.height(x, y + step) - heights.height(x, y - step)) / 2e-5, atol=1e-5)
    assert np.hypot(by_x, by_y).max() <= heights.steepest()
    low, high = heights.limits_mm()
    assert low <= heights.height(x, y).min() < heights.height(x, y).max() <= high


def test_a_grid_of_heights_goes_through_its_numbers_without_creases() -> None:
    grid = np.random.default_rng(8).uniform(-5, 5, (6, 9))
    heights = GridHeights(grid, 40.0, 25.0)
    y, x = np.meshgrid(np.linspace(-25, 25, 6), np.linspace(-40, 40, 9), indexing="ij")
    np.testing.assert_allclose(heights.height(x.ravel(), y.ravel()), grid.ravel(), atol=1e-12)
    before, after = (heights.gradient(np.array([10.0 + step]), np.array([3.0])) for step in (-1e-9, 1e-9))
    np.testing.assert_allclose(before, after, atol=1e-6)
    with pytest.raises(UsageError, match=r"shape \(1, 5\)"):
        GridHeights(np.zeros((1, 5)), 1.0, 1.0)


def test_a_face_has_a_nose_and_opens_its_mouth() -> None:
    shut, spoken = Face(), Face().at(1.0)
    place = {
        "nose": (0, -12),
        "cheek": (34, -14),
        "eye": (23, 23),
        "brow": (24, 38),
        "mouth": (0, -45),
        "chin": (0, -80),
    }
    x, y = np.array(list(place.values()), float).T
    now, then = (dict(zip(place, face.height(x, y), strict=True)) for face in (shut, spoken))
    assert now["nose"] > now["cheek"] + 15
    assert now["brow"] > now["eye"] + 3
    assert now["mouth"] - then["mouth"] > 12  # the mouth is open
    assert now["nose"] == pytest.approx(then["nose"], abs=0.2)  # and the nose stays
    assert then["chin"] > now["chin"] + 2  # while the chin has come down to there
    np.testing.assert_allclose(Face().at(2.0).height(x, y), shut.height(x, y))  # once round


@SHAPES
def test_a_point_of_a_shape_is_not_met_again_by_the_ray_that_leaves_it(shape: Shape, rng: np.random.Generator) -> None:
    point, direction, _ = met(shape, *rays(rng, 2000, spread=40.0))
    normal = shape.normals(point)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    towards_us = normal * -np.sign(np.einsum("ni,ni->n", normal, direction))[:, None]
    back = shape.distance(point + 1e-3 * towards_us, -direction)
    assert np.mean(np.isfinite(back)) < 0.002


@pytest.mark.parametrize("shape", [s for s in one_of_each() if s.name != "face"], ids=lambda shape: shape.name)
def test_a_shape_looks_the_same_however_it_stands(shape: Shape, rng: np.random.Generator) -> None:
    point, _, _ = met(shape, *rays(rng, 400))
    body = (point - CENTRE) @ turned().R
    later = Motion(shape.velocity_mm_s, shape.spin_deg_s) if isinstance(shape, Rectangle) else shape.motion
    pose = turned().at(later, 0.9)
    moved = shape.at(0.9).shade(body @ pose.R.T + pose.centre_mm, np.full(len(body), 0.5))
    np.testing.assert_allclose(moved, shape.shade(point, np.full(len(body), 0.5)), atol=0.1)


@SHAPES
def test_a_texture_is_averaged_by_the_pixel_that_sees_it(shape: Shape, rng: np.random.Generator) -> None:
    point, _, _ = met(shape, *rays(rng, 4000))
    fine, coarse = (np.std(shape.shade(point, np.full(len(point), size))) for size in (0.5, 40.0))
    assert coarse < 0.7 * fine


def test_noise_on_a_ball_has_no_seam() -> None:
    ball = Sphere("ball", turned(), 50.0, NOISE)
    angle = np.linspace(0, 2 * math.pi, 40_000)
    for axes in ((X, Y), (Y, Z), (Z, X)):  # great circles through all poles
        round_it = np.outer(np.cos(angle), axes[0]) + np.outer(np.sin(angle), axes[1])
        grey = ball.shade(CENTRE + 50.0 * round_it @ turned().R.T, np.full(len(angle), 1.0))
        assert np.abs(np.diff(grey)).max() < 3  # 0.008 mm on
        assert grey.std() > 8


@given(PACE, PACE, SECONDS, SECONDS)
def test_moving_twice_is_moving_for_both_times_and_stays_rigid(
    pace: tuple[float, float, float], spin: tuple[float, float, float], one: float, other: float
) -> None:
    motion = Motion(pace, spin)
    twice, once = turned().at(motion, one).at(motion, other), turned().at(motion, one + other)
    np.testing.assert_allclose(twice.R, once.R, atol=1e-9)
    np.testing.assert_allclose(twice.centre_mm, once.centre_mm, atol=1e-9)
    np.testing.assert_allclose(once.R @ once.R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(once.R) == pytest.approx(1.0)


@settings(max_examples=40)
@given(PACE, PACE, SECONDS)
def test_a_ray_that_moves_along_meets_the_thing_at_the_same_distance(
    pace: tuple[float, float, float], spin: tuple[float, float, float], seconds: float
) -> None:
    motion, pose = Motion(pace, spin), turned()
    later = pose.at(motion, seconds)
    origin, direction = rays(np.random.default_rng(4), 40)
    along = (origin - pose.centre_mm) @ pose.R @ later.R.T + later.centre_mm
    turned_too = direction @ pose.R @ later.R.T
    for shape in (Box("box", pose, HALF, NOISE, motion), Sphere("ball", pose, 50.0, NOISE, motion)):
        before, after = shape.distance(origin, direction), shape.at(seconds).distance(along, turned_too)
        np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-4)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    sheet = Rectangle(
        "sheet", CENTRE, X, Y, 60.0, 40.0, Plain(), velocity_mm_s=(10.0, 0.0, 0.0), spin_deg_s=(0.0, 0.0, 90.0)
    )
    later = sheet.at(1.0)
    np.testing.assert_allclose(later.u, Y, atol=1e-12)
    np.testing.assert_allclose(later.v, -X, atol=1e-12)
    np.testing.assert_allclose(later.centre_mm, CENTRE + 10.0 * X)


def test_the_far_ground_does_not_flicker() -> None:
    plane = Rectangle("plane", np.array([0.0, 600.0, 0.0]), X, Z, np.inf, np.inf, Noise(seed=2, texel_mm=2.0))
    ground = Ground(plane, np.zeros(3))
    x = np.random.default_rng(6).uniform(-2000, 2000, 500)

    def flicker(shape: Shape) -> float:
        """Change of grey from one pixel row to the next, 10 m away, over the contrast."""
        pixel = np.full(500, 10.0)
        lines = [
            shape.shade(np.column_stack([x, np.full(500, 600.0), np.full(500, z)]), pixel) for z in (1e4, 1e4 + 50)
        ]
        return float(np.std(lines[1] - lines[0]) / np.std(lines[0]))

    assert flicker(ground) < 0.6 * flicker(plane)


def test_scenes_hold_all_kinds_of_shapes(rng: np.random.Generator) -> None:
    scene = Scene("all", tuple(one_of_each())).at(0.5)
    origin, direction = rays(rng, 2000)
    reach, which = scene.first_hit(origin, direction)
    alone = np.array([shape.distance(origin, direction) for shape in scene.surfaces])
    np.testing.assert_array_equal(reach, alone.min(axis=0))
    np.testing.assert_array_equal(which, np.where(np.isfinite(reach), alone.argmin(axis=0), -1))


@pytest.mark.parametrize("name", ["sphere:900", "face", "toy-car", "street"])
def test_a_named_scene_is_made_by_its_seed_and_shows_its_things(name: str, rig: Rig) -> None:
    scene, again, other = (named(rig, name, seed) for seed in (1, 1, 2))
    slopes = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 90), np.linspace(-0.4, 0.4, 70)), axis=-1).reshape(-1, 2)
    direction = np.column_stack([slopes, np.ones(len(slopes))])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin, way = np.zeros_like(direction), np.zeros(len(direction))
    greys = [one.shade(origin, direction, way, 900.0) for one in (scene, again, other)]
    np.testing.assert_array_equal(greys[0], greys[1])
    assert np.mean(np.abs(greys[0] - greys[2])) > 5
    reach, which = scene.first_hit(origin, direction)
    shown = {"sphere:900": 2, "face": 2, "toy-car": 6, "street": 7}[name]  # of the car, the far wheels may be hidden
    assert len(set(which[which >= 0].tolist())) >= shown
    later = scene.at(0.4).shade(origin, direction, way, 900.0)
    changed = np.mean(np.abs(later - greys[0]) > 5)
    assert 0.0005 < changed < 0.5  # something moves, and most of it does not
    if name == "street":
        assert (reach * direction[:, 2])[which >= 0].max() < 31_000
        boxes = (which >= 0) & (which < 5)
        assert (reach * direction[:, 2])[boxes].min() > 2500
        assert np.isclose((reach * direction[:, 2])[which == 6], 30_000).all()
