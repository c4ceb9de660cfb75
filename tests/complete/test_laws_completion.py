"""Pieces of completion: the group of poses, farthest points, the evidence hull, Poisson filling, colours."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from goc.complete.colours import inpainted, with_measured_colours
from goc.complete.hull import BAND, evidence_hull, neighbour_mean, relaxed
from goc.complete.poisson import poisson_fill
from goc.complete.sampling import farthest_points
from goc.complete.symmetry import POSES, posed_points, posed_volume
from goc.geometry.surfaces import surface_cloud
from goc.scene import Evidence, EvidenceGrid, FlaggedMesh, Mesh
from laws import SCALES, SOLIDS, only, over
from solids import moved, sphere

ALL_POSES = range(POSES)
CLOUD = torch.randn(50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def matrix_of(pose: int) -> torch.Tensor:
    return posed_points(torch.eye(3, dtype=torch.float64), pose).T


@pytest.mark.parametrize("pose", ALL_POSES)
def test_poses_are_rigid_and_keep_gravity(pose):
    matrix = matrix_of(pose)
    assert torch.equal(matrix @ matrix.T, torch.eye(3, dtype=torch.float64))
    assert torch.linalg.det(matrix).item() == (1.0 if pose < 4 else -1.0)
    assert torch.equal(matrix[2], torch.tensor([0.0, 0, 1], dtype=torch.float64))
    assert torch.equal(posed_points(CLOUD, pose), CLOUD @ matrix.T)


def test_poses_are_a_group_of_eight():
    matrices = [matrix_of(pose) for pose in ALL_POSES]
    assert torch.equal(matrices[0], torch.eye(3, dtype=torch.float64))
    for a, b in itertools.combinations(matrices, 2):
        assert not torch.equal(a, b)
    for a, b in itertools.product(matrices, repeat=2):
        assert sum(torch.equal(a @ b, c) for c in matrices) == 1


@pytest.mark.parametrize("pose", ALL_POSES)
@pytest.mark.parametrize("side", [1, 4, 7])
def test_a_posed_field_has_its_values_where_the_posed_points_are(pose, side):
    axis = (torch.arange(side) + 0.5) / side - 0.5
    points = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)

    def field(at: torch.Tensor) -> torch.Tensor:
        return torch.stack([at[..., 0] + 3 * at[..., 1] - at[..., 2], at[..., 0] * at[..., 1]])

    there = posed_volume(field(points), pose)
    back = points.reshape(-1, 3) @ matrix_of(pose).float()  # transposed: undoes the pose
    torch.testing.assert_close(there, field(back.reshape(side, side, side, 3)), atol=1e-6, rtol=0)


def farthest_by_hand(points: np.ndarray, count: int) -> list[int]:
    taken = [0]
    while len(taken) < count:
        gaps = np.linalg.norm(points[:, None] - points[taken], axis=-1).min(1)
        taken.append(int(np.argmax(gaps)))
    return taken


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [1, 2, 9, 40])
def test_farthest_points_are_those_found_by_hand(seed, count):
    clouds = torch.randn(3, 40, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    found = farthest_points(clouds, count)
    assert found.shape == (3, count)
    for cloud, rows in zip(clouds, found, strict=True):
        assert rows.tolist() == farthest_by_hand(cloud.numpy(), count)


def test_fewer_farthest_points_are_the_first_of_more_and_cover_less():
    clouds = CLOUD[None]
    few, many = farthest_points(clouds, 5)[0], farthest_points(clouds, 20)[0]
    assert torch.equal(few, many[:5]) and len(set(many.tolist())) == 20
    reach = [torch.cdist(CLOUD, CLOUD[rows]).min(1).values.max() for rows in (few, many)]
    assert reach[1] < reach[0]
    # 2-approximation of the k-centre problem: chosen points are no nearer to each other than the cover's radius
    gaps = torch.cdist(CLOUD[many], CLOUD[many]) + torch.eye(20) * 100
    assert gaps.min() >= reach[1]


@over(scale=SCALES)
def test_farthest_points_do_not_depend_on_the_unit(scale):
    shifted = CLOUD[None] * scale + 5 * scale
    assert torch.equal(farthest_points(shifted, 12), farthest_points(CLOUD[None], 12))


def test_more_points_than_there_are_repeat():
    same = torch.ones(1, 3, 3)
    assert farthest_points(same, 5).tolist() == [[0, 0, 0, 0, 0]]


def grid_of(state: np.ndarray, sdf: np.ndarray | None = None, voxel=0.1) -> EvidenceGrid:
    zero = np.zeros(state.shape, np.float32)
    return EvidenceGrid(origin=np.zeros(3), voxel=voxel, state=state.astype(np.uint8), sdf=zero if sdf is None else sdf)


def patches(seed: int) -> EvidenceGrid:
    """Random evidence with patches of each kind."""
    random = np.random.default_rng(seed)
    state = random.integers(0, 3, (5, 4, 6)).repeat(3, 0).repeat(3, 1).repeat(3, 2)
    sdf = random.uniform(-0.25, 0.25, state.shape).astype(np.float32)
    return grid_of(state, np.where(state == Evidence.SURFACE, sdf, 0).astype(np.float32))


@pytest.mark.parametrize("seed", range(5))
def test_the_hull_keeps_what_was_measured_and_stays_out_of_the_empty(seed):
    evidence = patches(seed)
    hull = evidence_hull(evidence)
    seen, empty = evidence.state == Evidence.SURFACE, evidence.state == Evidence.EMPTY
    expected = np.clip(evidence.sdf / np.float32(evidence.voxel), -BAND, BAND)
    np.testing.assert_array_equal(hull[seen], expected[seen])
    assert (hull[empty] > 0).all() and np.abs(hull).max() <= BAND
    assert (hull[~seen & ~empty] < 1).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1, 2)])
def test_the_hull_turns_with_its_evidence(seed, axes):
    evidence = patches(seed)
    flipped = replace(evidence, state=np.flip(evidence.state, axes).copy(), sdf=np.flip(evidence.sdf, axes).copy())
    np.testing.assert_allclose(evidence_hull(flipped), np.flip(evidence_hull(evidence), axes), atol=1e-6)
    turned = replace(
        evidence, state=evidence.state.transpose(2, 0, 1).copy(), sdf=evidence.sdf.transpose(2, 0, 1).copy()
    )
    np.testing.assert_allclose(evidence_hull(turned), evidence_hull(evidence).transpose(2, 0, 1), atol=1e-6)


def test_more_emptiness_is_never_a_larger_solid():
    evidence = patches(7)
    carved = np.where(evidence.state == Evidence.UNKNOWN, Evidence.EMPTY, evidence.state)
    fewer = evidence_hull(replace(evidence, state=carved.astype(np.uint8)))
    assert ((fewer < 0) <= (evidence_hull(evidence) < 0)).all()


@pytest.mark.parametrize("state", [Evidence.UNKNOWN, Evidence.EMPTY])
def test_evidence_of_one_kind_is_all_solid_or_all_air(state):
    hull = evidence_hull(grid_of(np.full((6, 5, 4), state)))
    np.testing.assert_array_equal(hull, BAND if state == Evidence.EMPTY else -BAND)


def test_a_flat_border_lies_between_its_voxels():
    state = np.full((12, 12, 12), Evidence.UNKNOWN)
    state[:, :, 6:] = Evidence.EMPTY
    column = evidence_hull(grid_of(state))[6, 6]
    assert (np.diff(column) >= 0).all() and column[5] < 0 < column[6]
    assert column[0] == -BAND and column[-1] == BAND


def test_means_of_neighbours_keep_constants_and_slopes():
    flat = np.full((4, 5, 6), 2.5, np.float32)
    np.testing.assert_allclose(neighbour_mean(flat), flat)
    x, y, z = (np.arange(n, dtype=np.float32) for n in (7, 6, 5))
    slope = x[:, None, None] - 2 * y[:, None] + 0.5 * z
    inner = (slice(1, -1),) * 3
    np.testing.assert_allclose(neighbour_mean(slope)[inner], slope[inner], atol=1e-5)
    noise = np.random.default_rng(0).normal(size=(6, 6, 6)).astype(np.float32)
    assert neighbour_mean(noise).sum() == pytest.approx(noise.sum(), abs=1e-3)  # the border stands in for itself


@pytest.mark.parametrize("rounds", [0, 1, 6])
def test_relaxing_moves_only_what_is_free(rounds):
    random = np.random.default_rng(1)
    distance = random.uniform(-BAND, BAND, (9, 8, 7)).astype(np.float32)
    held, empty = random.random(distance.shape) < 0.3, random.random(distance.shape) < 0.3
    distance = np.where(empty, np.abs(distance) + 0.1, distance).astype(np.float32)
    found = relaxed(distance, held, empty, rounds)
    fixed = held | (np.abs(distance) >= BAND - 0.5)
    np.testing.assert_array_equal(found[fixed], distance[fixed])
    assert (found[empty & ~fixed] > 0).all()
    assert rounds > 0 or np.array_equal(found, distance)
    everything = np.ones_like(held)
    np.testing.assert_array_equal(relaxed(distance, everything, empty, rounds), distance)


def poisson_of(mesh: Mesh, side=32, margin=0.35) -> tuple[np.ndarray, EvidenceGrid]:
    cloud = surface_cloud(mesh, 4000)
    low, high = mesh.vertices.min(0).astype(float), mesh.vertices.max(0).astype(float)
    reach = (high - low).max() * (1 + margin)
    voxel = float(reach / side)
    grid = EvidenceGrid(
        origin=(low + high) / 2 - voxel * (side - 1) / 2,
        voxel=voxel,
        state=np.zeros((side,) * 3, np.uint8),
        sdf=np.zeros((side,) * 3, np.float32),
    )
    return poisson_fill(cloud.positions, cloud.normals, grid), grid


def centres(grid: EvidenceGrid) -> np.ndarray:
    axes = [np.arange(n) for n in grid.state.shape]
    return grid.origin + grid.voxel * np.stack(np.meshgrid(*axes, indexing="ij"), -1)


@pytest.mark.parametrize("radius", [0.05, 1.0, 20.0])
def test_poisson_fills_a_ball_whatever_its_unit(radius):
    field, grid = poisson_of(sphere(radius, rings=40))
    truth = (np.linalg.norm(centres(grid), axis=-1) - radius) / grid.voxel
    near = np.abs(truth) < 1.5
    assert np.abs(field - truth)[near].max() < 0.6
    assert ((field < 0) == (truth < 0))[np.abs(truth) > 1].all()


def test_poisson_moves_with_its_points():
    here, grid = poisson_of(sphere(0.5, rings=30))
    there, shifted = poisson_of(moved(sphere(0.5, rings=30), (2.0, -1.0, 4.0)))
    assert shifted.voxel == pytest.approx(grid.voxel, rel=1e-5)
    assert np.abs(here - there).max() < 0.05


def spread_colours(mesh, observed, measured):
    return inpainted(with_measured_colours(FlaggedMesh(mesh=mesh, observed=observed), measured)).mesh.colours


@over(mesh=only(SOLIDS, "ball", "cube", "ring"))
def test_one_measured_colour_colours_everything(mesh):
    measured = Mesh(vertices=mesh.vertices[:8], faces=mesh.faces[:1], colours=np.full((8, 3), (200, 30, 90), np.uint8))
    observed = np.zeros(len(mesh.vertices), bool)
    observed[:8] = True
    found = spread_colours(mesh, observed, measured)
    assert np.abs(found.astype(int) - [200, 30, 90]).max() <= 1


@over(scale=SCALES)
def test_colours_stay_where_they_were_measured_and_within_their_range(scale):
    ball = sphere(rings=16)
    random = np.random.default_rng(2)
    colours = random.integers(40, 200, (len(ball.vertices), 3), dtype=np.uint8)
    vertices = (scale * ball.vertices).astype(np.float32)
    observed = ball.vertices[:, 2] > 0
    here = Mesh(vertices=vertices, faces=ball.faces, colours=colours)
    found = spread_colours(here, observed, here)
    assert np.abs(found[observed].astype(int) - colours[observed]).max() <= 2  # the nearest outweighs three others
    assert found.min() >= 39 and found.max() <= 200


def test_without_colours_or_vertices_there_is_nothing_to_spread():
    ball, none = sphere(rings=6), np.zeros((0, 3))
    seen = np.ones(len(ball.vertices), bool)
    assert spread_colours(ball, seen, ball) is None
    empty = Mesh(vertices=none.astype(np.float32), faces=none.astype(np.int32), colours=none.astype(np.uint8))
    assert not spread_colours(ball, seen, empty).any()
    assert spread_colours(empty, np.zeros(0, bool), empty).shape == (0, 3)
