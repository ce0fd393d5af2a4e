"""Light: Lambert's law, soft shadows where geometry puts them, none on what casts them, and slow changes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.light import Light
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import Rectangle, Scene, named
from prismstereo_hw.shapes.face import Face
from prismstereo_hw.shapes.height_field import HeightField
from prismstereo_hw.shapes.heights import GridHeights
from prismstereo_hw.shapes.mesh import Mesh
from prismstereo_hw.shapes.pose import Pose
from prismstereo_hw.shapes.shape import Shape
from prismstereo_hw.shapes.sphere import Sphere
from prismstereo_hw.shapes.triangles import cylinder_triangles
from prismstereo_hw.texture import Plain

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)
CENTRE = np.array([0.0, 0.0, 500.0])
TOWARDS_US = (0.0, 0.0, -1.0)
FULL = {"ambient": 0.0, "strength": 1.0}
WALL = Rectangle("wall", np.array([0.0, 0.0, 800.0]), X, Y, np.inf, np.inf, Plain(100.0))


def seen(scene: Scene, x_mm: Array | list[float], y_mm: float = 0.0) -> Array:
    """What straight rays at x, y show."""
    origin = np.array([[x, y_mm, 0.0] for x in x_mm])
    return scene.shade(origin, np.broadcast_to(Z, origin.shape), np.zeros(len(origin)), 1000.0)


def test_without_a_light_things_are_as_bright_as_their_texture() -> None:
    ball = Sphere("ball", Pose(CENTRE), 50.0, Plain(70.0))
    np.testing.assert_array_equal(seen(Scene("bare", (ball,), 12.0), [0.0, 49.0, 51.0]), [70.0, 70.0, 12.0])


def test_pixels_see_patches_as_large_as_the_whole_way_makes_them() -> None:
    class Ruler(Rectangle):
        """A wall that shows the size of the pixel that looks at it."""

        def shade(self, point: Array, pixel_mm: Array) -> Array:
            return pixel_mm

    ruler = Ruler("ruler", np.array([0.0, 0.0, 800.0]), X, Y, np.inf, np.inf, Plain())
    shown = Scene("ruler", (ruler,)).shade(np.zeros((2, 3)), np.array([Z, Z]), np.array([0.0, 200.0]), 100.0)
    np.testing.assert_allclose(shown, [8.0, 10.0])


@given(st.floats(0, 89), st.floats(0, 1))
def test_a_slanted_light_falls_with_the_cosine(angle_deg: float, ambient: float) -> None:
    angle = math.radians(angle_deg)
    light = Light((math.sin(angle), 0.0, -math.cos(angle)), ambient=ambient, strength=0.9)
    expected = 90 * (ambient + (1 - ambient) * math.cos(angle))
    np.testing.assert_allclose(seen(Scene("wall", (WALL,), light=light), [0.0]), expected)


def test_a_light_from_behind_leaves_the_ambient_share_and_the_background_is_no_surface() -> None:
    light = Light((0.0, 0.0, 1.0), ambient=0.3, strength=1.0)
    sheet = Rectangle("sheet", CENTRE, X, Y, 50.0, 50.0, Plain(100.0))
    np.testing.assert_allclose(seen(Scene("sheet", (sheet,), 200.0, light), [0.0, 60.0]), [30.0, 200.0])
    flipped = Rectangle("sheet", CENTRE, X, -Y, 50.0, 50.0, Plain(100.0))  # a sheet has two sides
    np.testing.assert_allclose(seen(Scene("sheet", (flipped,), 200.0, light), [0.0]), [30.0])


def test_a_ball_is_shaded_by_its_normals() -> None:
    ball = Sphere("ball", Pose(CENTRE), 50.0, Plain(100.0))
    shown = seen(Scene("ball", (ball,), light=Light(TOWARDS_US, **FULL)), [0.0, 30.0, 40.0])
    np.testing.assert_allclose(shown, [100.0, 80.0, 60.0])  # 3-4-5


def test_a_shadow_lies_where_the_light_puts_it_with_a_soft_rim() -> None:
    radius_deg, rays = 4.0, 64
    light = Light((-1.0, 0.0, -1.0), shadow_rays=rays, radius_deg=radius_deg, **FULL)
    ball = Sphere("ball", Pose(CENTRE), 40.0, Plain(100.0))
    scene = Scene("ball", (ball, WALL), light=light)
    x = np.arange(60.0, 600.0, 2.0)
    shown = seen(scene, x) / seen(scene, [-900.0])[0]
    middle, half = 300.0, 40 * math.sqrt(2)  # a light at 45 degrees: as far to the side as behind
    soft = 1.3 * math.hypot(300, 300) * math.tan(math.radians(radius_deg)) * math.sqrt(2)
    assert np.all(shown[np.abs(x - middle) < half - soft] < 1e-9)
    np.testing.assert_allclose(shown[np.abs(x - middle) > half + soft], 1.0, atol=0.01)
    rim = shown[(x > middle) & (np.abs(x - middle - half) < soft)]
    assert np.unique(rim.round(6)).size > 8  # many steps
    assert rim[0] < 0.2 < 0.8 < rim[-1]
    assert np.polyfit(np.arange(len(rim)), rim, 1)[0] > 0
    hard = seen(Scene("ball", (ball, WALL), light=Light((-1.0, 0.0, -1.0), **FULL)), x)
    np.testing.assert_allclose(hard, hard[0])  # shadows are off unless asked for


@pytest.mark.parametrize(
    "shape",
    [
        Sphere("ball", Pose(CENTRE), 50.0, Plain(100.0)),
        Mesh("can", Pose(CENTRE), cylinder_triangles(60.0, 40.0), Plain(100.0)),
        HeightField("face", Pose(CENTRE + 90.0 * Z, np.diag([1.0, -1.0, -1.0])), Face(), Plain(100.0)),
        Rectangle("sheet", CENTRE, X, Y, 70.0, 70.0, Plain(100.0)),
    ],
    ids=lambda shape: shape.name,
)
@pytest.mark.parametrize("far_mm", [0.0, 30_000.0])
def test_a_lit_side_has_no_speckle_of_its_own_shadow(shape: Shape, far_mm: float) -> None:
    """Seen from the light itself, nothing is in shadow; far away too, where floating point is coarser."""
    x, y = np.random.default_rng(3).uniform(-55, 55, (2, 3000))
    origin = np.column_stack([x, y, np.zeros(3000)])
    shift = np.array([far_mm, 0.0, far_mm])
    moved = (
        Pose(CENTRE + shift) if not isinstance(shape, HeightField) else Pose(shape.pose.centre_mm + shift, shape.pose.R)
    )
    if isinstance(shape, Rectangle):
        there: Shape = Rectangle("sheet", CENTRE + shift, X, Y, 70.0, 70.0, Plain(100.0))
    else:
        there = type(shape)(**{**{f: getattr(shape, f) for f in shape.__dataclass_fields__}, "pose": moved})
    rays = (origin + shift, np.broadcast_to(Z, origin.shape), np.zeros(3000), 1000.0)
    lights = (Light(TOWARDS_US, shadow_rays=count, radius_deg=0.01, **FULL) for count in (0, 3))
    open_, shadowed = (Scene("one", (there,), 0.0, light).shade(*rays) for light in lights)
    np.testing.assert_allclose(shadowed, open_, atol=0.1)


@pytest.mark.parametrize("slant_deg", [30.0, 60.0, 85.0])
def test_what_bulges_hides_no_light_from_itself(slant_deg: float) -> None:
    y, x = np.meshgrid(np.linspace(-60, 60, 9), np.linspace(-60, 60, 9), indexing="ij")
    dome = GridHeights(30 - (x**2 + y**2) / 150, 60.0, 60.0)  # splines keep a paraboloid as it is
    shapes: tuple[Shape, ...] = (
        HeightField("dome", Pose(CENTRE, np.diag([1.0, -1.0, -1.0])), dome, Plain(100.0)),
        Sphere("ball", Pose(CENTRE), 60.0, Plain(100.0)),
        Mesh("can", Pose(CENTRE), cylinder_triangles(60.0, 40.0), Plain(100.0)),
    )
    x, y = np.random.default_rng(9).uniform(-50, 50, (2, 3000))
    rays = (np.column_stack([x, y, np.zeros(3000)]), np.broadcast_to(Z, (3000, 3)), np.zeros(3000), 1000.0)
    angle = math.radians(slant_deg)
    towards = (math.sin(angle), 0.0, -math.cos(angle))
    lights = [Light(towards, shadow_rays=count, radius_deg=1e-6, **FULL) for count in (0, 1)]
    for shape in shapes:
        open_, shadowed = (Scene("one", (shape,), 0.0, light).shade(*rays) for light in lights)
        assert open_.max() > 5
        np.testing.assert_allclose(shadowed, open_, atol=0.01)


def test_a_nose_casts_its_shadow_on_the_cheek() -> None:
    face = HeightField("face", Pose(CENTRE + 90.0 * Z, np.diag([1.0, -1.0, -1.0])), Face(), Plain(100.0))
    x = np.linspace(-40, 40, 161)
    shown = [
        seen(Scene("face", (face,), light=Light((-1.0, 0.0, -0.45), shadow_rays=rays, radius_deg=1.0, **FULL)), x, 10.0)
        for rays in (0, 16)
    ]
    hidden = x[shown[0] - shown[1] > 5]
    assert hidden.size > 3
    assert np.all(hidden > 0)  # the light is on the left


def test_both_views_and_every_run_see_the_same_shadow() -> None:
    one, again, other = (Light((0.1, -1.0, -1.0), shadow_rays=7, seed=seed).points() for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, again)
    assert not np.allclose(one, other)
    np.testing.assert_allclose(np.linalg.norm(one, axis=1), 1.0)
    axis = np.array([0.1, -1.0, -1.0]) / math.hypot(0.1, 1, 1)
    assert np.degrees(np.arccos(one @ axis)).max() <= 3.0


def test_a_light_changes_slowly_and_scenes_take_it_along() -> None:
    light = Light(TOWARDS_US, ambient=0.5, strength=1.0, swing=0.2, period_s=8.0)
    scene = Scene("wall", (WALL,), light=light)
    shown = [seen(scene.at(seconds), [0.0])[0] for seconds in (0.0, 2.0, 4.0, 6.0, 8.0)]
    np.testing.assert_allclose(shown, [100.0, 120.0, 100.0, 80.0, 100.0])
    assert light.at(1.5).at(2.0) == light.at(3.5)


def test_a_bright_light_ends_at_white() -> None:
    assert seen(Scene("wall", (WALL,), light=Light(TOWARDS_US, strength=10.0)), [0.0]) == 255.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"towards": (0.0, 0.0, 0.0)}, "give a direction"),
        ({"ambient": 1.5}, "ambient 1.5"),
        ({"swing": -0.1}, "swing -0.1"),
        ({"period_s": 0.0}, "the period is positive"),
        ({"shadow_rays": 1000}, "1000 shadow rays"),
        ({"radius_deg": 50.0}, "50 degrees"),
    ],
)
def test_a_light_that_cannot_shine_is_refused(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Light(**{"towards": TOWARDS_US, **wrong})


def test_the_toy_car_has_a_shadow_on_the_table_that_drives_along(oak: Rig) -> None:
    scene = named(oak, "toy-car")
    assert scene.light is not None
    table = next(index for index, shape in enumerate(scene.surfaces) if shape.name == "table")
    slopes = np.stack(np.meshgrid(np.linspace(-0.3, 0.5, 120), np.linspace(0.05, 0.3, 60)), axis=-1).reshape(-1, 2)
    direction = np.column_stack([slopes, np.ones(len(slopes))])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin, way = np.zeros_like(direction), np.zeros(len(direction))
    middles = []
    for seconds in (0.0, 1.0):
        now = scene.at(seconds)
        reach, which = now.first_hit(origin, direction)
        bare = Scene("bare", tuple(s for s in now.surfaces if s.name in ("table", "wall")), light=now.light)
        darker = (which == table) & (
            now.shade(origin, direction, way, 900.0) < bare.shade(origin, direction, way, 900.0) - 3
        )
        assert darker.sum() > 20
        middles.append((reach[darker] * direction[darker, 0]).mean())
    assert middles[1] > middles[0] + 10
