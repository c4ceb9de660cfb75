"""Scans without cameras: spheres with holes, and what is refused."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from goc.cli import main
from goc.complete import ScanConfig, complete_scan, with_margin
from goc.complete.poisson import poisson_fill
from goc.complete.scan_evidence import measured_scan, scan_grid
from goc.errors import CompleteError, ConfigError, FileError
from goc.events import Warned
from goc.files import read_observed_mesh, read_scan, write_mesh, write_points
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


def test_the_command_closes_files_of_every_kind(tmp_path, capsys):
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


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "holds no points"),
        ("1 2\n3 4\n", "2 numbers a line; 3, 6 or 9 are expected"),
        ("1 2 3\n1 2\n", "not numbers in equal rows"),
        ("1 2 x\n", "not numbers in equal rows"),
        ("1 2 3\n1 2 nan\n", r"1 of 2 points are not finite \(first: 1\)"),
    ],
)
def test_damaged_text_is_refused(tmp_path, text, problem):
    path = tmp_path / "points.xyz"
    path.write_text(text)
    with pytest.raises(FileError, match=problem):
        read_scan(path)


def test_text_may_hold_colours_or_normals(tmp_path):
    path = tmp_path / "points.xyz"
    path.write_text("# a scan\n0 0 0 255 0 10\n1 0 0 0 20 255\n")
    scan = read_scan(path)
    assert isinstance(scan, PointCloud) and scan.normals is None and scan.colours[1].tolist() == [0, 20, 255]
    path.write_text("0 0 0 0 0 1\n1 0 0 0 -1 0\n")
    scan = read_scan(path)
    assert isinstance(scan, PointCloud) and scan.normals is not None and scan.normals[1].tolist() == [0, -1, 0]
    path.write_text("0 0 0 9 8 7 0 0 1\n")
    scan = read_scan(path)
    assert isinstance(scan, PointCloud) and scan.normals is not None and scan.colours[0].tolist() == [9, 8, 7]
    with pytest.raises(FileError, match=r"a\.stl: not a scan that goc reads"):
        read_scan(tmp_path / "a.stl")
