import numpy as np
import pytest

from goc.files.colour import encode_srgb
from goc.synth import decor, furniture
from goc.synth.materials import linear
from goc.synth.model import mesh_of
from goc.synth.style import choose_style
from oracles.watertight import trouble

# Believable outer sizes: least and greatest width, depth and height, metres.
SIZES = {
    furniture.sofa: ((1.3, 0.8, 0.7), (2.3, 1.0, 1.0)),
    furniture.armchair: ((0.7, 0.8, 0.7), (1.1, 1.0, 1.0)),
    furniture.coffee_table: ((0.9, 0.5, 0.35), (1.2, 0.7, 0.5)),
    furniture.dining_table: ((0.8, 0.6, 0.7), (1.2, 1.0, 0.8)),
    furniture.chair: ((0.38, 0.4, 0.8), (0.5, 0.6, 1.0)),
    furniture.bookshelf: ((0.7, 0.25, 1.3), (1.0, 0.4, 2.1)),
    furniture.sideboard: ((1.1, 0.35, 0.45), (1.6, 0.5, 0.7)),
    furniture.pouf: ((0.4, 0.4, 0.3), (0.6, 0.6, 0.45)),
    decor.floor_lamp: ((0.3, 0.3, 1.4), (0.5, 0.5, 1.7)),
    decor.table_lamp: ((0.2, 0.2, 0.35), (0.35, 0.35, 0.5)),
    decor.plant: ((0.3, 0.3, 0.7), (0.9, 0.9, 1.3)),
    decor.ball_toy: ((0.2, 0.2, 0.2), (0.36, 0.36, 0.36)),
    decor.mug: ((0.08, 0.07, 0.09), (0.14, 0.1, 0.12)),
    decor.vase: ((0.1, 0.1, 0.2), (0.25, 0.25, 0.4)),
    decor.fruit_bowl: ((0.2, 0.2, 0.1), (0.35, 0.35, 0.2)),
    decor.book_pile: ((0.18, 0.14, 0.05), (0.3, 0.25, 0.2)),
}


@pytest.mark.parametrize("make", SIZES, ids=lambda make: make.__name__)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_things_are_closed_and_have_the_size_of_their_kind(make, seed):
    rng = np.random.default_rng(seed)
    model = make(rng, choose_style(rng))
    assert {trouble(part.mesh.vertices, part.mesh.faces) for part in model.parts} == {""}
    low, high = model.bounds
    least, greatest = SIZES[make]
    assert ((high - low) >= np.array(least)).all() and ((high - low) <= np.array(greatest)).all(), high - low
    mesh = mesh_of(model)
    assert trouble(mesh.vertices, mesh.faces) == ""  # in float32, as it is written
    assert mesh.colours.std() > 0 and mesh.colours.max() < 255


def test_the_same_seed_makes_the_same_thing_and_another_seed_another():
    def vertices(seed):
        rng = np.random.default_rng(seed)
        return mesh_of(furniture.sofa(rng, choose_style(rng))).vertices

    np.testing.assert_array_equal(vertices(3), vertices(3))
    assert vertices(3).shape != vertices(4).shape or not np.array_equal(vertices(3), vertices(4))


def test_srgb_decoding_and_encoding_are_inverse():
    np.testing.assert_array_equal(encode_srgb(np.array([linear("0a80ff")])), [[0x0A, 0x80, 0xFF]])
    assert linear("000000") == (0, 0, 0)
    assert linear("808080")[0] == pytest.approx(0.2158605, rel=1e-5)  # IEC 61966-2-1
