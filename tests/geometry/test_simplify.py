"""Lighter surfaces: closed, near the old one from both sides, of good faces, with flags and colours where they were."""

import numpy as np
import pytest

from goc import _native
from goc.geometry.isosurface import grid_surface
from goc.geometry.raycast import TriangleScene
from goc.geometry.relax import relaxed_surface, vertex_links, without_cuts
from goc.geometry.simplify import GOOD_FACE, SimplifyLimits, face_qualities, simplified
from goc.geometry.surfaces import surface_cloud
from goc.geometry.topology import is_watertight, signed_volume
from goc.scene import FlaggedMesh, Mesh
from laws import carried, rigid, scaled
from oracles.simplification import Simplification
from solids import cube, sphere

SIDE = 40
AT = np.stack(np.meshgrid(*(np.arange(SIDE) - (SIDE - 1) / 2,) * 3, indexing="ij"), -1)
FIELDS = {
    "ball": np.linalg.norm(AT, axis=-1) - 14.3,
    "box": (np.abs(AT) - [15.2, 9.7, 6.3]).max(axis=-1),
    "ring": np.hypot(np.hypot(AT[..., 0], AT[..., 1]) - 12.1, AT[..., 2]) - 4.4,
}


def surface_of(field, seen=lambda at: at[:, 2] > -1.7) -> FlaggedMesh:
    vertices, faces = grid_surface(field.astype(np.float32), np.full(3, (1 - SIDE) / 2), 1.0)
    mesh = Mesh(vertices=vertices, faces=faces, colours=np.full((len(vertices), 3), 90, np.uint8))
    return FlaggedMesh(mesh=mesh, observed=seen(vertices))


def apart(a: Mesh, b: Mesh) -> float:
    """Root mean square of the distances of points on one mesh from the other."""
    points = surface_cloud(a, 4000).positions
    return float(np.sqrt((TriangleScene(b.vertices, b.faces).nearest(points)[0] ** 2).mean()))


@pytest.mark.parametrize("shape", FIELDS)
def test_a_lighter_surface_is_closed_near_and_without_slivers(shape):
    full = surface_of(FIELDS[shape])
    light = simplified(full, SimplifyLimits(tolerance=0.15, faces=1200))
    assert is_watertight(light.mesh)
    assert len(light.mesh.faces) <= 1200 < len(full.mesh.faces) / 2
    assert apart(full.mesh, light.mesh) < 0.08 and apart(light.mesh, full.mesh) < 0.08
    assert signed_volume(light.mesh) == pytest.approx(signed_volume(full.mesh), rel=0.01)
    assert shape == "box" or (face_qualities(full.mesh) < GOOD_FACE).mean() > 0.1
    assert (face_qualities(light.mesh) < GOOD_FACE).mean() <= 0.02


def test_a_box_keeps_its_edges_and_needs_few_faces():
    full = surface_of(FIELDS["box"], lambda at: np.ones(len(at), bool))
    light = simplified(full, SimplifyLimits(tolerance=0.05, faces=500)).mesh
    assert len(light.faces) <= 500
    flat = [(np.abs(surface_cloud(mesh, 4000).normals).max(axis=1) > 0.99).mean() for mesh in (full.mesh, light)]
    assert flat[1] > flat[0] - 0.01 > 0.8
    np.testing.assert_allclose(np.ptp(light.vertices, axis=0), [30.4, 19.4, 12.6], atol=0.6)


def test_where_the_tolerance_ends_more_faces_stay():
    full = surface_of(FIELDS["ball"])
    tight, loose = (simplified(full, SimplifyLimits(tolerance=t, faces=10)).mesh for t in (0.02, 0.4))
    assert len(loose.faces) < len(tight.faces) / 4
    middles = np.concatenate([full.mesh.vertices, full.mesh.vertices[full.mesh.faces].mean(axis=1)])
    for mesh, limit in ((tight, 0.02), (loose, 0.4)):
        assert TriangleScene(mesh.vertices, mesh.faces).nearest(middles)[0].max() < limit + 1e-5


def test_the_line_of_what_was_observed_stays_where_it_was():
    full = surface_of(FIELDS["ball"], lambda at: at[:, 2] > -1.7)
    light = simplified(full, SimplifyLimits(tolerance=0.15, faces=800))
    height = light.mesh.vertices[:, 2]
    assert height[light.observed].min() > -2.2 and height[~light.observed].max() < -1.2
    assert light.observed.mean() == pytest.approx(0.5, abs=0.2)


def test_faces_stay_where_colours_change():
    full = surface_of(FIELDS["box"], lambda at: np.ones(len(at), bool))
    at = full.mesh.vertices
    colours = np.where(at[:, :1] > 0.1, np.uint8(200), np.uint8(20)).repeat(3, axis=1)
    painted = FlaggedMesh(mesh=Mesh(vertices=at, faces=full.mesh.faces, colours=colours), observed=full.observed)
    light = simplified(painted, SimplifyLimits(tolerance=0.3, faces=200, colour=0.3 / 50)).mesh
    blurred = simplified(painted, SimplifyLimits(tolerance=0.3, faces=200)).mesh
    assert pure(light) == 1.0 and pure(blurred) < 0.95


def pure(mesh: Mesh) -> float:
    """Share of the vertices off the line between two colours that have one of them."""
    away = np.abs(mesh.vertices[:, 0]) > 1.0
    right = np.where(mesh.vertices[:, 0] > 0, 200, 20)
    return float((mesh.colours[away, 0] == right[away]).mean())


@pytest.mark.parametrize("scale", [0.01, 30.0])
def test_a_scaled_surface_is_simplified_alike(scale):
    full = surface_of(FIELDS["ring"])
    large = FlaggedMesh(mesh=scaled(full.mesh, scale), observed=full.observed)
    here = simplified(full, SimplifyLimits(tolerance=0.2, faces=900)).mesh
    there = simplified(large, SimplifyLimits(tolerance=0.2 * scale, faces=900)).mesh
    assert len(there.faces) == pytest.approx(len(here.faces), rel=0.02)
    assert apart(scaled(here, scale), there) < 0.08 * scale


def test_a_moved_surface_is_as_light_and_as_near():
    full = surface_of(FIELDS["ring"])
    turned = FlaggedMesh(mesh=carried(full.mesh, rigid(3)), observed=full.observed)
    light = simplified(turned, SimplifyLimits(tolerance=0.2, faces=900)).mesh
    assert is_watertight(light) and len(light.faces) <= 900 and apart(light, turned.mesh) < 0.08


@pytest.mark.parametrize("mesh", [cube(), sphere(rings=3)], ids=["cube", "octahedron"])
def test_what_is_small_already_stays_closed(mesh):
    given = FlaggedMesh(mesh=mesh, observed=np.ones(len(mesh.vertices), bool))
    light = simplified(given, SimplifyLimits(tolerance=1e-3, faces=4)).mesh
    assert is_watertight(light) and (light.colours is None) == (mesh.colours is None)
    assert signed_volume(light) == pytest.approx(signed_volume(mesh), rel=1e-2)


def test_a_tolerance_of_nothing_is_refused():
    with pytest.raises(ValueError, match="A tolerance of 0 allows no change"):
        simplified(surface_of(FIELDS["ball"]), SimplifyLimits(tolerance=0.0, faces=10))


def test_faces_that_name_no_vertex_are_refused():
    bad = FlaggedMesh(mesh=Mesh(vertices=cube().vertices, faces=cube().faces + 1), observed=np.ones(8, bool))
    with pytest.raises(ValueError, match="names a vertex that is not there"):
        simplified(bad, SimplifyLimits(tolerance=0.1, faces=10))


def lumpy(shape, amount, seed=0):
    full = surface_of(FIELDS[shape]).mesh
    noise = np.random.default_rng(seed).normal(0, amount, full.vertices.shape).astype(np.float32)
    return Mesh(vertices=full.vertices + noise, faces=full.faces)


def test_relaxing_moves_only_what_is_free():
    mesh = lumpy("ball", 0.3)
    free = mesh.vertices[:, 2] < 0
    places = relaxed_surface(mesh, free, 20)
    np.testing.assert_array_equal(places[~free], mesh.vertices[~free])
    rough, even = (np.abs(np.linalg.norm(at[free], axis=1) - 14.3).std() for at in (mesh.vertices, places))
    assert even < rough / 2
    np.testing.assert_array_equal(relaxed_surface(mesh, np.zeros(len(free), bool), 5), mesh.vertices)


def test_relaxing_flattens_planes_and_keeps_edges():
    mesh = lumpy("box", 0.15)
    places = relaxed_surface(mesh, np.ones(len(mesh.vertices), bool), 20)
    np.testing.assert_allclose(np.abs(places).max(axis=0), [15.2, 9.7, 6.3], atol=0.45)
    inner = (np.abs(mesh.vertices) < [13, 7, 20]).all(axis=1)
    rough, even = (np.abs(np.abs(at[inner, 2]) - 6.3).mean() for at in (mesh.vertices, places))
    assert even < rough / 2


def cuts(mesh: Mesh) -> int:
    return int(TriangleScene(mesh.vertices, mesh.faces).crossings().sum()) // 2


def rough_shell() -> FlaggedMesh:
    """A shell of little more than a voxel that is nowhere smooth: sheets and lumps that are close to each other."""
    noise = np.random.default_rng(5).normal(0, 0.45, (SIDE,) * 3)
    return surface_of(np.abs(np.linalg.norm(AT, axis=-1) - 13.0 + noise) - 0.8)


def test_a_light_surface_does_not_cut_itself():
    full = rough_shell()
    light = simplified(full, SimplifyLimits(tolerance=0.6, faces=2000)).mesh
    assert cuts(full.mesh) == 0 and len(light.faces) < len(full.mesh.faces) / 3
    assert cuts(light) == 0 and is_watertight(light)


def test_places_that_make_a_surface_cut_itself_go_home():
    mesh = rough_shell().mesh
    places = relaxed_surface(mesh, np.ones(len(mesh.vertices), bool), 20)
    places[:9] = places[9]  # faces without an area
    mended = without_cuts(mesh, places)
    moved = Mesh(vertices=mended, faces=mesh.faces)
    assert cuts(Mesh(vertices=places, faces=mesh.faces)) > 100
    assert cuts(moved) == 0 and is_watertight(moved)
    home = (mended == mesh.vertices).all(axis=1)
    assert home[:9].all() and (home | (mended == places).all(axis=1)).all()


def test_places_that_cut_nothing_stay():
    mesh = lumpy("ball", 0.05)
    places = relaxed_surface(mesh, np.ones(len(mesh.vertices), bool), 5)
    np.testing.assert_array_equal(without_cuts(mesh, places), places)


def test_vertices_are_linked_once_each_way():
    links = vertex_links(cube().faces, 8).toarray()
    ends = {tuple(sorted((f[i], f[i - 1]))) for f in cube().faces.tolist() for i in range(3)}
    assert links.sum() == 2 * len(ends) == 36 and all(links[a, b] == links[b, a] == 1 for a, b in ends)


@pytest.mark.parametrize(("tolerance", "wanted"), [(0.3, 12), (0.2, 4)])
def test_the_kernel_collapses_and_flips_the_edges_that_its_twin_does(tolerance, wanted):
    mesh = sphere(rings=3)
    noise = np.random.default_rng(wanted).normal(0, 0.02, mesh.vertices.shape)
    vertices = (mesh.vertices * [1.0, 0.8, 0.6] + noise).astype(np.float32)
    count = len(vertices)
    values, groups = np.zeros((count, 3), np.float32), np.zeros(count, np.uint8)
    found, faces, _, _ = _native.simplify(vertices, mesh.faces, values, groups, tolerance, wanted, 0.0, 0.0)
    twin = Simplification(vertices, mesh.faces, tolerance)
    twin.collapse(wanted)
    for _ in range(6):
        twin.flip()
    assert len(faces) == len(twin.faces) < len(mesh.faces)
    mine = [twin.places, list(twin.faces.values())]
    np.testing.assert_allclose(soup(*mine), soup(found, faces), atol=1e-6)


def soup(places, faces):
    """Faces by the places of their corners, in an order of their own."""
    each = [sorted(tuple(np.round(places[corner], 4) + 0.0) for corner in face) for face in faces]
    return np.array(sorted(each))
