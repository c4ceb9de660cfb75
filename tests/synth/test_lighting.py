from dataclasses import replace

import numpy as np
import pytest

from goc.synth.lighting import AreaLight, bake, direct_light, light_on, sequence
from goc.synth.materials import Paint
from goc.synth.model import Model, make_part, placed
from goc.synth.shapes import rounded_box
from goc.synth.surfaces import ShadingPoints, gather_surfaces, triangle_centres

LIGHT = AreaLight(
    centre=np.array([0.0, 0.0, 2.0]),
    across=np.array([1.0, 0.0, 0.0]),
    along=np.array([0.0, 0.6, 0.0]),
    facing=np.array([0.0, 0.0, -1.0]),
    radiance=np.array([1.0, 2.0, 4.0]),
)


def slab(z):
    """A closed plate whose top lies at z."""
    plate = placed(make_part(rounded_box((4.0, 4.0, 0.1)), Paint(base=(0.5, 0.5, 0.5)), smooth=False), z=z - 0.1)
    return Model(name="slab", parts=(plate,))


def spot_at_origin():
    up = np.array([[0.0, 0.0, 1.0]])
    return ShadingPoints(
        positions=np.zeros((1, 3)),
        normals=up,
        face_normals=up,
        texture=np.zeros((1, 3)),
        triangle=np.zeros(1, np.int32),
    )


def form_factor(a, b, h):
    """From a small patch to a parallel rectangle a by b, its centre h above (four times Siegel and Howell, B-3)."""
    x, y = a / (2 * h), b / (2 * h)
    u, v = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    return 4 / (2 * np.pi) * (x / u * np.arctan(y / u) + y / v * np.arctan(x / v))


def test_direct_light_of_a_rectangle_is_its_form_factor():
    light = direct_light(gather_surfaces(slab(0.0), {}), (LIGHT,), spot_at_origin(), np.zeros(1, np.int64), 1024)
    np.testing.assert_allclose(light[0], LIGHT.radiance * form_factor(1.0, 0.6, 2.0), rtol=2e-3)


def test_what_is_covered_or_faces_away_is_dark():
    surfaces = gather_surfaces(slab(0.0), {1: slab(1.0)})
    start = np.zeros(1, np.int64)
    assert direct_light(surfaces, (LIGHT,), spot_at_origin(), start, 64).max() == 0
    behind = replace(LIGHT, facing=np.array([0.0, 0.0, 1.0]))
    assert direct_light(gather_surfaces(slab(0.0), {}), (behind,), spot_at_origin(), start, 64).max() == 0


def test_in_a_room_that_shines_evenly_every_open_spot_receives_that_light(lit):
    even = replace(lit, lights=(), radiance=np.ones_like(lit.radiance))
    spots = triangle_centres(lit.surfaces)[np.flatnonzero(lit.surfaces.owner == 0)]
    light = light_on(even, spots, np.zeros(len(spots), np.int64), 16)
    assert light.max() <= 1 + 1e-6
    assert np.median(light) == pytest.approx(1.0, abs=1e-6)  # walls that nothing touches; corners lose a ray or two


@pytest.mark.parametrize("stream", [0, 1, 7])
def test_sixteen_samples_in_a_row_fall_into_sixteen_different_cells(stream):
    u, v = sequence(np.arange(32, 48), stream)
    for columns in (1, 2, 4, 8, 16):
        rows = 16 // columns
        cells = np.floor(u * columns) * rows + np.floor(v * rows)
        assert len(np.unique(cells)) == 16


def test_triangles_without_area_do_not_stop_the_light():
    whole = slab(0.0).parts[0]
    flat = whole.mesh.faces[:1].copy()
    flat[0, 2] = flat[0, 1]
    mesh = replace(whole.mesh, faces=np.concatenate([whole.mesh.faces, flat]))
    spoilt = Model(name="slab", parts=(replace(whole, mesh=mesh),))
    surfaces = gather_surfaces(spoilt, {})
    assert len(surfaces.owner) == len(gather_surfaces(slab(0.0), {}).owner)
    assert np.isfinite(bake(surfaces, (LIGHT,)).radiance).all()
