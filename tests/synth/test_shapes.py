import numpy as np
import pytest

from goc.synth.shapes import (
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
from goc.synth.surfaces import subdivided
from oracles.watertight import signed_volume, trouble

BOW = np.array([[0.0, 0, 0], [0.05, 0.02, 0.2], [0.2, 0.02, 0.3]])
SHAPES = {
    "chamfered box": rounded_box((1.0, 0.5, 0.2), 0.01),
    "rounded box": rounded_box((1.0, 0.5, 0.2), 0.05, 3, 2),
    "cushion": cushion((0.6, 0.5, 0.15), 0.04, 0.02),
    "cylinder": cylinder(0.1, 0.5),
    "frustum": cylinder(0.1, 0.5, top=0.2),
    "ball": ball(0.3),
    "vase": lathe(smooth_profile([(0, 0), (0.05, 0), (0.1, 0.1), (0.04, 0.25), (0, 0.25)])),
    "prism": prism(rounded_rectangle(1.0, 0.6, 0.1), 0.03),
    "tube": tube(BOW, np.array([0.02, 0.03, 0.01])),
}


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_is_closed_outward_and_stands_on_the_floor(name):
    solid = SHAPES[name]
    assert trouble(solid.vertices, solid.faces) == ""
    if name != "tube":
        assert solid.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("solid", "volume", "tolerance"),
    [
        (rounded_box((1.0, 0.5, 0.2), 1e-6), 0.1, 1e-5),
        (cylinder(0.1, 0.5, 1e-6, 200), 0.005 * np.pi, 1e-3),
        (ball(0.3, 200), 4 / 3 * np.pi * 0.027, 1e-3),
        (prism(rounded_rectangle(1.0, 0.6, 0.1, 50), 0.03, 1e-6), 0.03 * (0.6 - (4 - np.pi) * 0.01), 1e-3),
        (tube(np.array([[0, 0, 0], [0, 0.3, 0.4]]), 0.02, 100), np.pi * 0.0004 * 0.5, 1e-3),
    ],
)
def test_volumes_are_those_of_the_ideal_solids(solid, volume, tolerance):
    assert signed_volume(solid.vertices, solid.faces) == pytest.approx(volume, rel=tolerance)


def test_rotations_are_right_handed():
    np.testing.assert_allclose(rotation("z", np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation("x", np.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotation("y", np.pi / 2) @ [0, 0, 1], [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize("longest", [0.5, 0.1, 0.05])
def test_subdivision_keeps_the_surface_and_shortens_every_edge(longest):
    solid = SHAPES["prism"]
    vertices, faces = subdivided(solid.vertices, solid.faces, longest)
    assert trouble(vertices, faces) == ""
    assert signed_volume(vertices, faces) == pytest.approx(signed_volume(solid.vertices, solid.faces), rel=1e-12)
    corners = vertices[faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, 1), axis=-1).max() <= longest


def test_subdivision_carries_further_columns_along():
    solid = SHAPES["ball"]
    both, _ = subdivided(np.concatenate([solid.vertices, 2 * solid.vertices + 1], -1), solid.faces, 0.04)
    np.testing.assert_allclose(both[:, 3:], 2 * both[:, :3] + 1, atol=1e-12)
