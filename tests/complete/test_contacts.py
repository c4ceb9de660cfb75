"""Who stands on whom, and that nothing reaches through what it stands on or stands before."""

from dataclasses import replace

import numpy as np
import pytest

from goc.complete import CompleteConfig, close_objects
from goc.complete.bounds import Bounds, cut
from goc.complete.compose import Composition
from goc.complete.contacts import with_contacts
from goc.evaluation.metrics import sample_surface
from goc.evaluation.volumes import SolidMesh, penetration
from goc.geometry.topology import signed_volume, watertight_flaw
from goc.scene import ROOM, EvidenceGrid, FlaggedMesh, HalfSpace, Mesh
from halfseen import sphere_distance
from solids import joined
from standing import UPRIGHT, VOXEL, at, floor, open_box, patch, thing, world

BOX = ((-0.15, -0.12, 0.0), (0.15, 0.12, 0.2))
CUP = ((-0.04, -0.05, 0.2), (0.05, 0.04, 0.3))
TABLE = [
    ((-0.3, -0.2, 0.3), (0.3, 0.2, 0.34)),
    *(((x, y, 0.0), (x + 0.04, y + 0.04, 0.3)) for x in (-0.3, 0.26) for y in (-0.2, 0.16)),
]
HULL = CompleteConfig(method="hull")


def tilted(degrees=0.0, shift=(0.0, 0.0, 0.0), scale=1.0):
    pose = np.eye(4)
    turn = np.radians(degrees)
    pose[:3, :3] = scale * np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    pose[:3, 3] = shift
    return pose


def room_with(*parts, pose=UPRIGHT, ground=None):
    return at(joined(ground or floor(), *parts), pose)


def heights(solid, pose=UPRIGHT):
    return (solid.mesh.vertices - pose[:3, 3]) @ pose[:3, 2]


@pytest.mark.parametrize("degrees", [0.0, 25.0])
@pytest.mark.parametrize("height", [0.0, 0.0033])
def test_a_box_on_a_floor_ends_at_the_floor(degrees, height):
    """Of its bottom, and of the space below the floor, nothing was seen: what fills that must not go on below."""
    pose = tilted(degrees, (0.3, 0.2, height))
    crate = thing(1, [BOX], pose=pose, hidden=0.0)
    (found,) = with_contacts((crate,), room_with(open_box(*BOX), pose=pose), world(pose))
    assert found.contact is not None and found.contact.on == (ROOM,)
    (closed,) = close_objects((found,), HULL)
    assert watertight_flaw(closed.solid.mesh) is None
    low = heights(closed.solid, pose)
    assert abs(low.min()) < 0.1 * VOXEL
    assert signed_volume(closed.solid.mesh) == pytest.approx(0.3 * 0.24 * 0.2, rel=0.03)
    middle = np.abs((closed.solid.mesh.vertices - pose[:3, 3]) @ pose[:3, :3])[:, :2].max(axis=1) < 0.08
    flat = middle & (low < 0.1)
    assert flat.sum() > 100 and np.abs(low[flat]).max() < 0.1 * VOXEL  # a face, not an edge
    assert not closed.solid.observed[flat].any()


def test_a_cup_on_a_box_and_the_box_meet_in_a_plane():
    """What both hide from each other belongs to neither: the box ends where the cup begins."""
    cup = thing(2, [CUP], shade=[((-0.15, -0.12, 0.1), (0.15, 0.12, 0.2))], hidden=0.0)
    crate = thing(1, [BOX], shade=[CUP])
    objects = with_contacts((crate, cup), room_with(open_box(*BOX), open_box(*CUP)), world())
    assert [item.contact.on for item in objects] == [(ROOM,), (1,)]
    assert objects[1].contact.plane.offset == pytest.approx(0.2, abs=1e-6)
    closed = close_objects(objects, HULL)
    assert heights(closed[1].solid).min() == pytest.approx(0.2, abs=0.1 * VOXEL)
    assert heights(closed[0].solid).max() == pytest.approx(0.2, abs=0.1 * VOXEL)
    solids = [SolidMesh(item.solid.mesh) for item in closed]
    samples = [sample_surface(solid.mesh, 20_000, 0) for solid in solids]
    assert penetration(solids[0], samples[0], solids[1], samples[1], 0).depth < 1e-4
    assert solids[0].volume == pytest.approx(0.3 * 0.24 * 0.2, rel=0.03)


def test_the_space_below_a_table_is_not_filled():
    """Its contact is the floor, on which it stands with its legs: that forbids what is below, and fills nothing."""
    table = thing(4, TABLE)
    (found,) = with_contacts((table,), room_with(*(open_box(*box) for box in TABLE)), world())
    assert found.contact.on == (ROOM,) and found.contact.plane.offset == pytest.approx(0, abs=1e-6)
    (closed,) = close_objects((found,), HULL)
    assert abs(heights(closed.solid).min()) < 0.1 * VOXEL
    wood = 0.6 * 0.4 * 0.04 + 4 * 0.04 * 0.04 * 0.3
    assert signed_volume(closed.solid.mesh) == pytest.approx(wood, rel=0.1)


def test_a_stray_below_the_floor_does_not_stretch_an_object():
    crate = thing(1, [BOX])
    spur = np.array([[0.0, 0, -0.03], [0.01, 0, -0.03], [0, 0.01, -0.03]], np.float32)
    mesh = joined(crate.observed.mesh, Mesh(vertices=spur, faces=np.array([[0, 1, 2]], np.int32)))
    state, sdf = crate.evidence.state.copy(), crate.evidence.sdf.copy()
    around = tuple(np.rint((spur[0] - crate.evidence.origin) / VOXEL).astype(int))
    state[around], sdf[around] = 2, -VOXEL
    strayed = replace(
        crate,
        observed=FlaggedMesh(mesh=mesh, observed=np.ones(len(mesh.vertices), bool)),
        evidence=replace(crate.evidence, state=state, sdf=sdf),
    )
    (found,) = with_contacts((strayed,), room_with(open_box(*BOX)), world())
    (closed,) = close_objects((found,), HULL)
    assert abs(heights(closed.solid).min()) < 0.1 * VOXEL


def test_nothing_reaches_behind_a_wall():
    """The unseen back of a cabinet against a wall ends at the wall."""
    wall = patch([-0.75, -0.15, 0], [0, 0, 1.2], [1.5, 0, 0], 0.02)  # looks along +y
    assert np.cross([0, 0, 1.2], [1.5, 0, 0])[1] > 0
    cabinet = thing(1, [BOX], shade=[((-0.5, -1.0, -1.0), (0.5, -0.11, 0.17))])
    objects = with_contacts((cabinet,), room_with(open_box(*BOX), wall), world())
    (plane,) = objects[0].walls
    np.testing.assert_allclose(plane.normal, [0, 1, 0], atol=1e-6)
    assert plane.offset == pytest.approx(-0.15, abs=1e-3)
    (closed,) = close_objects(objects, HULL)
    (free,) = close_objects((replace(objects[0], walls=()),), HULL)
    assert closed.solid.mesh.vertices[:, 1].min() > -0.15 - 0.1 * VOXEL
    assert free.solid.mesh.vertices[:, 1].min() < -0.16


def test_a_wall_that_ends_before_an_object_bounds_nothing():
    stub = patch([-0.75, -0.15, 0], [0, 0, 1.2], [0.55, 0, 0], 0.02)
    (found,) = with_contacts((thing(1, [BOX]),), room_with(open_box(*BOX), stub), world())
    assert found.walls == ()


def test_a_board_on_two_boxes_stands_on_both():
    ends = [((-0.3, -0.1, 0.0), (-0.1, 0.1, 0.2)), ((0.1, -0.1, 0.0), (0.3, 0.1, 0.2))]
    board = ((-0.25, -0.05, 0.2), (0.25, 0.05, 0.24))
    objects = tuple(thing(number, [box]) for number, box in enumerate([*ends, board], 1))
    found = with_contacts(objects, room_with(*(open_box(*box) for box in [*ends, board])), world())
    assert [item.contact.on for item in found] == [(ROOM,), (ROOM,), (1, 2)]
    assert found[2].contact.plane.offset == pytest.approx(0.2, abs=1e-6)


def test_what_hangs_stands_on_nothing():
    lamp = thing(1, [((-0.1, -0.1, 0.4), (0.1, 0.1, 0.6))])
    (found,) = with_contacts((lamp,), room_with(open_box((-0.1, -0.1, 0.4), (0.1, 0.1, 0.6))), world())
    assert found.contact is None


@pytest.mark.parametrize(("gap", "bears"), [(0.02, True), (0.2, False)])
def test_an_unseen_floor_bears_what_is_just_above_it(gap, bears):
    """No floor was seen round the footprint, and of the box not its lowest part."""
    box = ((-0.15, -0.12, gap), (0.15, 0.12, gap + 0.3))
    crate = thing(1, [box], hidden=gap + 0.01)
    (found,) = with_contacts((crate,), at(open_box(*box), UPRIGHT), world())
    assert (found.contact is not None) == bears
    (unsure,) = with_contacts((crate,), at(open_box(*box), UPRIGHT), world(confidence=0.2))
    assert unsure.contact is None


@pytest.mark.parametrize("pose", [tilted(35.0, (1.0, -2.0, 0.5)), tilted(0.0, (0, 0, 3.0), 100.0)])
def test_contacts_move_with_the_scene(pose):
    """Turned, moved, or measured in centimetres: the same contacts, at the same places."""
    wall = patch([-0.75, -0.15, 0], [0, 0, 1.2], [1.5, 0, 0], 0.02)
    things = (thing(1, [BOX]), thing(2, [CUP]))
    room = joined(floor(), wall, open_box(*BOX), open_box(*CUP))
    moved = tuple(
        replace(item, observed=replace(item.observed, mesh=at(item.observed.mesh, pose)), evidence=None)
        for item in things
    )
    still = with_contacts(tuple(replace(item, evidence=None) for item in things), room, world())
    found = with_contacts(moved, at(room, pose), world(pose))
    scale = np.linalg.norm(pose[:3, 0])
    for before, after in zip(still, found, strict=True):
        assert before.contact.on == after.contact.on
        for first, second in zip(
            (before.contact.plane, *before.walls), (after.contact.plane, *after.walls), strict=True
        ):
            np.testing.assert_allclose(pose[:3, :3] / scale @ first.normal, second.normal, atol=1e-4)
            point = pose[:3, :3] @ (first.normal * first.offset) + pose[:3, 3]
            assert second.normal @ point == pytest.approx(second.offset, abs=1e-3 * scale)


def test_objects_without_surface_get_no_contact():
    bare = replace(thing(1, [BOX]), observed=None)
    assert with_contacts((bare,), floor(), world())[0].contact is None


def test_a_single_triangle_in_a_scene_of_nothing_else_has_no_walls():
    leaf = Mesh(vertices=np.float32([[0, 0, 0.5], [1, 0, 0.5], [0, 0, 1.5]]), faces=np.int32([[0, 1, 2]]))
    item = replace(thing(1, [BOX]), observed=FlaggedMesh(mesh=leaf, observed=np.ones(3, bool)), evidence=None)
    (found,) = with_contacts((item,), leaf, world())
    assert found.contact is None and found.walls == ()


def test_a_field_is_not_cut_away_whole():
    grid = grid_of((6, 6, 6), 0.0, 1.0)
    distance = np.ones((6, 6, 6), np.float32)
    distance[2:4, 2:4, 2] = -0.5
    above = Bounds(walls=(HalfSpace(normal=np.array([0.0, 0, 1]), offset=4.0),))
    composed = Composition(distance=distance, evidence=grid)
    assert cut(composed, above, []) is composed


@pytest.mark.parametrize("shift", [0.0, 0.4])
def test_what_was_closed_first_stays_and_others_give_way(shift):
    """A ball half in space that nobody saw, of voxels of another size: the rest ends at it, to a part of a voxel."""
    ball = grid_of((20, 20, 20), -10.0, 1.0)
    space = grid_of((16, 16, 16), -9.0 + shift, 1.2)
    sphere = np.clip(sphere_distance(ball, np.zeros(3), 6.0), -3, 3).astype(np.float32)
    half = np.full((16, 16, 16), 3, np.float32)
    half[1:-1, 1:-1, 1:8] = -3
    left = cut(Composition(distance=half, evidence=space), Bounds(), [Composition(distance=sphere, evidence=ball)])
    expected, near = -sphere_distance(space, np.zeros(3), 6.0) / 1.2, half < 0
    near &= np.abs(expected) < 1.5
    np.testing.assert_allclose(left.distance[near], expected[near], atol=0.1)


def grid_of(shape, corner, voxel):
    return EvidenceGrid(
        origin=np.full(3, corner), voxel=voxel, state=np.zeros(shape, np.uint8), sdf=np.zeros(shape, np.float32)
    )
