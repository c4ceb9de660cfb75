"""Faces wound like their neighbours."""

import numpy as np

from goc.geometry.winding import consistently_wound
from goc.scene import Mesh
from solids import joined, moved, sphere


def test_faces_turned_at_random_come_back():
    whole = joined(sphere(), moved(sphere(), (5.0, 0.0, 0.0)))
    random = np.random.default_rng(0)
    turned = random.random(len(whole.faces)) < 0.3
    mixed = Mesh(vertices=whole.vertices, faces=np.where(turned[:, None], whole.faces[:, ::-1], whole.faces))
    mended, count = consistently_wound(mixed)
    assert count == turned.sum()
    np.testing.assert_array_equal(np.sort(mended.faces, axis=1), np.sort(whole.faces, axis=1))
    same = [np.roll(mended.faces, step, axis=1) == whole.faces for step in range(3)]
    assert np.any([each.all(axis=1) for each in same], axis=0).all()


def test_what_agrees_or_cannot_agree_stays():
    whole = sphere()
    assert consistently_wound(whole)[1] == 0
    inside_out = Mesh(vertices=whole.vertices, faces=np.ascontiguousarray(whole.faces[:, ::-1]))
    assert consistently_wound(inside_out)[1] == 0
    count = 9
    strip = np.array([[i, i + 1, i + 2] if i % 2 else [i + 1, i, i + 2] for i in range(count)])
    moebius = Mesh(vertices=np.random.default_rng(0).normal(size=(count, 3)).astype(np.float32),
                   faces=(strip % count).astype(np.int32))  # fmt: skip
    assert consistently_wound(moebius)[1] == 0
    none = Mesh(vertices=whole.vertices, faces=whole.faces[:0])
    assert consistently_wound(none)[1] == 0
