import numpy as np
import pytest

from goc.training.placement import PlacedShape, random_placement
from goc.training.primitives import Box, Cylinder, Ellipsoid, Lathe, Prism, Shrunk, Torus, Tube, polygon_distance
from goc.training.procedural import _KINDS, random_shape
from goc.training.watertight_shape import CsgPart, shape_from_parts
from oracles.watertight import trouble

SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])


def at(body, *point):
    return float(body.distance(*(np.array([c], np.float32) for c in point))[0])


@pytest.mark.parametrize(
    ("body", "point", "distance"),
    [
        (Box((2, 2, 2)), (2, 0, 0), 1.0),
        (Box((2, 2, 2)), (2, 2, 1), 2**0.5),
        (Box((2, 2, 2), 0.5), (2, 2, 0), 2**0.5 * 1.5 - 0.5),
        (Box((2, 4, 6)), (0, 0, 0), -1.0),
        (Ellipsoid((1, 1, 1)), (0, 0, 3), 2.0),
        (Ellipsoid((1, 2, 3)), (0, 2, 0), 0.0),
        (Cylinder(1, 2), (3, 0, 0), 2.0),
        (Cylinder(1, 2), (0, 0, 3), 2.0),
        (Cylinder(1, 2), (0, 0, 0), -1.0),
        (Torus(2, 0.5), (2, 0, 0), -0.5),
        (Torus(2, 0.5), (0, 0, 0), 1.5),
        (Prism(SQUARE, 2), (3, 0, 0), 2.0),
        (Prism(SQUARE, 2), (0, 0, 3), 2.0),
        (Prism(SQUARE[::-1], 2), (0, 0, 0), -1.0),
        (Lathe(np.array([[0, -1.0], [1, -1], [1, 1], [0, 1]])), (3, 0, 0), 2.0),
        (Lathe(np.array([[0, -1.0], [1, -1], [1, 1], [0, 1]])), (0.1, 0, 0), -0.9),
        (Tube(np.array([[0, 0, 0], [0, 0, 2.0]]), 0.5), (1, 0, 1), 0.5),
        (Tube(np.array([[0, 0, 0], [0, 0, 2.0]]), 0.5), (0, 0, 3), 0.5),
        (Shrunk(Box((2, 2, 2)), 0.3), (0, 0, 0), -0.7),
    ],
)
def test_distances_have_their_closed_form(body, point, distance):
    assert at(body, *point) == pytest.approx(distance, abs=1e-5)


def test_a_polygon_s_sign_does_not_depend_on_its_turn():
    random = np.random.default_rng(0)
    x, y = random.uniform(-2, 2, (2, 500)).astype(np.float32)
    outline = np.array([[-1, -1], [1, -1], [1, 0.2], [0.1, 0.2], [0.1, 1], [-1, 1.0]])
    inside = (np.abs(x) < 1) & (np.abs(y) < 1) & ~((x > 0.1) & (y > 0.2))
    for corners in (outline, outline[::-1]):
        np.testing.assert_array_equal(polygon_distance(corners, x, y) < 0, inside)


def test_parts_are_joined_cut_and_kept():
    parts = [
        CsgPart(body=Box((2, 2, 2)), at=(0, 0, 0)),
        CsgPart(body=Box((1, 1, 4)), at=(0, 0, 0), operation="difference"),
        CsgPart(body=Box((9, 9, 1)), at=(0, 0, 0), operation="intersection"),
    ]
    solid = shape_from_parts(parts, 64)
    points = np.array([[0.4, 0.0, 0.2], [0.0, 0.0, 0.2], [0.4, 0.0, 0.8]])
    assert (solid.distances(points) < 0).tolist() == [True, False, False]
    low, high = solid.mesh.vertices.min(0), solid.mesh.vertices.max(0)
    np.testing.assert_allclose(high - low, [1, 1, 0.5], atol=0.03)
    assert low[2] == pytest.approx(0, abs=0.02)
    assert shape_from_parts([parts[0], CsgPart(body=Box((3, 3, 3)), at=(0, 0, 0), operation="difference")], 32) is None


def test_a_turned_part_is_where_it_should_be():
    turn = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])  # x to y
    solid = shape_from_parts([CsgPart(body=Box((4, 1, 1)), at=(0, 0, 0), turn=turn)], 48)
    extent = np.ptp(solid.mesh.vertices, axis=0)
    np.testing.assert_allclose(extent, [0.25, 1, 0.25], atol=0.03)


@pytest.mark.parametrize("kind", range(len(_KINDS)))
def test_every_kind_of_shape_is_closed_and_has_the_frame_of_a_solid(kind):
    made = [shape_from_parts(_KINDS[kind](np.random.default_rng(seed)), 40) for seed in range(3)]
    solids = [solid for solid in made if solid is not None]
    assert solids
    for solid in solids:
        assert trouble(solid.mesh.vertices, solid.mesh.faces) == ""
        low, high = solid.mesh.vertices.min(0), solid.mesh.vertices.max(0)
        assert (high - low).max() == pytest.approx(1, abs=0.06)
        assert low[2] == pytest.approx(0, abs=0.05)
        assert np.abs(low[:2] + high[:2]).max() < 0.08


def test_the_same_random_numbers_give_the_same_shape():
    one, other = (random_shape(np.random.default_rng(5), 32) for _ in range(2))
    np.testing.assert_array_equal(one.distance, other.distance)


def test_a_stretched_solid_keeps_sign_and_first_order_distance():
    solid = shape_from_parts([CsgPart(body=Ellipsoid((1, 1, 1)), at=(0, 0, 0))], 64)  # a ball
    low, high = solid.mesh.vertices.min(0), solid.mesh.vertices.max(0)
    middle, radius = (low + high) / 2, float(high[0] - low[0]) / 2
    placed = PlacedShape(shape=solid, matrix=np.diag([1.0, 2.0, -1.5]), shift=np.array([5.0, 0, 0]))
    centre = placed.matrix @ middle + placed.shift
    points = centre + [
        [radius + 0.02, 0, 0],
        [0, 2 * radius + 0.04, 0],
        [0, 2 * radius - 0.04, 0],
        [0, 0, 1.5 * radius + 0.03],
    ]
    assert placed.distances(points).tolist() == pytest.approx([0.02, 0.04, -0.04, 0.03], abs=0.004)
    hits, normals = placed.closest_hit(centre[None] + [[0, -4.0, 0]], np.array([[0, 1.0, 0]]))
    assert hits.t[0] == pytest.approx(4.0 - 2 * radius, abs=0.02)
    assert normals[0, 1] == pytest.approx(-1, abs=0.02)


def test_random_placings_stand_on_the_ground():
    solid = random_shape(np.random.default_rng(1), 32)
    for seed in range(5):
        placed, _ = random_placement(solid, np.random.default_rng(seed))
        assert placed.box()[0][2] == pytest.approx(0, abs=1e-5)
