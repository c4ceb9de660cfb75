"""One sensor's place: what its rays passed is empty, what lies behind what it saw stays unknown."""

import numpy as np
import pytest

from goc.cli import main
from goc.complete import ScanConfig, complete_scan
from goc.complete.scan_evidence import measured_scan, scan_grid
from goc.complete.viewpoint import carve_free_space
from goc.errors import CompleteError, ConfigError
from goc.files import write_points
from goc.geometry.orientation import point_normals
from goc.scene import Evidence, PointCloud
from oracles.watertight import signed_volume, trouble

RADIUS, EYE = 0.4, np.array([1.0, -4.0, 0.5])
CENTRE = np.array([1.0, 0.0, 0.5])


def front(inner=0.0, side=90):
    """What a sensor at EYE sees of a ball, by its depth image; of a ring if there is an inner radius."""
    steps = np.linspace(-0.11, 0.11, side)
    x, z = (axis.ravel() for axis in np.meshgrid(steps, steps))
    rays = np.stack([x, np.ones_like(x), z], -1)
    offset = EYE - CENTRE
    a, b, c = (rays**2).sum(-1), (rays * offset).sum(-1), offset @ offset - RADIUS**2
    root = b**2 - a * c
    hit = root > 0
    points = EYE + rays[hit] * ((-b[hit] - np.sqrt(root[hit])) / a[hit])[:, None]
    points = points[np.linalg.norm((points - CENTRE)[:, [0, 2]], axis=1) >= inner]
    normals = (points - CENTRE) / RADIUS
    return PointCloud(
        positions=points.astype(np.float32),
        colours=np.full((len(points), 3), 99, np.uint8),
        normals=normals.astype(np.float32),
    )


def places(grid):
    return grid.origin + grid.voxel * np.stack(
        np.meshgrid(*(np.arange(n) for n in grid.state.shape), indexing="ij"), -1
    )


def slow_passed(grid, cloud, margin):
    """Voxels that some ray from EYE to a point passed, walked step by step: what must be empty."""
    passed = np.zeros(grid.state.shape, bool)
    for point in cloud.positions:
        way = point - EYE
        length = np.linalg.norm(way)
        steps = np.arange(length - 1.5, length - margin, 0.5 * grid.voxel)
        at = np.rint((EYE + way / length * steps[:, None] - grid.origin) / grid.voxel).astype(int)
        at = at[((at >= 0) & (at < grid.state.shape)).all(axis=1)]
        passed[tuple(at.T)] = True
    return passed


def test_space_in_front_and_beside_is_empty_and_behind_unknown():
    cloud = front()
    grid = measured_scan(cloud, scan_grid(cloud.positions, 32)).evidence
    seen = carve_free_space(grid, cloud.positions, EYE)
    assert np.array_equal(seen.state == Evidence.SURFACE, grid.state == Evidence.SURFACE)
    assert np.array_equal(seen.sdf, grid.sdf)
    walked = slow_passed(grid, cloud, 5 * grid.voxel) & (grid.state == Evidence.UNKNOWN)
    assert walked.any()
    assert (seen.state[walked] == Evidence.EMPTY).mean() > 0.99
    inside = np.linalg.norm(places(grid) - CENTRE, axis=-1) < RADIUS - grid.voxel
    assert (seen.state[inside] != Evidence.EMPTY).all()
    local = (places(grid) - EYE) / (places(grid) - EYE)[..., 1:2]
    beside = np.linalg.norm(local[..., [0, 2]], axis=-1) > 0.101 + 5 * grid.voxel / 4.0
    assert (seen.state[beside] == Evidence.EMPTY).all()


@pytest.mark.parametrize(("inner", "through"), [(0.05, False), (0.2, True)])
def test_a_hole_is_seen_through_where_it_is_large_and_the_sensor_s_where_it_is_small(inner, through):
    cloud = front(inner)
    grid = measured_scan(cloud, scan_grid(cloud.positions, 32)).evidence
    seen = carve_free_space(grid, cloud.positions, EYE)
    off = places(grid) - CENTRE
    axis = (np.linalg.norm(off[..., [0, 2]], axis=-1) < grid.voxel) & (off[..., 1] > 0)
    assert axis.any()
    assert (seen.state[axis] == Evidence.EMPTY).any() == through


def test_the_hull_of_one_view_is_the_shadow_of_what_was_seen():
    """From far away: the ball's front on a cylinder that ends at the box."""
    cloud = front()
    done = complete_scan(cloud, ScanConfig(method="hull", cells=40, viewpoint=(tuple(EYE.tolist()),)))
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    off = np.linalg.norm(done.mesh.vertices - CENTRE, axis=1) - RADIUS
    assert np.abs(off[done.observed]).max() < 0.02 * RADIUS
    # A hemisphere, and a cylinder of the room that is left behind it.
    deep = 0.125 * 2 * RADIUS
    whole = 2 / 3 * np.pi * RADIUS**3 + deep * np.pi * RADIUS**2
    assert signed_volume(done.mesh.vertices, done.mesh.faces) == pytest.approx(whole, rel=0.2)


def test_estimated_normals_look_towards_the_sensor():
    bare = front()
    bare = PointCloud(positions=bare.positions, colours=bare.colours)
    done = complete_scan(bare, ScanConfig(method="smooth", cells=32, viewpoint=(tuple(EYE.tolist()),)))
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    assert done.mesh.vertices[:, 1].min() == pytest.approx(CENTRE[1] - RADIUS, abs=0.02)
    assert done.mesh.vertices[:, 1].max() > CENTRE[1] - 0.2 * RADIUS


def test_viewpoints_that_cannot_be_are_refused(tmp_path, capsys):
    cloud = front()
    with pytest.raises(CompleteError, match=r"--viewpoint 1 -0\.3 0\.5: lies among the points"):
        bare = PointCloud(positions=cloud.positions, colours=cloud.colours)
        complete_scan(bare, ScanConfig(method="smooth", cells=32, viewpoint=((1.0, -0.3, 0.5),)))
    with pytest.raises(CompleteError, match=r"100% of the scan's normals look away"):
        complete_scan(cloud, ScanConfig(method="smooth", cells=32, viewpoint=((1.0, 40.0, 0.5),)))
    with pytest.raises(ConfigError, match="ScanConfig.method hull needs ScanConfig.viewpoint"):
        ScanConfig(method="hull", find_viewpoint=False)
    with pytest.raises(ConfigError, match="needs a finite number"):
        ScanConfig(viewpoint=((0.0, float("nan"), 1.0),))
    write_points(tmp_path / "scan.ply", cloud)
    words = ["complete", str(tmp_path / "scan.ply"), "--out", str(tmp_path / "closed.ply"), "--cells", "24"]
    assert main([*words, "--method", "hull", "--viewpoint", "1", "-4", "0.5"]) == 0
    assert "closed in" in capsys.readouterr().out


def test_one_side_of_a_ball_looks_outwards_without_a_viewpoint():
    cap = front(inner=0.0, side=60)
    tilted = cap.positions @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0].T
    turned = cap.normals @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0].T
    assert ((point_normals(tilted) * turned).sum(axis=1) > 0.9).mean() > 0.97


def test_a_scan_turned_inside_out_is_refused():
    cloud = front()
    inwards = PointCloud(positions=cloud.positions, colours=cloud.colours, normals=-cloud.normals)
    with pytest.raises(CompleteError, match="its normals look inwards. Turn them round, or pass --viewpoint"):
        complete_scan(inwards, ScanConfig(method="smooth", cells=32))
