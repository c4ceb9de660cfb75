import numpy as np
import pytest
import torch

from goc.complete import CHANNELS, batch_of, bounding_cube, cell_centres, evidence_channels, partial_object
from goc.scene import Evidence, EvidenceGrid


def grid(state, origin=(-1.0, -1.0, -1.0), voxel=0.1, sdf=None):
    state = np.asarray(state, np.uint8)
    sdf = np.zeros(state.shape, np.float32) if sdf is None else sdf.astype(np.float32)
    return EvidenceGrid(origin=np.array(origin, np.float64), voxel=voxel, state=state, sdf=sdf)


def test_the_cube_goes_round_the_seen_box_with_a_quarter_to_spare():
    cube = bounding_cube(np.array([[0.0, 0, 0], [2.0, 1.0, 0.5]]))
    assert cube.side == pytest.approx(2.5)
    assert cube.centre.tolist() == [1.0, 0.5, 0.25]


def test_model_and_world_frames_are_inverse():
    points = np.random.default_rng(0).normal(size=(20, 3))
    cube = bounding_cube(points)
    there = cube.model_from_world(points)
    assert np.abs(there).max() == pytest.approx(0.8, abs=1e-6)
    np.testing.assert_allclose(cube.world_from_model(there), points, atol=1e-6)


@pytest.mark.parametrize(
    ("points", "match"),
    [(np.zeros((0, 3)), "0 points"), (np.ones((4, 3)), "needs some size"), (np.full((2, 3), np.nan), "finite")],
)
def test_no_cube_goes_round_nothing(points, match):
    with pytest.raises(ValueError, match=match):
        bounding_cube(points)


def test_channels_match_a_slow_look_at_every_cell():
    random = np.random.default_rng(1)
    evidence = grid(random.integers(0, 3, (9, 11, 7)), (-0.7, -0.9, -0.4), 0.17, random.normal(0, 0.2, (9, 11, 7)))
    cells = 6
    found = evidence_channels(evidence, cells)
    for i, j, k in np.ndindex(cells, cells, cells):
        states, distances = [], []
        for step in np.ndindex(2, 2, 2):
            at = ((np.array([i, j, k]) * 2 + step + 0.5) / cells) - 1
            voxel = np.floor((at - evidence.origin) / evidence.voxel + 0.5).astype(int)
            if ((voxel < 0) | (voxel >= evidence.state.shape)).any():
                states.append(-1)
                continue
            states.append(int(evidence.state[tuple(voxel)]))
            if states[-1] == Evidence.SURFACE:
                distances.append(float(np.clip(evidence.sdf[tuple(voxel)] / (1.5 * 2 / cells), -1, 1)))
        expected = [
            np.mean(distances) if distances else 0.0,
            states.count(Evidence.SURFACE) / 8,
            states.count(Evidence.EMPTY) / 8,
            states.count(-1) / 8,
        ]
        assert found[:, i, j, k] == pytest.approx(expected, abs=1e-3)


def test_a_plane_keeps_its_distance_at_any_resolution():
    z = -1.0 + 0.02 * np.arange(100)
    state = np.where(np.abs(z) < 0.1, Evidence.SURFACE, np.where(z > 0, Evidence.EMPTY, Evidence.UNKNOWN))
    evidence = grid(
        np.broadcast_to(state, (100, 100, 100)).copy(), voxel=0.02, sdf=np.broadcast_to(z, (100, 100, 100)).copy()
    )
    for cells in (16, 32, 64):
        channels = evidence_channels(evidence, cells)
        height = cell_centres(cells)[..., 2]
        near = channels[1] == 1
        expected = np.clip(height / (1.5 * 2 / cells), -1, 1)
        np.testing.assert_allclose(channels[0][near], expected[near], atol=0.02 / (3 / cells))


def test_a_partial_moves_evidence_with_its_points():
    points = np.array([[1.0, 2, 3], [3.0, 2, 3]])
    cube = bounding_cube(points)
    evidence = grid(np.full((4, 4, 4), Evidence.SURFACE), (1.0, 2.0, 3.0), 0.5, np.full((4, 4, 4), 0.25))
    partial = partial_object(points, None, evidence, cube)
    assert partial.evidence.origin.tolist() == pytest.approx([-0.8, 0.0, 0.0])
    assert partial.evidence.voxel == pytest.approx(0.4)
    assert partial.evidence.sdf.max() == pytest.approx(0.2)
    assert partial.points[0].tolist() == pytest.approx([-0.8, 0.0, 0.0])


def test_a_batch_repeats_points_where_they_are_few_and_refuses_none():
    evidence = grid(np.zeros((2, 2, 2)))
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    batch = batch_of(partial_object(points, None, evidence, bounding_cube(points)), points=7, cells=4)
    assert batch.points.shape == (1, 7, 3)
    assert batch.evidence.shape == (1, len(CHANNELS), 4, 4, 4)
    assert len(torch.unique(batch.points[0], dim=0)) == 3
    nothing = partial_object(np.zeros((0, 3)), None, evidence, bounding_cube(points))
    assert batch_of(nothing, points=0, cells=4).points.shape == (1, 0, 3)
    with pytest.raises(ValueError, match="No points were seen"):
        batch_of(nothing, points=5, cells=4)
