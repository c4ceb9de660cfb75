"""Closedness and volume of solids whose answers are known."""

from dataclasses import replace

import numpy as np
import pytest

from assets import inside_out
from goc.geometry.topology import is_closed, is_watertight, signed_volume, watertight_flaw
from goc.scene import Mesh
from oracles import watertight as oracle
from solids import cube, joined, moved, sphere, unwelded, with_face_flipped


def with_flat_face(mesh):
    return replace(mesh, faces=np.concatenate([mesh.faces, [[0, 0, 1]]]).astype(np.int32))


EMPTY = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))


@pytest.mark.parametrize("mesh", [cube(), cube(0.2, (3, -4, 5)), sphere(), unwelded(sphere()), unwelded(cube())])
def test_solids_are_watertight_however_they_are_indexed(mesh):
    assert watertight_flaw(mesh) is None and is_watertight(mesh) and is_closed(mesh)


@pytest.mark.parametrize(
    ("mesh", "flaw", "closed"),
    [
        (EMPTY, "it has no faces", False),
        (with_face_flipped(cube()), "3 edges are run along twice in the same direction", False),
        (replace(cube(), faces=cube().faces[1:]), "3 edges have a face on one side only", False),
        (inside_out(cube()), "it is turned inside out", True),
        (with_flat_face(cube()), "1 faces have no area", True),
        (joined(unwelded(cube()), cube()), "18 edges are run along twice in the same direction", True),
    ],
)
def test_flaws_are_named(mesh, flaw, closed):
    assert watertight_flaw(mesh) == flaw and not is_watertight(mesh)
    assert is_closed(mesh) is closed
    if len(mesh.faces):
        assert oracle.trouble(mesh.vertices, mesh.faces)


def test_two_solids_that_share_an_edge_are_closed_in_their_own_indices():
    """Indexed apart they are two closed solids; welded, four faces meet in one edge: one of both is enough."""
    both = joined(cube(), cube(at=(1.0, 1.0, 0.0)))
    assert is_watertight(both) and is_closed(both)


@pytest.mark.parametrize("shift", [(0, 0, 0), (100.0, -50, 3)])
def test_volumes(shift):
    assert signed_volume(moved(cube(2.0), shift)) == pytest.approx(8.0, rel=1e-5)
    assert signed_volume(inside_out(cube(2.0))) == pytest.approx(-8.0)
    assert signed_volume(sphere(rings=60)) == pytest.approx(4 / 3 * np.pi, rel=5e-3)
    assert signed_volume(EMPTY) == 0.0
