import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from goc import _native
from goc.geometry.raycast import TriangleScene
from oracles import raycast as oracle


def soup(seed, triangles, size=0.5):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-2, 2, (triangles, 1, 3)) + rng.normal(0, size, (triangles, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)


def rays(seed, count):
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, 3)), rng.normal(size=(count, 3))


def cube(half=1.0):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))], np.int32)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), triangles=st.sampled_from([1, 2, 4, 5, 9, 300]))
def test_hits_equal_the_brute_force_twin(seed, triangles):
    vertices, faces = soup(seed, triangles)
    origins, directions = rays(seed + 1, 60)
    t, triangle = oracle.closest_hits(vertices, faces, origins, directions)
    hits = TriangleScene(vertices, faces).closest_hit(origins, directions)
    np.testing.assert_array_equal(hits.triangle, triangle)
    np.testing.assert_allclose(hits.t, t, rtol=1e-9)  # both in float64; they round differently
    found = hits.found
    points = (hits.barycentrics[found, :, None] * vertices[faces[triangle[found]]]).sum(1)
    np.testing.assert_allclose(points, (origins + t[:, None] * directions)[found], atol=1e-7)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), distance=st.floats(0.0, 5.0))
def test_occlusion_is_a_closest_hit_before_the_distance(seed, distance):
    vertices, faces = soup(seed, 200)
    scene = TriangleScene(vertices, faces)
    origins, directions = rays(seed + 1, 200)
    expected = scene.closest_hit(origins, directions).t < distance
    np.testing.assert_array_equal(scene.occluded(origins, directions, distance), expected)


def test_distances_inside_a_box_are_the_slab_distances():
    origins, directions = rays(3, 500)
    origins = origins / 3.1
    hits = TriangleScene(*cube()).closest_hit(origins, directions)
    expected = ((np.sign(directions) - origins) / directions).min(-1)
    np.testing.assert_allclose(hits.t, expected, rtol=1e-12)


def test_axis_parallel_rays_along_slabs_are_not_lost():
    scene = TriangleScene(*cube())
    origins = np.array([[0.0, 0.0, -3.0], [1.0, 0.3, -3.0], [0.0, 0.0, 0.0], [-3.0, 1.0, 1.0]])
    directions = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [0.0, -0.5, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(scene.closest_hit(origins, directions).t[[0, 2]], [1.0, 2.0])
    assert scene.closest_hit(origins, directions).t[1] in (2.0, np.inf)  # grazes the face it lies in: either is right


def test_distance_to_a_fine_sphere_is_that_of_the_ball():
    angles = np.linspace(0, np.pi, 65), np.linspace(0, 2 * np.pi, 128, endpoint=False)
    theta, phi = np.meshgrid(*angles, indexing="ij")
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    ring = np.arange(128)
    upper = np.arange(64)[:, None] * 128 + ring
    side = np.arange(64)[:, None] * 128 + np.roll(ring, -1)
    faces = np.concatenate([np.stack([upper, upper + 128, side], -1), np.stack([side, upper + 128, side + 128], -1)])
    scene = TriangleScene(vertices.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.int32))
    _, directions = rays(5, 400)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    sagitta = 1 - np.cos(np.pi / 128) * np.cos(np.pi / 128)
    assert np.abs(scene.closest_hit(-3 * directions, directions).t - 2.0).max() <= sagitta + 1e-6


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_no_ray_leaks_through_a_shared_edge_or_corner(scale):
    rng = np.random.default_rng(0)
    heights = rng.normal(0, 0.1, (20, 20))
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij")
    vertices = (np.stack([x, y, heights], -1).reshape(-1, 3) * scale + 0.3 * scale).astype(np.float32)
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    faces = np.stack([corner, corner + 20, corner + 21, corner, corner + 21, corner + 1], -1).reshape(-1, 3)
    scene = TriangleScene(vertices, faces.astype(np.int32))
    inner = vertices.reshape(20, 20, 3)[1:-1, 1:-1].reshape(-1, 3).astype(np.float64)
    targets = np.concatenate([inner, 0.5 * (inner[1:] + inner[:-1])])  # corners and points on edges
    origins = np.array([9.1, 8.7, 30.0]) * scale + np.zeros_like(targets)
    assert scene.closest_hit(origins, targets - origins).found.all()


def test_results_do_not_depend_on_the_number_of_threads():
    scene = TriangleScene(*soup(1, 5000, 0.1))
    origins, directions = rays(2, 4000)
    threads = _native.thread_count()
    try:
        results = []
        for count in (1, 4):
            _native.set_thread_count(count)
            results.append(scene.closest_hit(origins, directions))
    finally:
        _native.set_thread_count(threads)
    for name in ("t", "triangle", "barycentrics"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[1], name))


def test_many_coincident_triangles_do_not_break_the_hierarchy():
    vertices, faces = cube()
    scene = TriangleScene(vertices, np.tile(faces, (500, 1)))
    hits = scene.closest_hit(np.zeros((1, 3)), np.array([[0.1, 0.2, 1.0]]))
    assert hits.t[0] == pytest.approx(1.0)
    assert hits.triangle[0] < len(faces)  # of equals the first


def test_no_rays_give_no_hits():
    scene = TriangleScene(*cube())
    assert len(scene.closest_hit(np.zeros((0, 3)), np.zeros((0, 3))).t) == 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32), "no faces"),
        (np.full((3, 3), np.nan, np.float32), np.array([[0, 1, 2]], np.int32), "3 vertices are not finite"),
        (np.zeros((3, 3), np.float32), np.array([[0, 1, 2], [0, 1, 3]], np.int32), r"1 faces name.*face 1"),
        (np.zeros((3, 3), np.float32), np.array([[0, -1, 2]], np.int32), "1 faces name"),
    ],
)
def test_malformed_soups_are_refused(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        TriangleScene(vertices, faces)


def test_malformed_rays_are_refused():
    scene = TriangleScene(*cube())
    good = np.ones((2, 3))
    with pytest.raises(ValueError, match="finite"):
        scene.closest_hit(good * np.inf, good)
    with pytest.raises(ValueError, match="non-zero length"):
        scene.occluded(good, good * 0.0, 1.0)
    with pytest.raises(ValueError, match="NaN"):
        scene.occluded(good, good, float("nan"))


def test_the_binding_refuses_what_would_read_outside_an_array():
    with pytest.raises(ValueError, match="not there"):
        _native.TriangleBvh(np.zeros((3, 3), np.float32), np.array([[0, 1, 3]], np.int32))
    bvh = _native.TriangleBvh(*cube())
    with pytest.raises(ValueError, match="different lengths"):
        bvh.occluded(np.zeros((2, 3)), np.ones((3, 3)), np.ones(2), np.zeros(2, bool))
    with pytest.raises(TypeError):
        bvh.occluded(np.zeros((2, 2)), np.ones((2, 2)), np.ones(2), np.zeros(2, bool))


def test_a_lattice_round_a_box_modelled_on_it_has_the_right_sides():
    """Edges count once: a ray that runs exactly through one would find both its faces."""
    corners, faces = cube(0.5)
    scene = TriangleScene(corners * np.array([2, 1, 1], np.float32), faces)
    axis = np.arange(-20, 21) / 12
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    beyond = np.abs(points) / [1, 0.5, 0.5]
    winding = scene.winding(points)
    assert (winding[(beyond > 1.001).any(-1)] == 0).all()
    assert (winding[(beyond < 0.999).all(-1)] == 1).all()
