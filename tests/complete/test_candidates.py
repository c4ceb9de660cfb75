"""Candidates against shapes in closed form: what each should recover, and what rays refute."""

from dataclasses import replace

import numpy as np
import pytest

from goc.complete import with_margin
from goc.complete.candidates import CONVEX, HULL, NETWORK, OUTLINES, candidates, hypotheses, imagined_share, refined
from goc.complete.convex import convex_fill
from goc.complete.mirrored import mirrored
from goc.complete.mirrors import MirrorPlane
from goc.complete.outlines import outline_fill, square_axes
from goc.geometry.isosurface import grid_surface
from goc.scene import Evidence, Mesh
from oracles.watertight import trouble
from seenshapes import VOXEL, bowl, box, overlap, seen_along

CORNER = ((0, -1), (1, -1), (2, -1))
"""Seen from the front, from one side, and from above."""


@pytest.fixture(scope="module")
def crate():
    """A box of which three faces were seen, and the true distance."""
    return seen_along(box((0.6, 0.4, 0.5)), CORNER)


def made(found, network=None):
    return {option.name: option for option in candidates(found, hypotheses(found), network)}


def test_three_faces_of_a_box_give_the_outlines_of_the_box_and_the_convex_hull_lacks_its_hidden_corner(crate):
    found, truth = crate
    options = made(found)
    iou = {name: overlap(option.composed.distance < 0, truth < 0) for name, option in options.items()}
    assert iou[OUTLINES] > 0.95
    assert iou[CONVEX] < 0.93 < iou[OUTLINES]
    assert options[OUTLINES].misfit < 0.6 and options[OUTLINES].against < 0.1


def test_a_turned_box_has_its_own_axes():
    turn = np.deg2rad(25.0)
    matrix = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]])
    found, truth = seen_along(lambda at: box((0.6, 0.3, 0.5))(at @ matrix.T), CORNER)
    axes = square_axes(found)
    assert np.abs(axes @ matrix.T).max(axis=1) == pytest.approx(1.0, abs=1e-3)
    assert overlap(outline_fill(found, axes) < 0, truth < 0) > 0.85


def test_the_outlines_of_a_table_give_it_the_legs_that_nobody_saw():
    legs = [box((0.08, 0.08, 0.4), (x, y, -0.2)) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    top = box((0.6, 0.6, 0.1), (0, 0, 0.3))
    found, truth = seen_along(
        lambda at: np.minimum.reduce([part(at) for part in (top, *legs)]), ((0, -1), (1, -1), (2, -1))
    )
    fill = outline_fill(found, np.eye(3))
    open_to = with_margin(found.evidence).state != Evidence.EMPTY
    assert overlap((fill < 0) & open_to, truth < 0) > 0.7 > overlap((convex_fill(found) < 0) & open_to, truth < 0)


def test_a_fill_in_coarse_voxels_is_refined_to_itself_where_it_is_linear():
    found, _ = seen_along(box((0.6, 0.4, 0.5)), CORNER)
    fine = found.evidence
    part = (slice(None, None, 3),) * 3
    coarse = replace(fine, voxel=3 * fine.voxel, state=fine.state[part].copy(), sdf=fine.sdf[part].copy())

    def slope(evidence):
        grid = with_margin(evidence)
        at = [grid.origin[a] + grid.voxel * np.arange(n) for a, n in enumerate(grid.state.shape)]
        return ((at[0][:, None, None] + 0.5 * at[1][:, None] - at[2]) / grid.voxel).astype(np.float32)

    inner = (slice(2, -4),) * 3
    assert refined(slope(coarse), coarse, fine)[inner] == pytest.approx(slope(fine)[inner], abs=1e-4)


def test_a_mirrored_half_is_the_other_half():
    found, truth = seen_along(bowl, ((0, -1),))
    plane = MirrorPlane(normal=np.array([1.0, 0, 0]), offset=0.0, support=1.0, contradiction=0.0)
    whole = mirrored(found, plane)
    grid = with_margin(whole.evidence)
    new = (grid.state == Evidence.SURFACE) & (with_margin(found.evidence).state == Evidence.UNKNOWN)
    assert new.sum() > 200
    assert np.abs(grid.sdf[new] / VOXEL - truth[new]).max() < 0.3
    kept = found.evidence.state != Evidence.UNKNOWN
    assert np.array_equal(whole.evidence.state[kept], found.evidence.state[kept])
    assert np.array_equal(whole.evidence.sdf[kept], found.evidence.sdf[kept])
    own = len(found.mesh.vertices)
    assert len(whole.mesh.vertices) > own and whole.mesh.faces.max() < len(whole.mesh.vertices)
    assert np.abs(bowl(whole.mesh.vertices[own:].astype(float))).max() < 0.2 * VOXEL


def test_what_rays_passed_speaks_against_a_candidate_and_stays_empty():
    """The notch of an L was seen to be empty: its convex hull would fill it."""
    parts = (box((0.6, 0.5, 0.15), (0, 0, -0.45)), box((0.15, 0.5, 0.6), (-0.45, 0, 0)))
    found, _ = seen_along(lambda at: np.minimum(parts[0](at), parts[1](at)), CORNER)
    options = made(found)
    assert options[CONVEX].against > 0.15 and options[CONVEX].misfit > 0.1
    assert options[HULL].against == 0.0
    for option in options.values():
        assert not ((option.composed.distance < 0) & (option.composed.evidence.state == Evidence.EMPTY)).any()
    assert trouble(*_mesh(options[OUTLINES].composed)) == ""


def _mesh(composed):
    grid = composed.evidence
    return grid_surface(composed.distance, grid.origin, grid.voxel)


def test_a_thing_seen_from_all_sides_leaves_nothing_to_choose():
    found, _ = seen_along(box((0.5, 0.4, 0.3)), [(axis, sign) for axis in range(3) for sign in (-1, 1)])
    (only,) = candidates(found, hypotheses(found), lambda _: pytest.fail("no network is needed"))
    assert only.name == HULL and imagined_share(only.composed) < 0.005


def test_a_network_is_asked_for_what_was_measured_and_for_its_mirror_images(crate):
    found, truth = crate
    asked = []

    def knows(seen, _):
        asked.append(seen)
        return truth.astype(np.float32)

    options = made(found, knows)
    assert asked[0] is found and len(asked) <= 2
    assert overlap(options[NETWORK].composed.distance < 0, truth < 0) > 0.98


def test_too_few_points_fit_no_shape(crate):
    found, _ = crate
    mesh = Mesh(vertices=found.mesh.vertices[:20], faces=np.zeros((0, 3), np.int32))
    few = replace(found, mesh=mesh)
    assert outline_fill(few, np.eye(3)) is None
