"""Meshes: areas, volumes, closedness, normals and samples under motions, units, relabelling and turning inside out."""

import numpy as np
import pytest

from assets import inside_out
from goc.geometry.raycast import TriangleScene
from goc.geometry.surfaces import face_areas, surface_cloud, vertex_normals
from goc.geometry.topology import is_closed, is_watertight, signed_volume, watertight_flaw
from goc.scene import Mesh
from laws import MOTIONS, SCALES, SHEETS, SOLIDS, carried, extent, only, over, relabelled, scaled
from oracles import watertight as oracle
from solids import joined, unwelded

ALL = {**SOLIDS, **SHEETS}


def rounding(mesh: Mesh) -> float:
    """How far float32 may have moved a vertex."""
    return 2 * float(np.finfo(np.float32).eps) * extent(mesh)


def perimeters(mesh: Mesh) -> np.ndarray:
    """Of each face: what its area changes by when vertices move by one."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum(1)


@over(mesh=ALL, scale=SCALES)
def test_areas_grow_with_the_square_and_volumes_with_the_cube(mesh, scale):
    large = scaled(mesh, scale)
    assert (np.abs(face_areas(large) - scale**2 * face_areas(mesh)) <= rounding(large) * perimeters(large)).all()
    if is_closed(mesh):
        slack = rounding(large) * face_areas(large).sum()
        assert signed_volume(large) == pytest.approx(scale**3 * signed_volume(mesh), abs=slack)


@over(mesh=SOLIDS, motion=MOTIONS)
def test_rigid_motion_changes_neither_area_nor_volume_nor_closedness(mesh, motion):
    there = carried(mesh, motion)
    slack = rounding(there) + rounding(mesh)
    assert (np.abs(face_areas(there) - face_areas(mesh)) <= slack * perimeters(mesh)).all()
    assert signed_volume(there) == pytest.approx(signed_volume(mesh), abs=slack * face_areas(mesh).sum())
    assert is_watertight(there)


@over(mesh=SOLIDS)
def test_turned_inside_out_the_volume_changes_sign_and_the_area_does_not(mesh):
    turned = inside_out(mesh)
    assert signed_volume(turned) == pytest.approx(-signed_volume(mesh), rel=1e-12)
    np.testing.assert_allclose(np.sort(face_areas(turned)), np.sort(face_areas(mesh)), rtol=1e-9)
    assert is_closed(turned) and watertight_flaw(turned) == "it is turned inside out"
    np.testing.assert_allclose(vertex_normals(turned), -vertex_normals(mesh), atol=1e-6)


@over(mesh=ALL)
@pytest.mark.parametrize("seed", range(3))
def test_names_of_vertices_and_order_of_faces_say_nothing(mesh, seed):
    other = relabelled(mesh, seed)
    assert watertight_flaw(other) == watertight_flaw(mesh) and is_closed(other) == is_closed(mesh)
    assert bool(oracle.trouble(other.vertices, other.faces)) == bool(oracle.trouble(mesh.vertices, mesh.faces))
    np.testing.assert_allclose(np.sort(face_areas(other)), np.sort(face_areas(mesh)), rtol=1e-9)
    if is_closed(mesh):  # of an open one the sum depends on the origin
        assert signed_volume(other) == pytest.approx(signed_volume(mesh), rel=1e-9)


@over(mesh=SOLIDS, other=only(SOLIDS, "cube", "ring", "soup of a ball"))
def test_what_stands_apart_adds_up(mesh, other):
    far = carried(other, np.array([[1.0, 0, 0, 90], [0, 1, 0, 90], [0, 0, 1, 90], [0, 0, 0, 1]]))
    both = joined(mesh, far)
    assert face_areas(both).sum() == pytest.approx(face_areas(mesh).sum() + face_areas(far).sum())
    assert signed_volume(both) == pytest.approx(signed_volume(mesh) + signed_volume(far), rel=1e-6)
    assert is_watertight(both)


@over(mesh=SOLIDS)
@pytest.mark.parametrize("face", [0, 3, -1])
def test_without_any_one_face_nothing_is_closed(mesh, face):
    left = Mesh(vertices=mesh.vertices, faces=np.delete(mesh.faces, face, axis=0))
    assert not is_closed(left) and watertight_flaw(left) == "3 edges have a face on one side only"


@over(mesh=only(SOLIDS, "cube", "plate", "ball", "ring", "two parts"))
def test_seams_change_nothing(mesh):
    soup = unwelded(mesh)
    assert is_watertight(soup) and signed_volume(soup) == pytest.approx(signed_volume(mesh), rel=1e-9)
    np.testing.assert_array_equal(face_areas(soup), face_areas(mesh))


@over(mesh=ALL, motion=MOTIONS)
def test_vertex_normals_are_unit_and_turn_along(mesh, motion):
    normals = vertex_normals(mesh)
    used = np.isin(np.arange(len(mesh.vertices)), mesh.faces)
    lengths = np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(lengths[used], 1.0, atol=1e-5)
    assert not lengths[~used].any()
    there = vertex_normals(carried(mesh, motion))
    tilt = (rounding(carried(mesh, motion)) + rounding(mesh)) * perimeters(mesh).max() / face_areas(mesh).min()
    assert (np.linalg.norm(there - normals @ motion[:3, :3].T, axis=1)[used] <= 4 * tilt + 1e-6).all()


@over(mesh=ALL, count={"one": 1, "seven": 7, "many": 2000})
def test_samples_lie_on_the_surface_with_the_normals_of_their_faces(mesh, count):
    cloud = surface_cloud(mesh, count)
    assert cloud.positions.shape == cloud.normals.shape == cloud.colours.shape == (count, 3)
    scene = TriangleScene(mesh.vertices, mesh.faces)
    distance, _ = scene.nearest(cloud.positions.astype(np.float64))
    assert distance.max() <= 4 * np.finfo(np.float32).eps * extent(mesh)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert ((cloud.normals[:50] @ flat.T).max(axis=1) > 1 - 1e-6).all()


@over(mesh=ALL)
def test_samples_are_as_many_as_the_area_says(mesh):
    """Stratified over the running area: counts of runs of faces are exact to one sample at either end."""
    areas, count = face_areas(mesh), 5000
    half = np.arange(len(areas)) < len(areas) // 2
    cloud = surface_cloud(mesh, count, seed=1)
    coloured = Mesh(
        vertices=mesh.vertices[mesh.faces].reshape(-1, 3),
        faces=np.arange(3 * len(areas), dtype=np.int32).reshape(-1, 3),
        colours=np.repeat(np.where(half, 255, 0).astype(np.uint8), 3)[:, None].repeat(3, 1),
    )
    painted = surface_cloud(coloured, count, seed=1)
    np.testing.assert_allclose(painted.positions, cloud.positions)
    assert abs((painted.colours[:, 0] > 127).sum() - count * areas[half].sum() / areas.sum()) <= 2


@over(mesh=only(ALL, "cube", "ring", "sliver", "open box"), scale=SCALES)
def test_samples_scale_with_the_surface(mesh, scale):
    here, there = surface_cloud(mesh, 500), surface_cloud(scaled(mesh, scale), 500)
    np.testing.assert_allclose(there.positions / scale, here.positions, atol=1e-5 * max(extent(mesh), 1))


@pytest.mark.parametrize("faces", [np.zeros((0, 3), np.int32), np.array([[0, 0, 1]], np.int32)])
def test_a_mesh_without_area_is_refused(faces):
    with pytest.raises(ValueError, match=f"A mesh of {len(faces)} faces has no area to put points on"):
        surface_cloud(Mesh(vertices=np.zeros((2, 3), np.float32), faces=faces), 5)
