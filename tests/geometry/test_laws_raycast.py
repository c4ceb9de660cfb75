"""Rays against meshes of every kind: the brute-force twin, motions, units, order of the faces, and sides."""

import numpy as np
import pytest

from assets import inside_out
from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh
from laws import MOTIONS, SCALES, SHEETS, SOLIDS, carried, extent, only, over, relabelled, scaled
from oracles import proximity
from oracles import raycast as oracle

ALL = {**SOLIDS, **SHEETS}
SMALL = only(ALL, "cube", "far cube", "plate", "needle", "triangle", "sliver", "open box", "box in a box")


def scene_of(mesh: Mesh) -> TriangleScene:
    return TriangleScene(mesh.vertices, mesh.faces)


def rays_at(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """From all round the mesh to points about it: some hit, some miss."""
    random = np.random.default_rng(seed)
    low, high = mesh.vertices.min(0).astype(float), mesh.vertices.max(0).astype(float)
    size = np.linalg.norm(high - low)
    origins = (low + high) / 2 + size * random.normal(size=(count, 3))
    targets = random.uniform(low - 0.1 * size, high + 0.1 * size, (count, 3))
    targets[::2] = mesh.vertices[mesh.faces].mean(1)[random.integers(0, len(mesh.faces), len(targets[::2]))]
    return origins, targets - origins


@over(mesh=ALL)
def test_hits_are_those_of_every_ray_on_every_triangle(mesh):
    origins, directions = rays_at(mesh, 80, 0)
    hits = scene_of(mesh).closest_hit(origins, directions)
    t, _ = oracle.closest_hits(mesh.vertices, mesh.faces, origins, directions)
    assert hits.found.any()
    grazing = np.isfinite(t) != hits.found  # through an edge, the twin may fall between two faces
    assert grazing.mean() < 0.05 and not (grazing & ~hits.found).any()
    np.testing.assert_allclose(hits.t[~grazing], t[~grazing], rtol=1e-6)


@over(mesh=ALL)
def test_a_hit_is_where_its_barycentrics_say(mesh):
    origins, directions = rays_at(mesh, 200, 1)
    hits = scene_of(mesh).closest_hit(origins, directions)
    found = hits.found
    corners = mesh.vertices[mesh.faces[hits.triangle[found]]].astype(np.float64)
    points = (hits.barycentrics[found][..., None] * corners).sum(1)
    reach = 1e-9 * (np.abs(origins).max() + np.abs(directions).max() + extent(mesh))
    np.testing.assert_allclose(points, (origins + hits.t[:, None] * directions)[found], atol=1e3 * reach)
    np.testing.assert_allclose(hits.barycentrics[found].sum(1), 1.0, atol=1e-9)
    assert (hits.barycentrics >= -1e-12).all() and not hits.barycentrics[~found].any()
    assert np.isinf(hits.t[~found]).all() and (hits.triangle[~found] == -1).all()


@over(mesh=ALL, scale=SCALES)
def test_distances_are_counted_in_lengths_of_the_direction(mesh, scale):
    origins, directions = rays_at(mesh, 60, 2)
    here = scene_of(mesh).closest_hit(origins, directions)
    longer = scene_of(mesh).closest_hit(origins, scale * directions)
    np.testing.assert_allclose(longer.t * scale, here.t, rtol=1e-9)
    np.testing.assert_array_equal(longer.found, here.found)


@over(mesh=only(ALL, "cube", "ball", "ring", "two parts", "open box"), motion=MOTIONS, scale=SCALES)
def test_hits_move_and_scale_with_the_mesh(mesh, motion, scale):
    there = scaled(carried(mesh, motion), scale)
    origins, directions = rays_at(mesh, 60, 3)
    here = scene_of(mesh).closest_hit(origins, directions)
    moved = scale * (origins @ motion[:3, :3].T + motion[:3, 3])
    found = scene_of(there).closest_hit(moved, scale * directions @ motion[:3, :3].T)
    both = here.found & found.found  # roundings decide what grazes a rim
    assert (here.found != found.found).mean() < 0.06 and both.any()
    assert (np.abs(found.t[both] - here.t[both]) < 1e-4).mean() > 0.95


@over(mesh=ALL)
def test_the_order_of_the_faces_says_nothing(mesh):
    origins, directions = rays_at(mesh, 80, 4)
    other = relabelled(mesh, 5)
    here, there = (scene_of(m).closest_hit(origins, directions) for m in (mesh, other))
    np.testing.assert_allclose(here.t, there.t, rtol=1e-9)
    points = origins + 0.3 * directions
    np.testing.assert_allclose(scene_of(mesh).nearest(points)[0], scene_of(other).nearest(points)[0], rtol=1e-9)


@over(mesh=ALL)
def test_what_is_hit_is_in_the_way_and_nothing_before_it(mesh):
    origins, directions = rays_at(mesh, 100, 6)
    scene = scene_of(mesh)
    hits = scene.closest_hit(origins, directions)
    limits = np.where(hits.found, hits.t, 1.0)
    np.testing.assert_array_equal(scene.occluded(origins, directions, limits * (1 + 1e-6)), hits.found)
    assert not scene.occluded(origins, directions, limits * (1 - 1e-6))[hits.found].any()
    np.testing.assert_array_equal(scene.occluded(origins, directions, np.inf), hits.found)
    assert not scene.occluded(origins, directions, 0.0).any()


@over(mesh=SMALL)
def test_distances_are_those_to_the_nearest_triangle(mesh):
    random = np.random.default_rng(7)
    size = np.ptp(mesh.vertices, axis=0).max()
    points = random.uniform(mesh.vertices.min(0) - size, mesh.vertices.max(0) + size, (25, 3))
    distances, triangles = scene_of(mesh).nearest(points)
    corners = mesh.vertices[mesh.faces]
    exact = np.array([[proximity.distance(point, triangle) for triangle in corners] for point in points])
    np.testing.assert_allclose(distances, exact.min(1), atol=1e-9 * extent(mesh))
    np.testing.assert_allclose(exact[np.arange(25), triangles], exact.min(1), atol=1e-9 * extent(mesh))


@over(mesh=ALL)
def test_a_limit_cuts_distances_off_and_changes_no_other(mesh):
    points = np.random.default_rng(8).normal(size=(60, 3)) * np.ptp(mesh.vertices, axis=0).max()
    points += mesh.vertices.mean(0)
    scene = scene_of(mesh)
    whole, limit = scene.nearest(points)[0], float(np.median(scene.nearest(points)[0]))
    near, triangles = scene.nearest(points, limit)
    inside = whole < limit
    np.testing.assert_allclose(near[inside], whole[inside], rtol=1e-12)
    beyond = whole > limit
    assert np.isinf(near[beyond]).all() and (triangles[beyond] == -1).all()


@over(mesh=SOLIDS)
def test_winding_counts_sides_and_turns_with_the_faces(mesh):
    random = np.random.default_rng(9)
    size = np.ptp(mesh.vertices, axis=0)
    points = random.uniform(mesh.vertices.min(0) - 0.2 * size, mesh.vertices.max(0) + 0.2 * size, (5, 3))
    clear = scene_of(mesh).nearest(points)[0] > 1e-6
    numbers = scene_of(mesh).winding(points)
    np.testing.assert_array_equal(scene_of(inside_out(mesh)).winding(points)[clear], -numbers[clear])
    for point, number in zip(points[clear], numbers[clear], strict=True):
        assert proximity.winding(point, mesh.vertices, mesh.faces) == pytest.approx(number, abs=1e-4)
    far = mesh.vertices.mean(0) + 10 * size.max() * np.array([[1.0, 0.3, 0.2], [-0.1, -1.0, 0.4]])
    assert not scene_of(mesh).winding(far).any()


@over(mesh=SOLIDS)
def test_good_solids_do_not_cut_themselves_and_overlapping_ones_do(mesh):
    assert not scene_of(mesh).crossings().any()
    size = np.ptp(mesh.vertices, axis=0)
    shifted = mesh.vertices + (np.array([0.07, 0.11, 0.09]) * size).astype(np.float32)
    both = Mesh(
        vertices=np.concatenate([mesh.vertices, shifted]),
        faces=np.concatenate([mesh.faces, mesh.faces + np.int32(len(mesh.vertices))]),
    )
    counts = scene_of(both).crossings()
    assert counts.sum() > 0 and counts.sum() % 2 == 0


@pytest.mark.parametrize("limit", [-1.0, np.nan])
def test_distances_that_are_none_are_refused(limit):
    with pytest.raises(ValueError, match="nearest: a limit is negative or NaN"):
        scene_of(SOLIDS["cube"]).nearest(np.zeros((1, 3)), limit)


@pytest.mark.parametrize("query", ["nearest", "winding"])
def test_points_that_are_not_finite_are_refused(query):
    with pytest.raises(ValueError, match="Distances and sides need finite points"):
        getattr(scene_of(SOLIDS["cube"]), query)(np.array([[0.0, np.inf, 0.0]]))
