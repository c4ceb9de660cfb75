"""Signed distances of primitives: on the surface, one-Lipschitz, inside their box, against slow twins."""

import math

import numpy as np
import pytest

from goc.geometry.isosurface import grid_surface
from goc.geometry.topology import signed_volume, watertight_flaw
from goc.scene import Mesh
from goc.training.primitives import (
    Box,
    Cylinder,
    Ellipsoid,
    Lathe,
    Primitive,
    Prism,
    Shrunk,
    Torus,
    Tube,
    polygon_distance,
)
from laws import only, over

STAR = np.array([(r * math.cos(i * math.pi / 5), r * math.sin(i * math.pi / 5)) for i, r in enumerate([0.8, 0.35] * 5)])
ELL = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, -0.1), (-0.1, -0.1), (-0.1, 0.5), (-0.5, 0.5)])
SHADE = np.array([(0.0, -0.5), (0.6, -0.5), (0.3, 0.5), (0.0, 0.5)])

BODIES: dict[str, tuple[Primitive, float]] = {
    "box": (Box((1.0, 0.6, 0.8)), 0.48),
    "round box": (Box((1.0, 0.6, 0.8), 0.1), 0.48 - (4 - math.pi) * 0.01 * 1.8 - (8 - 4 / 3 * math.pi) * 0.001),
    "cylinder": (Cylinder(0.5, 0.9), math.pi * 0.25 * 0.9),
    "round cylinder": (Cylinder(0.5, 0.9, 0.15), 0.66),
    "ball": (Ellipsoid((0.6, 0.6, 0.6)), 4 / 3 * math.pi * 0.6**3),
    "egg": (Ellipsoid((0.7, 0.4, 0.5)), 4 / 3 * math.pi * 0.7 * 0.4 * 0.5),
    "ring": (Torus(0.55, 0.2), 2 * math.pi**2 * 0.55 * 0.04),
    "prism": (Prism(ELL, 0.7), 0.64 * 0.7),
    "star": (Prism(STAR, 0.5), 5 * 0.8 * 0.35 * math.sin(math.pi / 5) * 0.5),
    "shade": (Lathe(SHADE), math.pi * (0.36 + 0.18 + 0.09) / 3),
    "bar": (Tube(np.array([(-0.5, 0, 0), (0.5, 0, 0)]), 0.2), math.pi * 0.04 + 4 / 3 * math.pi * 0.008),
    "thinner": (Shrunk(Box((1.0, 0.6, 0.8)), 0.1), 0.8 * 0.4 * 0.6),
}
"""Bodies within the unit cube about the origin, and their volumes."""
EXACT = {name: body for name, body in BODIES.items() if name not in ("egg",)}


def distances(body: Primitive, points: np.ndarray) -> np.ndarray:
    x, y, z = points.astype(np.float32).T
    return np.broadcast_to(body.distance(x, y, z), x.shape)


def points(count=2000, seed=0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3))


@over(body=BODIES)
def test_the_zero_level_is_a_closed_surface_of_the_right_volume(body):
    shape, volume = body
    axis = np.linspace(-1, 1, 56, dtype=np.float32)
    field = shape.distance(axis[:, None, None], axis[None, :, None], axis[None, None, :])
    field = np.broadcast_to(field, (56, 56, 56)).astype(np.float32)
    vertices, faces = grid_surface(field, np.full(3, -1.0), 2 / 55)
    mesh = Mesh(vertices=vertices, faces=faces)
    assert watertight_flaw(mesh) is None
    assert signed_volume(mesh) == pytest.approx(volume, rel=0.04)
    assert (np.abs(vertices).max(0) <= np.array(shape.half_extent()) + 2 / 55).all()


@over(body=EXACT)
def test_distances_change_no_faster_than_points_move(body):
    here = points()
    for step in (1e-2, 0.1, 0.5):
        there = here + step * np.random.default_rng(1).normal(size=here.shape)
        change = np.abs(distances(body[0], there) - distances(body[0], here))
        assert (change <= np.linalg.norm(there - here, axis=1) * (1 + 1e-4) + 1e-5).all()


@over(body=only(EXACT, "box", "cylinder", "ball", "ring", "prism", "bar", "round box"))
def test_outside_the_distance_leads_to_the_surface(body):
    """Walk down the slope by the distance: that ends on the surface (not inside, where medial axes break the slope)."""
    here = points(400, 2)
    here = here[distances(body[0], here) > 0.05]
    d, step = distances(body[0], here).astype(np.float64), 2e-3
    slope = np.stack([distances(body[0], here + step * a) - distances(body[0], here - step * a) for a in np.eye(3)], -1)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    landed = np.abs(distances(body[0], here - d[:, None] * slope))
    assert np.median(landed) < 2e-3 and (landed < 0.02).mean() > 0.97


@over(body=BODIES)
def test_nothing_is_inside_beyond_the_half_extent(body):
    here = points(4000, 3)
    beyond = (np.abs(here) > np.array(body[0].half_extent()) + 1e-6).any(1)
    assert beyond.any() and (distances(body[0], here)[beyond] >= -1e-6).all()


@over(body=BODIES)
def test_coordinates_that_broadcast_are_the_same_as_points(body):
    x, y, z = np.linspace(-0.9, 0.9, 7), np.linspace(-0.8, 0.9, 6), np.linspace(-0.7, 0.8, 5)
    x, y, z = (a.astype(np.float32) for a in (x, y, z))
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    wide = np.broadcast_to(body[0].distance(x[:, None, None], y[None, :, None], z[None, None]), (7, 6, 5))
    np.testing.assert_allclose(wide.ravel(), distances(body[0], grid), atol=2e-6)


@pytest.mark.parametrize("sides", [(1.0, 1.0, 1.0), (0.02, 1.0, 0.5)])
def test_a_box_is_as_far_as_its_nearest_point(sides):
    here, half = points(500, 4), np.array(sides) / 2
    outside = (np.abs(here) > half).any(1)
    nearest = np.clip(here, -half, half)
    expected = np.where(outside, np.linalg.norm(here - nearest, axis=1), -(half - np.abs(here)).min(1))
    np.testing.assert_allclose(distances(Box(sides), here), expected, atol=1e-6)


@over(outline={"star": STAR, "ell": ELL, "square": np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])})
@pytest.mark.parametrize("turn", ["as drawn", "the other way", "from another corner"])
def test_polygons_are_as_far_as_their_nearest_edge(outline, turn):
    given = {"as drawn": outline, "the other way": outline[::-1].copy(), "from another corner": np.roll(outline, 2, 0)}
    here = points(300, 5)[:, :2]
    found = polygon_distance(given[turn], *here.astype(np.float32).T)
    a, b = outline, np.roll(outline, -1, 0)
    share = (((here[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)).clip(0, 1)
    expected = np.linalg.norm(here[:, None] - a - share[..., None] * (b - a), axis=-1).min(1)
    np.testing.assert_allclose(np.abs(found), expected, atol=1e-5)
    spokes, ends = here[:, None] - a, here[:, None] - b
    angles = np.arctan2(
        spokes[..., 0] * ends[..., 1] - spokes[..., 1] * ends[..., 0], (spokes * ends).sum(-1)
    )  # winding number by the angles under which edges are seen
    inside = np.abs(angles.sum(1)) > math.pi
    np.testing.assert_array_equal((found < 0)[expected > 1e-4], inside[expected > 1e-4])


def test_a_shrunk_body_is_farther_by_what_it_lost():
    body, here = Cylinder(0.4, 0.6), points(200, 6)
    np.testing.assert_allclose(distances(Shrunk(body, 0.07), here), distances(body, here) + 0.07, atol=1e-6)


def test_a_bent_bar_is_the_nearest_of_its_pieces():
    line = np.array([(-0.5, 0, 0), (0, 0.4, 0), (0.5, 0, 0.3)])
    pieces = [distances(Tube(line[i : i + 2], 0.1), points(200, 7)) for i in (0, 1)]
    np.testing.assert_allclose(distances(Tube(line, 0.1), points(200, 7)), np.minimum(*pieces), atol=1e-6)
