from __future__ import annotations

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from host.export_frames import flat_calibration, frame_of, painted
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import FrameGeometry, Geometries
from prismstereo.measuring.patch import Patch
from prismstereo.reconstruction import Gates, Mesh, Steady, Surface, fill_small_holes, mesh_of
from prismstereo.reconstruction.disparity_noise import disparity_sigma
from prismstereo.reconstruction.grid_kernels import cut_grid, face_normals
from prismstereo.reconstruction.mesh_picture import Sight, mesh_picture
from prismstereo.reconstruction.mesh_ply import mesh_ply
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import Rig

NOISE_PX = 0.05


@pytest.fixture(scope="module")
def flat(small: Rig) -> Calibration:
    return flat_calibration(small)


@pytest.fixture(scope="module")
def made(flat: Calibration) -> Rectification:
    return rectification(flat)


def plane(made: Rectification, normal: tuple[float, float, float], ahead_mm: float) -> NDArray[np.float64]:
    """Depth of the plane with this normal through the point straight ahead of the pinhole."""
    rows, columns = np.mgrid[0 : made.height, 0 : made.width]
    n = np.array(normal) / np.linalg.norm(normal)
    rays = np.stack(
        [(columns - made.left.cx_px) / made.focal_px, (rows - made.cy_px) / made.focal_px, np.ones(rows.shape)]
    )
    return np.asarray(ahead_mm * n[2] / np.einsum("i,ihw->hw", n, rays))


def noisy(frame: ExportFrame, rng: np.random.Generator, sigma_px: float = NOISE_PX) -> ExportFrame:
    found = frame.disparity.disparity_px
    dirty = (found + rng.normal(0, sigma_px, found.shape)).astype(np.float32)
    return replace(frame, disparity=replace(frame.disparity, disparity_px=dirty))


def read(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.load(trimesh.util.wrap_as_stream(mesh_ply(mesh)), file_type="ply", process=False)


def assert_sound(mesh: Mesh) -> None:
    """Every triangle has an area, faces the camera, and joins pixels that touch; every vertex belongs to one."""
    found = read(mesh)
    assert found.nondegenerate_faces(height=1e-8).all()
    assert (np.einsum("ij,ij->i", found.face_normals, found.triangles_center) < 0).all()
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.points) < 0).all()
    np.testing.assert_array_equal(np.unique(mesh.triangles), np.arange(len(mesh.points)))


def test_compiled_loops_do_what_their_source_does(rng: np.random.Generator) -> None:
    inverse = (40 + rng.normal(0, 0.1, (12, 14))).astype(np.float32)
    inverse[:, 7:] += 5
    inverse[rng.random(inverse.shape) < 0.15] = np.nan
    sigma = np.full(inverse.shape, 0.1, np.float32)
    pixels = np.flatnonzero(np.isfinite(inverse)).astype(np.uint32)
    results = []
    for how in ("compiled", "source"):
        cut, normals_of = (one if how == "compiled" else one.py_func for one in (cut_grid, face_normals))
        cuts, normals = np.empty(inverse.shape, np.uint8), np.empty((len(pixels), 3), np.float32)
        cut(inverse, sigma, 4.0, 0, len(inverse), cuts)
        normals_of(inverse, cuts, pixels, (300.0, 6.0, 5.0), 0, len(pixels), normals)
        results.append((cuts, normals))
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_allclose(results[0][1], results[1][1], atol=1e-6)


def test_a_plane_becomes_one_whole_mesh_with_its_normal(flat: Calibration, made: Rectification) -> None:
    depth = plane(made, (0.3, -0.2, -1.0), 600.0)
    mesh = mesh_of(Surface.of(frame_of(flat, depth)))
    assert len(mesh.points) == depth.size
    assert len(mesh.triangles) == 2 * (made.width - 1) * (made.height - 1)
    np.testing.assert_allclose(mesh.points[:, 2], depth.ravel(), rtol=2e-6)
    np.testing.assert_allclose(mesh.normals @ np.array([0.3, -0.2, -1.0]) / np.sqrt(1.13), 1.0, atol=2e-3)
    assert_sound(mesh)


def test_the_mesh_is_cut_where_depth_leaps_and_nowhere_else(
    flat: Calibration, made: Rectification, rng: np.random.Generator
) -> None:
    depth = plane(made, (0.2, 0.1, -1.0), 800.0)
    near = np.zeros(depth.shape, bool)
    near[40:120, 50:110] = True
    depth[near] *= 0.8
    frame = noisy(frame_of(flat, depth), rng)
    mesh = mesh_of(Surface.of(frame))
    corners = near.ravel()[mesh.pixels][mesh.triangles]
    assert (corners.all(axis=1) | ~corners.any(axis=1)).all()
    whole = 2 * (made.width - 1) * (made.height - 1)
    rim = 2 * 2 * (80 + 60) + 4  # triangles between the two, at least
    assert 0.97 * (whole - rim) <= len(mesh.triangles) <= whole - rim
    assert_sound(mesh)


def test_a_leap_counts_by_the_noise_around_it(flat: Calibration, made: Rectification, rng: np.random.Generator) -> None:
    depth = plane(made, (0, 0, -1), 800.0)
    step = frame_of(flat, depth)
    found = step.disparity.disparity_px.copy()
    found[:, made.width // 2 :] += np.float32(0.4)
    step = replace(step, disparity=replace(step.disparity, disparity_px=found))

    def bridged(sigma_px: float) -> float:
        mesh = mesh_of(Surface.of(noisy(step, rng, sigma_px)))
        right = (mesh.pixels % made.width >= made.width // 2)[mesh.triangles]
        return float((right.any(axis=1) & ~right.all(axis=1)).sum() / (2 * (made.height - 1)))

    assert bridged(0.02) < 0.02
    assert bridged(0.2) > 0.9


@pytest.mark.parametrize("sigma_px", [0.03, 0.08, 0.2])
def test_noise_is_told_from_the_map_itself(made: Rectification, rng: np.random.Generator, sigma_px: float) -> None:
    rows, columns = np.mgrid[0 : made.height, 0 : made.width]
    disparity = (20 + 0.1 * columns - 0.05 * rows + rng.normal(0, sigma_px, rows.shape)).astype(np.float32)
    told = disparity_sigma(disparity)
    assert abs(np.median(told) / sigma_px - 1) < 0.2, np.median(told)


def test_an_unclear_match_is_noisier_than_its_neighbours(made: Rectification, rng: np.random.Generator) -> None:
    disparity = (20 + rng.normal(0, 0.1, (60, 60))).astype(np.float32)
    confidence = np.full(disparity.shape, 120, np.uint8)
    confidence[30, 30] = 15
    told = disparity_sigma(disparity, confidence)
    assert told[30, 30] / told[30, 33] == pytest.approx(2.0, rel=0.15)  # the cube root of 8


def test_sigma_is_what_the_noise_is_worth_along_the_ray(
    flat: Calibration, made: Rectification, rng: np.random.Generator
) -> None:
    depth = plane(made, (0, 0, -1), 700.0)
    surface = Surface.of(noisy(frame_of(flat, depth), rng))
    mesh = mesh_of(surface)
    rays = mesh.points / mesh.points[:, 2:]
    off = (mesh.points[:, 2] - 700.0) * np.linalg.norm(rays, axis=1)
    assert np.percentile(np.abs(off) / mesh.sigma, 68.3) == pytest.approx(1.0, rel=0.2)
    expected = 700.0**2 / made.window.scale_px * NOISE_PX
    assert np.median(mesh.sigma) == pytest.approx(expected, rel=0.25)


def test_small_holes_of_a_plane_are_filled_and_those_at_an_edge_stay_open(
    flat: Calibration, made: Rectification, rng: np.random.Generator
) -> None:
    depth = plane(made, (0.3, 0, -1), 800.0)
    true = depth.copy()
    depth[50:100, 100:130] *= 0.7
    for rows, columns in (
        (slice(20, 25), slice(20, 26)),
        (slice(60, 66), slice(97, 103)),
        (slice(130, 150), slice(20, 40)),
    ):
        depth[rows, columns] = np.nan
    surface = Surface.of(noisy(frame_of(flat, depth), rng))
    filled = fill_small_holes(surface)
    assert filled.filled.sum() == 30
    assert filled.filled[20:25, 20:26].all()
    off = (filled.depth - true)[20:25, 20:26]
    _, sigmas = filled.points(np.flatnonzero(filled.filled).astype(np.uint32))
    assert np.abs(off).max() < 2 * sigmas.min(), off
    assert_sound(mesh_of(filled))


def test_a_hole_at_the_border_and_a_map_without_holes_stay_as_they_are(flat: Calibration, made: Rectification) -> None:
    depth = plane(made, (0, 0, -1), 800.0)
    depth[0:3, 0:3] = np.nan
    surface = Surface.of(frame_of(flat, depth))
    assert fill_small_holes(surface) is surface


def test_gates_keep_a_region_and_a_range(flat: Calibration, made: Rectification) -> None:
    depth = plane(made, (0.5, 0, -1), 800.0)
    surface = Surface.of(frame_of(flat, depth), Gates(750.0, 850.0, Patch(10, 20, 60, 50)))
    expected = np.zeros(depth.shape, bool)
    expected[20:70, 10:70] = True
    expected &= (depth >= 750) & (depth <= 850)
    assert (surface.known != expected).sum() <= 4  # float32 at the ends
    with pytest.raises(UsageError, match="reaches out"):
        Surface.of(frame_of(flat, depth), Gates(region=Patch(0, 0, made.width + 1, 5)))
    with pytest.raises(UsageError, match="near < far"):
        Gates(500.0, 400.0)


def test_what_rests_gets_steady_and_what_moves_is_not_held_back(
    flat: Calibration, made: Rectification, rng: np.random.Generator
) -> None:
    steady, scale = Steady(), made.window.scale_px
    errors = []
    for index in range(16):
        depth = plane(made, (0, 0, -1), 800.0)
        depth[:, made.width // 2 :] -= 8.0 * index
        surface = steady.next(Surface.of(noisy(frame_of(flat, depth), rng)))
        errors.append(scale / surface.depth - scale / depth)
    resting, moving = np.split(errors[-1], [made.width // 2], axis=1)
    assert resting[:, :-8].std() < 0.5 * NOISE_PX
    assert abs(moving.mean()) < 0.5 * NOISE_PX
    assert moving[:, 8:].std() < 1.1 * NOISE_PX


def test_a_vertex_has_the_same_name_in_every_frame(flat: Calibration, made: Rectification) -> None:
    first, second = plane(made, (0, 0, -1), 800.0), plane(made, (0.1, 0, -1), 700.0)
    second[:30] = np.nan
    meshes = [mesh_of(Surface.of(frame_of(flat, depth))) for depth in (first, second)]
    assert set(meshes[1].pixels) < set(meshes[0].pixels)
    named = [{tuple(row) for row in mesh.pixels[mesh.triangles].tolist()} for mesh in meshes]
    assert named[1] < named[0]


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_the_smallest_grids_have_as_many_triangles_as_they_can(shape: tuple[int, int], geometry: FrameGeometry) -> None:
    ones = np.full(shape, 40.0, np.float32)
    small = replace(geometry, width=shape[1], height=shape[0])
    mesh = mesh_of(Surface(ones, np.full(shape, 0.1, np.float32), np.zeros(shape, bool), small))
    assert len(mesh.triangles) == 2 * (shape[0] - 1) * (shape[1] - 1)


@pytest.fixture(scope="module")
def geometry(flat: Calibration, made: Rectification) -> FrameGeometry:
    nothing = np.full((made.height, made.width), np.nan, np.float32)
    return Geometries(flat).of(DisparityMap(nothing, made.window))


def test_a_frame_without_a_match_has_an_empty_mesh(flat: Calibration, made: Rectification) -> None:
    surface = fill_small_holes(Surface.of(frame_of(flat, np.full((made.height, made.width), np.nan))))
    mesh = mesh_of(Steady().next(surface))
    assert len(mesh.points) == len(mesh.triangles) == 0
    assert mesh_ply(mesh).endswith(b"end_header\n")
    assert np.ptp(mesh_picture(mesh, Sight.onto(mesh))) == 0


def test_a_map_of_another_calibration_is_refused(flat: Calibration, made: Rectification) -> None:
    alien = DisparityMap(np.full((made.height, made.width - 7), 9.0, np.float32), made.window)
    with pytest.raises(DataError, match="none of this calibration"):
        ExportFrame.of(0, 0, alien, None, Geometries(flat))


def test_the_file_keeps_what_the_mesh_holds(flat: Calibration, made: Rectification) -> None:
    mesh = mesh_of(Surface.of(frame_of(flat, plane(made, (0.1, 0.2, -1), 900.0))))
    found = read(mesh)
    np.testing.assert_array_equal(found.vertices.astype(np.float32), mesh.points)
    np.testing.assert_array_equal(found.faces, mesh.triangles)
    np.testing.assert_array_equal(found.visual.vertex_colors[:, :3], painted(made).reshape(-1, 3)[mesh.pixels][:, ::-1])
    vertices = found.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(vertices["sigma"], mesh.sigma)
    np.testing.assert_array_equal(vertices["pixel"], mesh.pixels)
    assert b"comment unit mm" in mesh_ply(mesh)


def test_a_mesh_is_drawn_where_the_camera_saw_it(flat: Calibration, made: Rectification) -> None:
    mesh = mesh_of(Surface.of(frame_of(flat, plane(made, (0, 0, -1), 900.0))))
    mesh = replace(mesh, normals=np.tile(np.float32([-0.45, -0.6, -0.66]), (len(mesh.points), 1)))  # fully lit
    own = Sight(made.width, made.height, made.focal_px, made.left.cx_px, made.cy_px, 900.0)
    drawn = mesh_picture(mesh, own, yaw_deg=0.0, pitch_deg=0.0)
    inside = (slice(2, -2), slice(2, -2))
    off = cv2.absdiff(drawn, painted(made))[inside]
    assert np.mean(off > 2) < 0.01  # where the colours of the picture run over from 255 to 0


@pytest.mark.soak
def test_twenty_megapixels_become_a_mesh(geometry: FrameGeometry, rng: np.random.Generator) -> None:
    shape = (3648, 5472)
    inverse = (40 + rng.normal(0, NOISE_PX, shape)).astype(np.float32)
    large = replace(geometry, width=shape[1], height=shape[0])
    begin = time.perf_counter()
    mesh = mesh_of(Surface(inverse, disparity_sigma(inverse), np.zeros(shape, bool), large))
    print(
        f"\nmesh of {inverse.size / 1e6:.1f} Mpx: {len(mesh.triangles)} triangles in {time.perf_counter() - begin:.1f} s"
    )
    assert len(mesh.triangles) > 1.9 * inverse.size
