"""One closed surface, whatever the evidence: measured surface stays, seen-empty stays empty, pieces and hollows go."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from goc.complete import CompleteConfig, Measured, close_objects, compose, compose_field, evidence_hull, with_margin
from goc.complete.compose import without_cavities, without_pockets
from goc.errors import ConfigError
from goc.events import Progress, Warned
from goc.geometry.isosurface import grid_surface
from goc.scene import Evidence, EvidenceGrid, Mesh
from halfseen import as_object, half_seen, sphere_distance
from oracles.watertight import signed_volume, trouble


def meshed(field):
    return grid_surface(field, np.zeros(3), 1.0)


def points_of(state):
    return np.argwhere(state == Evidence.SURFACE).astype(np.float32)


def bare(evidence, points):
    mesh = Mesh(vertices=points.astype(np.float32), faces=np.zeros((0, 3), np.int32))
    return Measured(mesh=mesh, evidence=evidence)


@given(arrays(np.float32, (6, 5, 7), elements=st.floats(-1, 1, width=32)))
@settings(max_examples=200)
def test_any_field_makes_a_closed_surface(field):
    """Noise has all sign patterns, zeros and values next to zero."""
    vertices, faces = meshed(field)
    if len(faces):
        assert trouble(vertices, faces) in ("", "turned inside out")
    else:
        assert not (field < 0).any()


@pytest.mark.parametrize("seed", range(3))
def test_the_surface_of_noise_is_a_manifold_far_from_the_origin(seed):
    field = np.random.default_rng(seed).normal(size=(24, 17, 9)).astype(np.float32)
    vertices, faces = grid_surface(field, np.array([7.0, -9.0, 3.0]), 0.003)
    assert trouble(vertices, faces) == ""


states = arrays(np.uint8, (7, 6, 5), elements=st.sampled_from([0, 1, 2]))
sdfs = arrays(np.float32, (7, 6, 5), elements=st.floats(-0.25, 0.25, width=32))


@given(states, sdfs, st.booleans(), st.integers(0, 99))
@settings(max_examples=150)
def test_any_evidence_becomes_one_closed_surface(state, sdf, with_fill, seed):
    evidence = EvidenceGrid(origin=np.array([1.0, 2.0, 3.0]), voxel=0.1, state=state, sdf=sdf)
    grid = with_margin(evidence)
    random = np.random.default_rng(seed)
    fill = random.normal(size=grid.state.shape).astype(np.float32) if with_fill else None
    found = bare(evidence, evidence.origin + 0.1 * points_of(state))
    done = compose(found, fill)
    if len(done.mesh.faces):
        assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    field = compose_field(grid, fill, found.mesh.vertices).distance
    assert (field != 0).all()
    rooms, _ = ndimage.label(field > 0, ndimage.generate_binary_structure(3, 2))
    assert rooms.max() == 1  # no hollows
    passed, _ = ndimage.label(grid.state == Evidence.EMPTY)
    assert (field[passed == passed[0, 0, 0]] > 0).all()  # a ray's way in is never closed


@given(states, sdfs)
@settings(max_examples=100)
def test_the_hull_contradicts_no_ray(state, sdf):
    evidence = EvidenceGrid(origin=np.zeros(3), voxel=0.1, state=state, sdf=sdf)
    field = evidence_hull(evidence)
    assert (field[state == Evidence.EMPTY] > 0).all()
    seen = state == Evidence.SURFACE
    np.testing.assert_allclose(field[seen], np.clip(sdf[seen] / 0.1, -3, 3), rtol=1e-6)


def test_half_a_sphere_and_half_a_guess():
    """Seen from above: the cap is measured to the last bit, below hangs the shadow of the sphere, down to the box."""
    found, radius, centre = half_seen()
    done = compose(found, None)
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    off = np.linalg.norm(done.mesh.vertices - centre, axis=1) - radius
    voxel = found.evidence.voxel
    assert np.abs(off[done.observed]).max() < 0.1 * voxel
    assert 0.3 < done.observed.mean() < 0.6
    below = (done.mesh.vertices[:, 2] < centre[2] - 3 * voxel) & (done.mesh.vertices[:, 2] > centre[2] - radius)
    beside = np.linalg.norm(done.mesh.vertices[below, :2] - centre[:2], axis=1)
    assert np.abs(beside[beside > 0.8 * radius] - radius).max() < voxel  # the cylinder that no ray from above entered


def test_a_right_fill_makes_the_sphere_whole():
    found, radius, centre = half_seen()
    grid = with_margin(found.evidence)
    done = compose(found, (sphere_distance(grid, centre, radius) / grid.voxel).astype(np.float32))
    off = np.linalg.norm(done.mesh.vertices - centre, axis=1) - radius
    assert np.abs(off).max() < 0.35 * grid.voxel
    volume = signed_volume(done.mesh.vertices, done.mesh.faces)
    assert volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.01)


def test_a_fill_that_is_off_meets_the_measured_surface_without_a_step():
    """The model's sphere is 2 voxels too small: the seam slopes, it has no wall."""
    found, radius, centre = half_seen()
    grid = with_margin(found.evidence)
    fill = (sphere_distance(grid, centre, radius - 2 * grid.voxel) / grid.voxel).astype(np.float32)
    done = compose(found, fill)
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    off = (np.linalg.norm(done.mesh.vertices - centre, axis=1) - radius) / grid.voxel
    assert np.abs(off[done.observed]).max() < 0.1
    lowest = done.mesh.vertices[:, 2] < centre[2] - 0.5 * radius
    assert np.abs(off[lowest] + 2).max() < 0.4
    a, b, c = (off[done.mesh.faces[:, i]] for i in range(3))
    assert max(np.abs(a - b).max(), np.abs(b - c).max()) < 1.0  # no face spans the whole offset


def test_floaters_go_and_parts_stay():
    shape = (40, 16, 16)
    at = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).astype(float)
    blobs = {(7, 8, 8): 4.0, (20, 8, 8): 3.0, (33, 8, 8): 4.0}
    sdf = np.min([np.linalg.norm(at - np.array(c), axis=-1) - r for c, r in blobs.items()], axis=0)
    state = np.where(np.abs(sdf) < 2, Evidence.SURFACE, np.where(sdf > 0, Evidence.EMPTY, Evidence.UNKNOWN))
    evidence = EvidenceGrid(origin=np.zeros(3), voxel=1.0, state=state.astype(np.uint8), sdf=sdf.astype(np.float32))
    ring = np.argwhere(
        (np.abs(sdf) < 0.5) & (at[..., 0] < 26) & (at[..., 0] > 13) | (np.abs(sdf) < 0.5) & (at[..., 0] < 13)
    )
    done = compose(bare(evidence, ring), None)
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    assert done.mesh.vertices[:, 0].max() < 26  # the third ball carries none of the object's measured surface
    assert done.mesh.vertices[:, 0].max() > 20


def test_a_hollow_that_nothing_leads_to_is_filled():
    field = np.full((9, 9, 9), 1.0, np.float32)
    field[1:8, 1:8, 1:8] = -1
    field[4, 4, 4] = 1
    assert without_cavities(field)[4, 4, 4] == -1
    field[4, 4, :5] = 1  # a way out
    assert without_cavities(field)[4, 4, 4] == 1


def pocket(gap, state=Evidence.UNKNOWN):
    """A solid of 100 voxels with a room inside, and a square tunnel into it from seen-empty space above."""
    field, evidence = np.full((104, 40, 40), -1.0, np.float32), np.full((104, 40, 40), Evidence.UNKNOWN, np.uint8)
    outside = np.pad(np.zeros((100, 36, 36), bool), 2, constant_values=True)
    field[outside], evidence[outside] = 1, Evidence.EMPTY
    field[40:60, 12:28, 12:28] = 1
    tunnel = slice(50, 50 + gap), slice(20, 20 + gap), slice(20, 38)
    field[tunnel] = 1
    evidence[tunnel] = np.where(outside[tunnel], Evidence.EMPTY, state)
    return field, evidence


def test_guessed_space_behind_a_narrow_gap_is_filled():
    field, state = pocket(2)
    filled = without_pockets(field, state)
    assert (filled[4:-4, 4:-4, 4:-4] == -1).all()  # the gap's mouth stays a dent
    assert (filled[state == Evidence.EMPTY] == 1).all()
    wide, state = pocket(8)
    assert np.array_equal(without_pockets(wide, state), wide)


def test_a_narrow_gap_that_rays_passed_leads_somewhere():
    field, state = pocket(2, Evidence.EMPTY)
    assert np.array_equal(without_pockets(field, state), field)


def test_colours_are_carried_over_and_spread():
    found, _, centre = half_seen()
    done = compose(found, None)
    assert done.mesh.colours is not None
    right = done.mesh.vertices[:, 0] > centre[0]
    clear = done.observed & (np.abs(done.mesh.vertices[:, 0] - centre[0]) > 0.05)
    assert (done.mesh.colours[clear & right, 0] > 200).all()
    assert (done.mesh.colours[clear & ~right, 2] > 200).all()
    filled = ~done.observed & (np.abs(done.mesh.vertices[:, 0] - centre[0]) > 0.2)
    red, blue = done.mesh.colours[filled & right][:, [0, 2]].astype(int).T
    assert (red > blue + 20).all()  # less sure of it than the measured side, and the better for it


def test_the_stage_closes_what_it_can_and_says_what_it_cannot():
    found, _, _ = half_seen()
    nothing = EvidenceGrid(
        origin=np.zeros(3),
        voxel=0.1,
        state=np.full((4, 4, 4), Evidence.EMPTY, np.uint8),
        sdf=np.zeros((4, 4, 4), np.float32),
    )
    heard = []
    dust = as_object(bare(nothing, np.zeros((1, 3))), 1, "dust")
    given = (as_object(found), dust, replace(as_object(found, 4), evidence=None))
    done = close_objects(given, CompleteConfig(method="hull"), heard.append)
    assert [(item.id, item.solid is not None) for item in done] == [(3, True), (1, False), (4, False)]
    assert done[0].evidence is given[0].evidence and done[0].observed is given[0].observed
    assert [event.done for event in heard if isinstance(event, Progress)] == [1, 2, 3]
    assert [event.message for event in heard if isinstance(event, Warned)] == [
        "Object 1 (dust) cannot be closed: it has no faces. It has its measured surface only.",
        "Object 4 (ball) cannot be closed: its surface or its evidence is missing. It has its measured surface only.",
    ]
    assert close_objects(given, CompleteConfig(method="none")) == given


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"threshold": 1.0}, r"CompleteConfig\.threshold is 1: needs more than 0, below 1"),
        ({"coarse_cells": 4}, r"CompleteConfig\.coarse_cells is 4: needs 8 to 512"),
        ({"method": "osc"}, r"method osc needs CompleteConfig\.weights"),
        (
            {"method": "hull", "weights": __file__},
            r"weights is given, but CompleteConfig\.method hull uses none",
        ),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings, text):
    from pathlib import Path

    settings = {key: Path(value) if key == "weights" else value for key, value in settings.items()}
    with pytest.raises(ConfigError, match=text):
        CompleteConfig(**settings)


def block(low, high, seen_above, shape=(24, 24, 24)):
    """A block of which the top was seen from straight above, on a grid of unit voxels; below is unknown."""
    at = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1)
    inside = ((at >= low) & (at <= high)).all(axis=-1)
    column = inside.any(axis=2)[..., None] & (at[..., 2] <= high[2])
    height = at[..., 2] - (high[2] + 0.5)
    surface = inside.any(axis=2)[..., None] & (np.abs(height) <= 2) & seen_above[..., None]
    hidden = (column | ~seen_above[..., None]) & (at[..., 2] <= 14)
    state = np.where(surface, Evidence.SURFACE, np.where(hidden, Evidence.UNKNOWN, Evidence.EMPTY)).astype(np.uint8)
    sdf = np.where(surface, height, 0).astype(np.float32)
    return EvidenceGrid(origin=np.zeros(3), voxel=1.0, state=state, sdf=sdf)


def test_what_a_small_object_fills_is_empty_for_the_large_one_below():
    """A cup on a table: no ray sees what is inside the cup, and the table's hull alone would hold it."""
    everywhere = np.ones((24, 24), bool)
    beside = everywhere.copy()
    beside[10:15, 10:15] = False
    cup = block((10, 10, 8), (14, 14, 14), everywhere)
    cup = EvidenceGrid(
        origin=cup.origin + [0, 0, 8], voxel=1.0, state=cup.state[:, :, 8:].copy(), sdf=cup.sdf[:, :, 8:].copy()
    )
    table = block((2, 2, 3), (21, 21, 7), beside)
    below, above = bare(table, points_of(table.state)), bare(cup, points_of(cup.state) + [0, 0, 8])
    assert compose(below, None).mesh.vertices[:, 2].max() > 12
    done = close_objects((as_object(below, 1), as_object(above, 2)), CompleteConfig(method="hull"))
    table_mesh, cup_mesh = (item.solid.mesh for item in done)
    assert [item.id for item in done] == [1, 2]
    assert 7 < table_mesh.vertices[:, 2].max() < 8.6
    assert cup_mesh.vertices[:, 2].min() > 7
    assert trouble(table_mesh.vertices, table_mesh.faces) == ""
