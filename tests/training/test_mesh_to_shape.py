import numpy as np
import pytest

from goc.scene import Mesh
from goc.training.mesh_to_shape import in_shape_frame, shape_from_mesh
from oracles.watertight import trouble

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))], np.int32)


def box(low=(0, 0, 0), high=(1, 1, 1), leave_out=0):
    vertices = np.asarray(low, np.float32) + CORNERS * (np.asarray(high, np.float32) - np.asarray(low, np.float32))
    return Mesh(vertices=vertices.astype(np.float32), faces=FACES[: len(FACES) - leave_out])


def joined(*meshes):
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=False)]).astype(np.int32),
    )


def box_distance(points, low, high):
    over = np.abs(points - (np.add(low, high)) / 2) - np.subtract(high, low) / 2
    return np.linalg.norm(np.maximum(over, 0), axis=-1) + np.minimum(over.max(-1), 0)


def grid_points(solid):
    return solid.origin + solid.voxel * np.argwhere(np.ones(solid.distance.shape, bool))


def test_standing_scales_and_centres():
    mesh = in_shape_frame(box((1, 2, 3), (3, 3, 4)))
    assert mesh.vertices.min(0).tolist() == pytest.approx([-0.5, -0.25, 0])
    assert mesh.vertices.max(0).tolist() == pytest.approx([0.5, 0.25, 0.5])
    with pytest.raises(ValueError, match="in one place"):
        in_shape_frame(Mesh(vertices=np.ones((3, 3), np.float32), faces=np.array([[0, 1, 2]], np.int32)))


@pytest.mark.parametrize("inverted", [False, True])
def test_a_closed_box_has_its_exact_distance(inverted):
    mesh = box((0, 0, 0), (1, 0.5, 0.4))
    if inverted:
        mesh = Mesh(vertices=mesh.vertices, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))
    solid, how = shape_from_mesh(mesh, 24)
    assert how == "closed"
    exact = box_distance(grid_points(solid), (-0.5, -0.25, 0), (0.5, 0.25, 0.4)).reshape(solid.distance.shape)
    limit = 4 * solid.voxel
    np.testing.assert_allclose(solid.distance, np.clip(exact, -limit, limit), atol=1e-5)
    assert trouble(solid.mesh.vertices, solid.mesh.faces) == ""


def test_overlapping_closed_pieces_unite():
    solid, how = shape_from_mesh(joined(box((0, 0, 0), (1, 0.4, 0.4)), box((0.3, 0.1, 0.1), (0.6, 0.3, 1.0))), 32)
    assert how == "closed"
    middle = solid.distances(np.array([[-0.05, 0.0, 0.2], [-0.05, 0.0, 0.8], [0.4, 0.0, 0.8]]))
    assert (middle < 0).tolist() == [True, True, False]


def test_an_open_box_becomes_walls_and_stays_hollow():
    solid, how = shape_from_mesh(box(leave_out=2), 32)  # its upper side is missing
    assert how == "carved"
    probes = np.array([[0.0, 0, 0.5], [0.5, 0, 0.5], [0, 0, 0.0], [0, 0, 1.0]])
    found = solid.distances(probes)
    assert found[0] > 0 and found[3] > 0
    assert found[1] < 0 and found[2] < 0


def test_a_closed_mesh_with_a_flaw_keeps_its_volume():
    flawed = box()
    flawed = Mesh(vertices=flawed.vertices, faces=np.concatenate([flawed.faces, flawed.faces[:1]]))
    solid, how = shape_from_mesh(flawed, 24)
    assert how == "carved"
    exact = box_distance(grid_points(solid), (-0.5, -0.5, 0), (0.5, 0.5, 1)).reshape(solid.distance.shape)
    wrong = (solid.distance < 0) != (exact < 0)
    assert wrong[np.abs(exact) > 0.3 * solid.voxel].mean() < 0.002


def test_nothing_inside_is_refused():
    sliver = Mesh(
        vertices=np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32), faces=np.array([[0, 1, 2]], np.int32)
    )
    with pytest.raises(ValueError, match="no area"):
        shape_from_mesh(sliver, 16)


def test_a_closed_wall_thinner_than_a_voxel_does_not_fall_through_the_grid():
    solid, how = shape_from_mesh(box((0, 0, 0), (1, 0.8, 0.01)), 24)
    assert how == "closed"
    inside = (solid.distance < 0).any(2)
    assert inside.sum() == pytest.approx(24 * 0.8 * 24, rel=0.15)
    assert trouble(solid.mesh.vertices, solid.mesh.faces) == ""
