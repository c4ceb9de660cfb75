import numpy as np
import pytest
import torch

from goc.complete import HINTS, LiteConfig, PartialObject, batch_of, begin_from, build, evidence_channels, save_network
from goc.complete.hints import _below_hull, _mirrored, hint_channels
from goc.complete.mirrors import MirrorPlane
from goc.errors import CompleteError
from goc.scene import Evidence, EvidenceGrid

SMALL = {"cells": 16, "fine": 8, "middle": 16, "width": 24, "blocks": 1, "heads": 2, "hidden": 16}


def half_ball(cells: int = 48) -> EvidenceGrid:
    """A ball of radius 0.6 about the origin, all but x > 0.2 of it seen."""
    axis = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    where = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    distance = np.linalg.norm(where, axis=-1) - 0.6
    state = np.where(np.abs(distance) < 0.08, Evidence.SURFACE, Evidence.UNKNOWN)
    state = np.where(distance >= 0.08, Evidence.EMPTY, state)
    state = np.where(where[..., 0] > 0.2, Evidence.UNKNOWN, state).astype(np.uint8)
    sdf = np.where(state == Evidence.SURFACE, distance, 0).astype(np.float32)
    return EvidenceGrid(origin=np.full(3, 1.0 / cells - 1.0), voxel=2.0 / cells, state=state, sdf=sdf)


def test_a_plane_shows_what_its_other_side_shows_times_its_score() -> None:
    seen = np.random.default_rng(0).random((3, 8, 8, 8)).astype(np.float32) * 0.4
    plane = MirrorPlane(normal=np.array([1.0, 0, 0]), offset=0.0, support=0.6, contradiction=0.02)
    np.testing.assert_allclose(_mirrored(seen, [plane]), plane.score * seen[:, ::-1], atol=1e-5)
    assert (_mirrored(seen, []) == 0).all()


def test_the_second_plane_tells_what_the_first_leaves_open() -> None:
    seen = np.zeros((3, 8, 8, 8), np.float32)
    seen[2, :4] = 1.0  # empty on one side in x
    across, along = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    planes = [MirrorPlane(normal=n, offset=0.0, support=1.0, contradiction=0.0) for n in (across, along)]
    np.testing.assert_allclose(_mirrored(seen, planes)[2], 1.0, atol=1e-5)


def test_depth_below_the_hull_of_a_cube_is_the_distance_to_its_nearest_face() -> None:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    found = _below_hull(corners, 32)
    axis = (np.arange(32) + 0.5) / 16 - 1
    nearest = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    depth = np.clip((0.5 - np.abs(nearest).max(-1)) / 0.25, -1, 1)
    assert np.abs(found - depth).max() < 0.3
    assert (np.sign(found) == np.sign(depth))[np.abs(depth) > 0.3].all()


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.random.default_rng(0).random((9, 3)) * [1, 1, 0]])
def test_points_without_volume_have_no_hull(points: np.ndarray) -> None:
    assert (_below_hull(points, 8) == 0).all()


def test_the_unseen_side_of_a_ball_is_hinted_at() -> None:
    evidence = half_ball()
    seen = evidence_channels(evidence, 24)
    hints = hint_channels(evidence, seen)
    assert hints.shape == (len(HINTS), 24, 24, 24) and np.abs(hints).max() < 1.0001
    assert seen[1, 18:20, 12, 12].max() == 0 and hints[1, 18:20, 12, 12].max() > 0.3  # at x = 0.6
    assert hints[3, 12, 12, 12] > 0.5 and hints[3, 0, 0, 0] == -1
    np.testing.assert_array_equal(evidence_channels(evidence, 24, hints=True), np.concatenate([seen, hints]))


def test_weights_without_hints_begin_a_network_with_them_that_answers_the_same(tmp_path) -> None:
    old, new = build(LiteConfig(**SMALL), 3).eval(), build(LiteConfig(**SMALL, hints=True), 4).eval()
    save_network(tmp_path / "old.safetensors", old)
    begin_from(new, tmp_path / "old.safetensors")
    points = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    partial = PartialObject(points=points, normals=np.zeros_like(points), evidence=half_ball())
    assert batch_of(partial, points=0, cells=16, hints=True).evidence.shape[1] == 8
    queries = torch.rand(500, 3) * 2 - 1
    torch.testing.assert_close(old.complete(partial).logits(queries), new.complete(partial).logits(queries))


@pytest.mark.parametrize("config", [LiteConfig(**{**SMALL, "fine": 16}, hints=True), LiteConfig(**SMALL)])
def test_weights_of_another_network_begin_nothing(tmp_path, config) -> None:
    save_network(tmp_path / "old.safetensors", build(LiteConfig(**SMALL, hints=True)))
    with pytest.raises(CompleteError, match="another network than the one to train"):
        begin_from(build(config), tmp_path / "old.safetensors")
