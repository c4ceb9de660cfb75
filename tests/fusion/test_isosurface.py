"""Marching cubes over sparse blocks: closed where it should be, open where it should be, no seams."""

import numpy as np
import pytest

from goc import _native
from goc.fusion.volume import BlockGrid, Volume, fused_surface
from oracles.watertight import has_border, signed_volume, trouble


def grid(cells):
    """Volume of cells³ blocks with its voxel positions."""
    blocks = np.array(list(np.ndindex(cells, cells, cells)), np.int32)
    volume = Volume(BlockGrid(origin=np.zeros(3), voxel=1.0, truncation=3.0, blocks=blocks))
    voxels = np.stack(np.meshgrid(*(np.arange(8),) * 3, indexing="ij"), -1)
    return volume, blocks[:, None, None, None] * 8 + voxels


@pytest.mark.parametrize("centre", [(11.5, 11.5, 11.5), (12.0, 11.0, 12.0), (10.3, 12.9, 11.1)])
def test_a_sphere_across_blocks_is_closed_and_round(centre):
    volume, at = grid(3)
    distance = np.linalg.norm(at - np.array(centre), axis=-1) - 8.0
    mesh = fused_surface(volume, distance.astype(np.float32)).mesh
    assert trouble(mesh.vertices, mesh.faces) == ""
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - np.array(centre), axis=1), 8.0, atol=0.05)
    assert signed_volume(mesh.vertices, mesh.faces) == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_every_sign_pattern_closes(seed):
    """Noise has all 256 patterns; with positive values all round, the surface has no rim: each edge has its partner."""
    volume, at = grid(2)
    values = np.random.default_rng(seed).normal(size=at.shape[:-1])
    values[((at == 0) | (at == 15)).any(axis=-1)] = 1.0
    mesh = fused_surface(volume, values.astype(np.float32)).mesh
    assert not has_border(mesh.faces)
    inside = (values < 0).sum()
    assert 0 < signed_volume(mesh.vertices, mesh.faces) < 2 * inside


def test_unknown_voxels_and_missing_blocks_leave_the_surface_open():
    volume, at = grid(2)
    values = (at[..., 2] - 7.3).astype(np.float32)
    whole = fused_surface(volume, values).mesh
    assert np.ptp(whole.vertices, axis=0)[:2].tolist() == [15.0, 15.0]
    assert np.allclose(whole.vertices[:, 2], 7.3)
    cut = values.copy()
    cut[at[..., 0] > 9] = np.nan
    assert fused_surface(volume, cut).mesh.vertices[:, 0].max() == 9.0
    fewer = Volume(
        BlockGrid(origin=np.zeros(3), voxel=1.0, truncation=3.0, blocks=volume.grid.blocks[:4])
    )  # lower half in x
    assert fused_surface(fewer, values[:4]).mesh.vertices[:, 0].max() == 7.0


def test_faces_look_towards_the_positive_side():
    volume, at = grid(1)
    mesh = fused_surface(volume, (at[..., 2] - 3.5).astype(np.float32)).mesh
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_no_values_no_surface_and_wrong_counts_are_refused():
    blocks = np.zeros((1, 3), np.int32)
    edges, faces = _native.isosurface(blocks, np.full((1, 8, 8, 8), np.nan, np.float32))
    assert edges.shape == (0, 2) and faces.shape == (0, 3)
    with pytest.raises(ValueError, match="one set of values a block"):
        _native.isosurface(blocks, np.zeros((2, 8, 8, 8), np.float32))
