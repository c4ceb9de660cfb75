"""Surfaces of analytic distances: on the zero level, closed, of the right size, whatever grid, place and unit."""

from collections.abc import Callable

import numpy as np
import pytest

from goc.geometry.isosurface import grid_surface
from goc.geometry.surfaces import face_areas, vertex_normals
from goc.geometry.topology import signed_volume, watertight_flaw
from goc.scene import Mesh
from laws import SCALES, over
from oracles.watertight import has_border

Distance = Callable[[np.ndarray], np.ndarray]


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=-1) - 0.7


def box(points: np.ndarray) -> np.ndarray:
    beyond = np.abs(points) - [0.6, 0.45, 0.7]
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(-1), 0)


def ring(points: np.ndarray) -> np.ndarray:
    return np.hypot(np.hypot(points[..., 0], points[..., 1]) - 0.6, points[..., 2]) - 0.22


def capsule(points: np.ndarray) -> np.ndarray:
    along = np.clip(points[..., 0], -0.4, 0.4)
    return np.linalg.norm(points - along[..., None] * [1.0, 0, 0], axis=-1) - 0.35


SHAPES: dict[str, tuple[Distance, float]] = {
    "ball": (ball, 4 / 3 * np.pi * 0.7**3),
    "box": (box, 8 * 0.6 * 0.45 * 0.7),
    "ring": (ring, 2 * np.pi**2 * 0.6 * 0.22**2),
    "capsule": (capsule, np.pi * 0.35**2 * 0.8 + 4 / 3 * np.pi * 0.35**3),
}
"""Distances, negative inside, of shapes within the unit cube about the origin, and their volumes."""


def sampled(distance: Distance, count: int, shift=0.0, scale=1.0) -> tuple[Mesh, float]:
    """Surface of a shape on a grid of count³ points over [-1, 1]³, and the grid's edge, both in units of `scale`."""
    edge = 2.0 / (count - 1)
    axis = np.arange(count) * edge - 1.0 + shift * edge
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    values = (scale * distance(points)).astype(np.float32)
    vertices, faces = grid_surface(values, np.full(3, scale * axis[0]), scale * edge)
    return Mesh(vertices=vertices, faces=faces), scale * edge


@over(shape=SHAPES, count={"coarse": 12, "odd": 25, "fine": 48})
@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_the_surface_is_closed_on_the_zero_level_and_holds_the_volume(shape, count, shift):
    distance, volume = shape
    mesh, edge = sampled(distance, count, shift)
    assert watertight_flaw(mesh) is None
    assert np.abs(distance(mesh.vertices.astype(np.float64))).max() < 0.5 * edge
    assert signed_volume(mesh) == pytest.approx(volume, rel=2.5 * edge)


@over(shape=SHAPES)
def test_volumes_converge_with_the_square_of_the_edge(shape):
    distance, volume = shape
    errors = [abs(signed_volume(sampled(distance, count)[0]) - volume) for count in (17, 65)]
    assert errors[1] < errors[0] / 8 + 1e-6  # a quarter of the edge: a sixteenth of the error, for smooth shapes


@over(shape=SHAPES, scale=SCALES)
def test_the_unit_changes_nothing_but_the_size(shape, scale):
    distance, _ = shape
    here, there = sampled(distance, 20)[0], sampled(distance, 20, scale=scale)[0]
    np.testing.assert_array_equal(here.faces, there.faces)
    np.testing.assert_allclose(there.vertices / scale, here.vertices, atol=2e-6)


@over(shape=SHAPES)
def test_normals_point_to_the_positive_side(shape):
    distance, _ = shape
    mesh, edge = sampled(distance, 32)
    normals = vertex_normals(mesh).astype(np.float64)
    ahead = distance(mesh.vertices + 0.5 * edge * normals) - distance(mesh.vertices - 0.5 * edge * normals)
    assert (ahead > 0).all() and np.median(ahead) == pytest.approx(edge, rel=0.05)


@over(shape=SHAPES)
@pytest.mark.parametrize("axis", range(3))
def test_a_mirrored_grid_gives_the_mirrored_volume_and_area(shape, axis):
    distance, _ = shape
    values = distance(np.stack(np.meshgrid(*[np.linspace(-1, 1, 24)] * 3, indexing="ij"), -1) + 0.03)
    whole, mirrored = (
        Mesh(vertices=vertices, faces=faces)
        for vertices, faces in (
            grid_surface(grid.astype(np.float32), np.zeros(3), 1.0) for grid in (values, np.flip(values, axis))
        )
    )
    assert signed_volume(mirrored) == pytest.approx(signed_volume(whole), rel=2e-3)
    assert face_areas(mirrored).sum() == pytest.approx(face_areas(whole).sum(), rel=5e-3)


@pytest.mark.parametrize("size", [(1, 1, 1), (1, 5, 9), (8, 8, 8), (9, 16, 7)])
def test_a_grid_all_inside_is_closed_at_its_rim(size):
    vertices, faces = grid_surface(np.full(size, -1.0, np.float32), np.zeros(3), 1.0)
    mesh = Mesh(vertices=vertices, faces=faces)
    assert watertight_flaw(mesh) is None
    assert (vertices.min(0) > -1).all() and (vertices.max(0) < np.array(size)).all()
    # a box of (n - 1 + 2·½) a side, whose edges and corners marching cubes cuts off
    assert np.prod(np.array(size) - 0.5) < 1.05 * signed_volume(mesh) + 1 and signed_volume(mesh) < np.prod(size)


@pytest.mark.parametrize("size", [(1, 1, 1), (8, 8, 8), (3, 17, 4)])
def test_a_grid_all_outside_has_no_surface(size):
    vertices, faces = grid_surface(np.ones(size, np.float32), np.zeros(3), 0.1)
    assert vertices.shape == (0, 3) and faces.shape == (0, 3)


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_closed_whatever_its_pattern(seed):
    values = np.random.default_rng(seed).normal(size=(11, 9, 13)).astype(np.float32)
    vertices, faces = grid_surface(values, np.zeros(3), 1.0)
    assert not has_border(faces)
    assert (face_areas(Mesh(vertices=vertices, faces=faces)) > 0).all()
