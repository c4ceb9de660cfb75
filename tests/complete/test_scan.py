"""Scans without cameras: spheres with holes, and what is refused."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from goc.cli import main
from goc.complete import ScanConfig, complete_scan, with_margin
from goc.complete.poisson import poisson_fill
from goc.complete.scan_evidence import measured_scan, scan_grid
from goc.errors import CompleteError, ConfigError
from goc.events import Warned
from goc.files import read_observed_mesh, read_ply, write_mesh, write_ply, write_points
from goc.geometry.isosurface import grid_surface
from goc.geometry.orientation import point_normals
from goc.geometry.surfaces import face_areas, surface_cloud, vertex_normals
from goc.scene import Mesh, PointCloud
from oracles.watertight import signed_volume, trouble

CENTRE, RADIUS = np.array([4.0, -2.0, 1.0]), 0.5


def ball(count=6000, seed=0):
    """Points of a ball, without the part below 0.6 radii under its centre."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[directions[:, 2] > -0.6].astype(np.float32)
    colours = np.where(directions[:, :1] > 0, [[250, 0, 0]], [[0, 0, 250]]).astype(np.uint8)
    return PointCloud(positions=(CENTRE + RADIUS * directions).astype(np.float32), colours=colours, normals=directions)


def open_ball():
    """The same as a mesh."""
    axes = np.meshgrid(*(np.linspace(-1, 1, 25),) * 3, indexing="ij")
    field = np.linalg.norm(np.stack(axes, -1), axis=-1) - 0.9
    vertices, faces = grid_surface(field.astype(np.float32), np.full(3, -1.0), 1 / 12)
    return Mesh(vertices=vertices, faces=faces[(vertices[faces][:, :, 2] > -0.5).all(axis=1)])


@pytest.mark.parametrize("with_normals", [True, False])
def test_a_ball_with_a_hole_is_closed_and_keeps_its_points(with_normals):
    cloud = ball()
    if not with_normals:
        cloud = PointCloud(positions=cloud.positions, colours=cloud.colours)
    done = complete_scan(cloud, ScanConfig(method="smooth", cells=48))
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    off = np.linalg.norm(done.mesh.vertices - CENTRE, axis=1) - RADIUS
    assert np.abs(off[done.observed]).max() < 0.01 * RADIUS
    assert off.max() < 0.02 * RADIUS and off.min() > -0.45 * RADIUS  # a flat lid would lie 0.4 radii in
    whole = 4 / 3 * np.pi * RADIUS**3
    assert 0.85 * whole < signed_volume(done.mesh.vertices, done.mesh.faces) < 1.01 * whole
    assert 0.6 < done.observed.mean() < 0.95
    assert done.mesh.colours is not None
    right = done.observed & (done.mesh.vertices[:, 0] > CENTRE[0] + 0.1)
    assert (done.mesh.colours[right, 0] > 240).all()


def test_the_screened_surface_passes_through_its_points():
    """Smearing rounds a box by more than a third of a voxel; screening pulls it back to what was measured."""
    random = np.random.default_rng(0)
    faces = random.integers(0, 5, 12_000)  # the lower side is missing
    points = random.uniform(-0.5, 0.5, (len(faces), 3))
    normals = np.zeros((len(faces), 3), np.float32)
    for face, (axis, side) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1), (2, 1)]):
        points[faces == face, axis] = 0.5 * side
        normals[faces == face, axis] = side
    cloud = PointCloud(
        positions=points.astype(np.float32), colours=np.zeros((len(points), 3), np.uint8), normals=normals
    )
    grid = with_margin(measured_scan(cloud, scan_grid(cloud.positions, 48)).evidence)
    fill = poisson_fill(cloud.positions, normals, grid)
    assert fill.shape == grid.state.shape
    off = map_coordinates(fill, ((points - grid.origin) / grid.voxel).T, order=1)
    assert abs(off.mean()) < 0.03 and off.std() < 0.15
    middle = tuple(int(n) // 2 for n in grid.state.shape)
    assert fill[middle] < 0 and fill[0, 0, 0] > 0


def test_normals_of_bare_points_look_outwards():
    cloud = ball(3000)
    found = point_normals(cloud.positions)
    assert ((found * cloud.normals).sum(axis=1) > 0.98).all()
    with pytest.raises(ValueError, match="3 points say nothing of a surface"):
        point_normals(cloud.positions[:3])


def test_strays_are_left_out_and_said():
    cloud = ball()
    outliers = CENTRE + np.array([[3.0, 0, 0], [0, 4.0, 0]])
    spoiled = PointCloud(
        positions=np.concatenate([cloud.positions, outliers]).astype(np.float32),
        colours=np.concatenate([cloud.colours, cloud.colours[:2]]),
    )
    heard = []
    done = complete_scan(spoiled, ScanConfig(method="smooth", cells=32), heard.append)
    assert np.ptp(done.mesh.vertices, axis=0).max() < 2.2 * RADIUS
    assert heard == [
        Warned(stage="complete", message=f"2 of {len(spoiled.positions)} points lie far from all others: left out.")
    ]


def test_parts_that_did_not_make_it_are_told():
    """Twelve little balls round a large one, each less of the scan than a part must be."""
    thing = ball(8000)
    around = 2 * np.pi * np.arange(12) / 12
    places = CENTRE + 2 * RADIUS * np.stack([np.cos(around), np.sin(around), np.zeros(12)], -1)
    directions = np.random.default_rng(0).normal(size=(12, 60, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    little = (places[:, None] + 0.1 * directions).reshape(-1, 3)
    cloud = PointCloud(
        positions=np.concatenate([thing.positions, little]).astype(np.float32),
        colours=np.zeros((len(thing.positions) + len(little), 3), np.uint8),
        normals=np.concatenate([thing.normals, directions.reshape(-1, 3)]).astype(np.float32),
    )
    heard = []
    complete_scan(cloud, ScanConfig(method="smooth", cells=32), heard.append)
    assert any("walls thinner than a voxel" in event.message and "Raise --cells" in event.message for event in heard)
    heard.clear()
    complete_scan(thing, ScanConfig(method="smooth", cells=32), heard.append)
    assert heard == []


def test_too_few_points_and_settings_without_meaning_are_refused():
    few = PointCloud(positions=np.zeros((60, 3), np.float32), colours=np.zeros((60, 3), np.uint8))
    with pytest.raises(CompleteError, match="60 points tell no surface: 50 are needed, in more than one place"):
        complete_scan(few, ScanConfig())
    for settings, text in (
        ({"cells": 4}, "ScanConfig.cells is 4: needs 16 to 400"),
        ({"threshold": 0.0}, "ScanConfig.threshold is 0: needs more than 0, below 1"),
        ({"method": "osc"}, "ScanConfig.method osc needs ScanConfig.weights"),
    ):
        with pytest.raises(ConfigError, match=text):
            ScanConfig(**settings)


def test_points_on_a_mesh_are_uniform_and_know_their_normals():
    mesh = open_ball()
    cloud = surface_cloud(mesh, 4000)
    np.testing.assert_allclose(np.linalg.norm(cloud.positions, axis=1), 0.9, atol=0.01)
    assert ((cloud.normals * cloud.positions).sum(axis=1) > 0.87).all()
    above = (cloud.positions[:, 2] > 0.4).mean()
    assert above == pytest.approx(0.5 / 1.4, abs=0.02)  # Archimedes: zones of a sphere
    assert face_areas(mesh).sum() == pytest.approx(2 * np.pi * 0.9 * 1.4, rel=0.05)
    used = np.unique(mesh.faces)
    assert ((vertex_normals(mesh) * mesh.vertices / 0.9).sum(axis=1)[used] > 0.9).all()
    with pytest.raises(ValueError, match="A mesh of 0 faces has no area"):
        surface_cloud(Mesh(vertices=mesh.vertices, faces=mesh.faces[:0]), 10)


@pytest.fixture
def few_samples(monkeypatch):
    monkeypatch.setattr("goc.cli.complete._SAMPLES", 6000)


def test_the_command_closes_files_of_every_kind(tmp_path, capsys, few_samples):
    cloud = ball(3000)
    write_points(tmp_path / "points.ply", cloud)
    write_mesh(tmp_path / "mesh.ply", open_ball())
    np.savetxt(tmp_path / "points.xyz", np.concatenate([cloud.positions, cloud.normals], axis=1))
    obj = [
        *(f"v {x} {y} {z}" for x, y, z in open_ball().vertices),
        *(f"f {a} {b} {c}" for a, b, c in open_ball().faces + 1),
    ]
    (tmp_path / "mesh.obj").write_text("\n".join(obj))
    smooth = ("--method", "smooth")
    for name in ("points.ply", "mesh.ply", "points.xyz", "mesh.obj"):
        out = tmp_path / f"{name}.closed.ply"
        assert main(["complete", str(tmp_path / name), "--out", str(out), "--cells", "32", *smooth]) == 0
        mesh, observed = read_observed_mesh(out)
        assert trouble(mesh.vertices, mesh.faces) == ""
        assert 0.5 < observed.mean() < 1
    assert (
        main(["complete", str(tmp_path / "mesh.ply"), "--out", str(tmp_path / "a.glb"), "--cells", "24", *smooth]) == 0
    )
    assert (tmp_path / "a.glb").read_bytes()[:4] == b"glTF"
    assert "of the surface imagined" in capsys.readouterr().out


def test_a_scan_on_a_national_grid_is_closed_where_it_is(tmp_path, capsys):
    place = np.array([483_250.0, 4_605_120.0, 812.0])
    vertex = {name: ball().positions[:, axis] + place[axis] for axis, name in enumerate("xyz")}
    write_ply(tmp_path / "far.ply", {"vertex": vertex})
    eye = [str(value) for value in place + CENTRE + [0, 0, 5.0]]
    words = ["--cells", "24", "--method", "convex", "--viewpoint", *eye, "--support-plane", "0", "0", "1", "-812.6"]
    assert main(["complete", str(tmp_path / "far.ply"), "--out", str(tmp_path / "closed.ply"), *words]) == 0
    closed = read_ply(tmp_path / "closed.ply")["vertex"]
    found = np.stack([closed[axis] for axis in "xyz"], axis=-1)
    assert found.dtype == np.float64
    np.testing.assert_allclose((found.max(axis=0) + found.min(axis=0))[:2] / 2, (place + CENTRE)[:2], atol=0.03)
    assert found[:, 2].min() == pytest.approx(812.6, abs=0.1)  # down to where it stands
    assert "computed about 483250 4605120 810" in capsys.readouterr().out


def test_faces_wound_at_random_are_turned_and_told(tmp_path, capsys, few_samples):
    mesh = open_ball()
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    write_mesh(tmp_path / "mixed.ply", Mesh(vertices=mesh.vertices, faces=faces))
    words = ["--cells", "24", "--method", "smooth"]
    assert main(["complete", str(tmp_path / "mixed.ply"), "--out", str(tmp_path / "closed.ply"), *words]) == 0
    closed, _ = read_observed_mesh(tmp_path / "closed.ply")
    assert signed_volume(closed.vertices, closed.faces) == pytest.approx(4 / 3 * np.pi * 0.9**3, rel=0.15)
    assert f"{len(faces[::3]):,} of its {len(faces):,} faces were wound against" in capsys.readouterr().out


def test_the_command_refuses_what_it_cannot_do(tmp_path, capsys):
    scan, closed = tmp_path / "points.ply", tmp_path / "closed.ply"
    write_points(scan, ball(3000))
    assert main(["complete", str(scan), "--out", str(closed), "--cells", "24", "--method", "smooth"]) == 0
    for source, out, text in (
        (scan, tmp_path / "a.stl", "goc writes .ply and .glb"),
        (scan, closed, "is there already. Pass --overwrite"),
        (closed, tmp_path / "b.ply", "is watertight already. There is nothing to complete"),
    ):
        assert main(["complete", str(source), "--out", str(out)]) == 2
        assert text in capsys.readouterr().err
    assert main(["complete", str(tmp_path / "none.xyz"), "--out", str(tmp_path / "c.ply")]) == 3
