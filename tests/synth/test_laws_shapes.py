"""Parts that furniture is made of: closed, standing on the floor, of the volume that their sizes say."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from goc.geometry.topology import signed_volume, watertight_flaw
from goc.scene import Mesh
from goc.synth.layout import UprightBox
from goc.synth.noise import cell_random, fractal_noise, value_noise
from goc.synth.shapes import (
    PartMesh,
    ball,
    cushion,
    cylinder,
    lathe,
    prism,
    rotation,
    rounded_box,
    rounded_rectangle,
    smooth_profile,
    tube,
)
from goc.synth.style import choose_style
from goc.synth.tops import largest_rectangle
from goc.synth.vectors import dot, length, unit
from laws import over

SQUARE = np.array([(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)])
PARTS: dict[str, tuple[Callable[[], PartMesh], float, float]] = {
    "box": (lambda: rounded_box((0.6, 0.4, 0.2), 0.001), 0.048, 0.2),
    "fine box": (lambda: rounded_box((0.6, 0.4, 0.2), 0.02, 5, 3), 0.0477, 0.2),
    "thin box": (lambda: rounded_box((1.0, 1.0, 0.01), 0.004, 3), 0.01, 0.01),
    "cylinder": (lambda: cylinder(0.2, 0.5, 0.001, 96), math.pi * 0.04 * 0.5, 0.5),
    "cone": (lambda: cylinder(0.2, 0.5, 0.001, 96, top=0.1), math.pi * 0.5 / 3 * (0.04 + 0.02 + 0.01), 0.5),
    "ball": (lambda: ball(0.3, 96), 4 / 3 * math.pi * 0.027, 0.6),
    "prism": (lambda: prism(SQUARE, 0.3, 0.001), 0.24 * 0.3, 0.3),
    "table top": (lambda: prism(rounded_rectangle(1.0, 0.6, 0.1, 24), 0.04, 0.001), 0.04 * (0.6 - 0.00858), 0.04),
    "straight bar": (
        lambda: tube(np.array([(0, 0, 0), (0, 0, 0.4), (0, 0, 0.8)]), 0.05, 96),
        math.pi * 0.0025 * 0.8,
        0.8,
    ),
}
"""Part, volume, height."""


def as_mesh(part: PartMesh) -> Mesh:
    return Mesh(vertices=part.vertices.astype(np.float32), faces=part.faces.astype(np.int32))


@over(part=PARTS)
def test_parts_are_closed_and_have_their_volume_and_height(part):
    make, volume, height = part
    mesh = as_mesh(make())
    assert watertight_flaw(mesh) is None
    assert signed_volume(mesh) == pytest.approx(volume, rel=0.02)
    assert mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert mesh.vertices[:, 2].max() == pytest.approx(height, abs=1e-6)


@over(part=PARTS)
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_turning_and_moving_keep_volume_and_closedness(part, axis):
    turned = part[0]().turned(axis, 0.7).moved(1.0, -2.0, 0.5)
    assert watertight_flaw(as_mesh(turned)) is None
    assert signed_volume(as_mesh(turned)) == pytest.approx(signed_volume(as_mesh(part[0]())), rel=1e-4)
    back = turned.moved(-1.0, 2.0, -0.5).turned(axis, -0.7)
    np.testing.assert_allclose(back.vertices, part[0]().vertices, atol=1e-12)


@pytest.mark.parametrize("puff", [0.0, 0.03, 0.08])
def test_cushions_swell_and_stay_closed(puff):
    mesh = as_mesh(cushion((0.5, 0.4, 0.15), 0.04, puff))
    assert watertight_flaw(mesh) is None
    plain = signed_volume(as_mesh(cushion((0.5, 0.4, 0.15), 0.04, 0.0)))
    assert signed_volume(mesh) >= plain - 1e-9 and mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=puff)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.4, math.pi / 2, math.pi, 5.0])
def test_rotations_about_axes_are_a_group(axis, angle):
    matrix = rotation(axis, angle)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation(axis, 0.3) @ matrix, rotation(axis, angle + 0.3), atol=1e-12)
    unit_axis = np.eye(3)["xyz".index(axis)]
    np.testing.assert_allclose(matrix @ unit_axis, unit_axis, atol=1e-15)
    second = np.eye(3)["yzx".index(axis)]
    third = np.cross(unit_axis, second)  # about z: y turns towards -x
    np.testing.assert_allclose(matrix @ second, math.cos(angle) * second + math.sin(angle) * third, atol=1e-12)


def test_lathes_of_smooth_profiles_are_closed_and_pass_through_their_points():
    points = [(0, 0), (0.2, 0.0), (0.3, 0.25), (0.1, 0.5), (0, 0.5)]
    profile = smooth_profile(points, 7)
    assert (profile[0] == points[0]).all() and (profile[-1] == points[-1]).all()
    for point in points:
        assert np.linalg.norm(profile - point, axis=1).min() < 2e-3
    assert (profile[1:-1, 0] > 0).all() and profile[:, 1].min() >= 0 and profile[:, 1].max() <= 0.5
    assert watertight_flaw(as_mesh(lathe(profile))) is None


def test_a_bent_bar_keeps_its_width_all_along():
    angles = np.linspace(0, np.pi, 24)
    path = np.stack([np.cos(angles), np.zeros(24), np.sin(angles)], -1)
    bar = tube(path, 0.1, 16)
    assert watertight_flaw(as_mesh(bar)) is None
    reach = np.linalg.norm(bar.vertices[2:].reshape(24, 16, 3) - path[:, None], axis=-1)
    np.testing.assert_allclose(reach, 0.1, atol=1e-12)


@pytest.mark.parametrize(("width", "depth", "radius"), [(1.0, 0.5, 0.1), (0.4, 0.4, 0.2), (2.0, 1.0, 1e-3)])
def test_a_rounded_rectangle_is_inside_its_rectangle(width, depth, radius):
    outline = rounded_rectangle(width, depth, radius, 16)
    assert np.ptp(outline[:, 0]) == pytest.approx(width) and np.ptp(outline[:, 1]) == pytest.approx(depth)
    x, y = outline.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))  # positive: counter-clockwise
    assert area == pytest.approx(width * depth - (4 - math.pi) * radius**2, rel=2e-3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
def test_the_largest_free_rectangle_is_that_of_brute_force(seed, share):
    free = np.random.default_rng(seed).random((7, 9)) < share
    i0, i1, j0, j1 = largest_rectangle(free)
    assert free[i0:i1, j0:j1].all()
    best = max(
        (b - a) * (d - c)
        for a in range(7)
        for b in range(a + 1, 8)
        for c in range(9)
        for d in range(c + 1, 10)
        if free[a:b, c:d].all()
    )
    assert (i1 - i0) * (j1 - j0) == best


def test_noise_repeats_is_smooth_and_bounded():
    points = np.random.default_rng(0).uniform(-100, 100, (2000, 3))
    for octaves in (1, 2, 5):
        values = fractal_noise(points, octaves)
        assert values.min() >= 0 and values.max() <= 1 and values.std() > 0.05
        np.testing.assert_allclose(fractal_noise(points + 64, octaves), values, atol=1e-4)
        near = fractal_noise(points + 1e-5, octaves)
        assert np.abs(near - values).max() < 1e-3 * octaves
    np.testing.assert_array_equal(value_noise(points), fractal_noise(points, 1))


def test_noise_at_lattice_points_is_the_value_of_the_cell():
    cells = np.random.default_rng(1).integers(-50, 50, (100, 3)).astype(float)
    np.testing.assert_allclose(value_noise(cells), cell_random(cells), atol=1e-6)
    np.testing.assert_array_equal(cell_random(cells[:, :2]), cell_random(np.c_[cells[:, :2], np.zeros(100)]))


def test_row_wise_vectors():
    a, b = np.random.default_rng(2).normal(size=(2, 30, 3))
    np.testing.assert_allclose(dot(a, b), (a * b).sum(1))
    np.testing.assert_allclose(length(a), np.linalg.norm(a, axis=1))
    np.testing.assert_allclose(length(unit(a)), 1.0)
    assert not unit(np.zeros((2, 3))).any()


def box_at(x=0.0, y=0.0, yaw=0.0, half=(0.5, 0.3), low=0.0, high=1.0) -> UprightBox:
    return UprightBox(centre=np.array([x, y]), half=np.array(half), yaw=yaw, low=low, high=high)


@pytest.mark.parametrize(
    ("other", "gap", "apart"),
    [
        (box_at(1.01), 0.0, True),
        (box_at(0.99), 0.0, False),
        (box_at(1.04), 0.05, False),
        (box_at(1.06), 0.05, True),
        (box_at(low=1.0, high=2.0), 0.5, True),
        (box_at(low=0.9, high=2.0), 0.0, False),
        (box_at(0.9, 0.7, math.pi / 4), 0.0, True),
        (box_at(0.3, 0.2, 1.0, (0.01, 0.01)), 0.0, False),
    ],
)
def test_upright_boxes_are_apart_by_an_axis_or_not_at_all(other, gap, apart):
    assert box_at().apart(other, gap) == apart == other.apart(box_at(), gap)


@pytest.mark.parametrize("seed", range(6))
def test_turning_both_boxes_changes_nothing(seed):
    random = np.random.default_rng(seed)
    (x, y), yaw, turn = random.uniform(-1.2, 1.2, 2), random.uniform(0, 6), random.uniform(0, 6)
    c, s = math.cos(turn), math.sin(turn)
    turned = box_at(c * x - s * y, s * x + c * y, yaw + turn)
    for gap in (0.0, 0.1):
        assert box_at().apart(box_at(x, y, yaw), gap) == box_at(yaw=turn).apart(turned, gap)


@pytest.mark.parametrize("seed", range(8))
def test_styles_differ_within_and_repeat_for_a_seed(seed):
    style, again = choose_style(np.random.default_rng(seed)), choose_style(np.random.default_rng(seed))
    assert style == again
    assert style.wood != style.second_wood and style.cloth != style.second_cloth
    assert len(set(style.accents)) == len(style.accents)
    assert style.accent(1) == style.accent(1 + len(style.accents))
    assert style.timber(0) != style.timber(1) and style.timber(0) != style.timber(0, second=True)
    assert style.upholstery() != style.upholstery(second=True)
