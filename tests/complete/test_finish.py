"""The surface that completion hands on: light, closed, measured where it was measured, and coloured all over."""

from dataclasses import replace

import numpy as np
import pytest

from goc.complete import CompleteConfig, closed_surface, compose_field, with_margin
from goc.complete.colours import inpainted, with_measured_colours
from goc.complete.compose import bare_surface
from goc.complete.finish import finished_surface
from goc.errors import ConfigError
from goc.geometry.raycast import TriangleScene
from goc.geometry.simplify import face_qualities
from goc.geometry.topology import is_watertight
from goc.scene import FlaggedMesh, Mesh
from halfseen import half_seen


def halves():
    found, _, _ = half_seen()
    return compose_field(with_margin(found.evidence), None, found.mesh.vertices), found.mesh


def test_a_finished_surface_is_light_and_closed_and_measured_where_it_was():
    composed, seen = halves()
    full = closed_surface(composed, seen)
    light = finished_surface(composed, seen, 300, units_per_metre=1.0)
    assert is_watertight(light.mesh) and len(light.mesh.faces) < len(full.mesh.faces)
    assert (face_qualities(light.mesh) < 0.3).mean() <= 0.02
    away = TriangleScene(light.mesh.vertices, light.mesh.faces).nearest(full.mesh.vertices[full.observed])[0]
    longest = float(np.ptp(full.mesh.vertices, axis=0).max())
    assert away.max() <= min(0.001, max(0.002 * longest, 0.1 * composed.evidence.voxel)) + 1e-6
    assert light.observed.any() and not light.observed.all()


def test_the_unit_of_a_scene_does_not_change_what_is_kept():
    composed, seen = halves()
    grid = composed.evidence
    large = replace(
        composed,
        evidence=replace(grid, origin=grid.origin * 100, voxel=grid.voxel * 100, sdf=grid.sdf * np.float32(100)),
    )
    there = replace(seen, vertices=seen.vertices * np.float32(100))
    here = finished_surface(composed, seen, 300, units_per_metre=1.0).mesh
    found = finished_surface(large, there, 300, units_per_metre=100.0).mesh
    assert len(found.faces) == pytest.approx(len(here.faces), rel=0.05)


def test_all_faces_are_kept_on_request_and_measured_ones_stay():
    composed, seen = halves()
    full, kept = closed_surface(composed, seen), finished_surface(composed, seen, 0, units_per_metre=1.0)
    np.testing.assert_array_equal(kept.mesh.faces, full.mesh.faces)
    np.testing.assert_array_equal(kept.mesh.vertices[kept.observed], full.mesh.vertices[full.observed])
    moved = np.linalg.norm(kept.mesh.vertices - full.mesh.vertices, axis=1)
    assert 0.05 < moved.max() / composed.evidence.voxel < 3


def test_where_simplification_breaks_the_surface_the_full_one_is_handed_on(monkeypatch):
    composed, seen = halves()

    def broken(surface, limits):
        return replace(surface, mesh=replace(surface.mesh, faces=surface.mesh.faces[1:]))

    monkeypatch.setattr("goc.complete.finish.simplified", broken)
    found = finished_surface(composed, seen, 300, units_per_metre=1.0)
    full = closed_surface(composed, seen)
    np.testing.assert_array_equal(found.mesh.vertices, full.mesh.vertices)
    np.testing.assert_array_equal(found.mesh.faces, full.mesh.faces)


def test_a_number_of_faces_below_none_is_refused():
    with pytest.raises(ConfigError, match=r"CompleteConfig\.faces is -1: needs 0 or more"):
        CompleteConfig(faces=-1)


def plate(step=1.0, side=30):
    """A flat sheet of squares."""
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    vertices = np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(np.float32) * np.float32(step)
    at = (x[:-1, :-1] * side + y[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack([at, at + side, at + 1], 1), np.stack([at + 1, at + side, at + side + 1], 1)])
    return Mesh(vertices=vertices, faces=faces.astype(np.int32))


def test_a_patch_that_was_hidden_gets_the_colour_of_its_plate():
    mesh = plate()
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    left = x < 15
    colours = np.where(left[:, None], [220, 180, 30], [20, 60, 150]).astype(np.uint8)
    hidden = (np.abs(x - 6) < 4) & (np.abs(y - 15) < 5)
    shown = FlaggedMesh(mesh=mesh, observed=~hidden)
    found = inpainted(with_measured_colours(shown, replace(mesh, colours=colours))).mesh.colours.astype(int)
    assert np.abs(found[hidden] - [220, 180, 30]).max() < 25
    np.testing.assert_array_equal(found[x > 15], colours[x > 15])


def test_bare_surfaces_have_no_colours():
    composed, seen = halves()
    assert bare_surface(composed).mesh.colours is None
    assert with_measured_colours(bare_surface(composed), replace(seen, colours=None)).mesh.colours is None


def test_the_shadow_round_what_stood_on_a_plate_goes_with_it():
    mesh = plate()
    apart = np.hypot(mesh.vertices[:, 0] - 14, mesh.vertices[:, 1] - 15)
    colours = np.where((apart < 6)[:, None], [90, 70, 20], [220, 180, 30]).astype(np.uint8)
    shown = FlaggedMesh(mesh=mesh, observed=apart > 5)
    found = inpainted(with_measured_colours(shown, replace(mesh, colours=colours))).mesh.colours.astype(int)
    assert np.abs(found[apart <= 5] - [220, 180, 30]).max() < 12
    assert np.abs(found[apart < 6] - [220, 180, 30]).max() < 30
    np.testing.assert_array_equal(found[apart > 13], colours[apart > 13])


def test_the_rim_of_an_underside_keeps_its_colours():
    composed, seen = halves()
    surface = with_measured_colours(bare_surface(composed), seen)
    found = inpainted(surface)
    np.testing.assert_array_equal(found.mesh.colours[found.observed], surface.mesh.colours[surface.observed])
