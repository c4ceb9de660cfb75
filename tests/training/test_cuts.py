from dataclasses import replace

import numpy as np
import pytest

from goc.errors import ConfigError
from goc.scene import Evidence, EvidenceGrid
from goc.training.cuts import AS_SEEN, cut_in_half, with_contact_planes, without_empty
from goc.training.furniture import cupboard
from goc.training.masking import MaskConfig, mask
from goc.training.placement import PlacedShape
from goc.training.primitives import Box
from goc.training.surroundings import random_surroundings
from goc.training.viewpoints import random_viewpoints
from goc.training.watertight_shape import CsgPart, shape_from_parts

PLAIN = MaskConfig(arc=1.0, room=0.0, front=0.0, noise=0.0, jitter=0.0, size_px=48, cuts=AS_SEEN)
CHEST = shape_from_parts([CsgPart(body=Box((1, 0.5, 0.8)), at=(0, 0, 0))], 32)


def evidence() -> EvidenceGrid:
    state = np.random.default_rng(0).integers(0, 3, (20, 21, 22)).astype(np.uint8)
    sdf = np.where(state == Evidence.SURFACE, 0.3, 0).astype(np.float32)
    return EvidenceGrid(origin=np.array([-1.0, -1.0, -1.0]), voxel=0.1, state=state, sdf=sdf)


def test_unknown_space_behind_a_plane_is_empty_and_nothing_else_changes() -> None:
    before = evidence()
    after = with_contact_planes(before, np.array([[0, 0, 1.0, -0.35]]), np.array([0.0]))
    height = -1 + 0.1 * np.arange(22)
    below = np.broadcast_to(height < -0.45, before.state.shape)
    unknown = before.state == Evidence.UNKNOWN
    assert (after.state[below & unknown] == Evidence.EMPTY).all()
    np.testing.assert_array_equal(after.state[~(below & unknown)], before.state[~(below & unknown)])


def test_a_half_is_known_on_one_side_of_a_plane_alone() -> None:
    before, seen = evidence(), np.random.default_rng(1).uniform(-1, 1, (200, 3))
    after, plane = cut_in_half(before, seen, np.random.default_rng(2))
    assert 0.35 < (seen @ plane[:3] <= plane[3]).mean() < 0.75
    gone = (before.state != Evidence.UNKNOWN) & (after.state == Evidence.UNKNOWN)
    assert 0.1 < gone.mean() < 0.6
    assert (after.state == before.state)[~gone].all() and (after.sdf[gone] == 0).all()


def test_forgetting_empty_space_keeps_the_surface() -> None:
    before = evidence()
    after = without_empty(before)
    assert (after.state != Evidence.EMPTY).all()
    np.testing.assert_array_equal(after.state == Evidence.SURFACE, before.state == Evidence.SURFACE)


def test_from_the_front_a_chest_is_seen_before_a_wall_close_behind_it() -> None:
    placed = PlacedShape(shape=CHEST, matrix=np.eye(3), shift=np.zeros(3))
    low, high = placed.box()
    for seed in range(6):
        random = np.random.default_rng(seed)
        around = random_surroundings(placed, 0.0, random, backed=True)
        assert len(around.walls) and len(around.contacts) == len(around.walls) + 1
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
        gaps = (corners @ around.walls[:, :3].T - around.walls[:, 3]).min(axis=0)
        assert (gaps >= 0).all() and (gaps < 0.031).all()
        assert around.contacts[-1, 3] <= 0  # nothing of the object is below its support
        for at in random_viewpoints((low, high), around, "front", 3, 32, random):
            assert (at.position.numpy() @ around.walls[0, :3] - around.walls[0, 3]) > 0.5


def test_the_back_of_a_chest_before_a_wall_is_unknown_until_the_wall_is_told() -> None:
    front = replace(PLAIN, arc=0.0, front=1.0)
    seen, known = (
        mask(
            CHEST,
            replace(front, cuts=replace(AS_SEEN, wide=1.0, contacts=share)),
            np.random.default_rng(4),
        )
        for share in (0.0, 1.0)
    )
    assert seen is not None and known is not None and seen.regime == known.regime == "front" and seen.views <= 4
    unknown, less = ((one.partial.evidence.state == Evidence.UNKNOWN).mean() for one in (seen, known))
    assert less < unknown


def test_a_wide_cube_has_evidence_beyond_what_rays_passed() -> None:
    near, far = (
        mask(CHEST, replace(PLAIN, cuts=replace(AS_SEEN, wide=wide)), np.random.default_rng(5)) for wide in (0.0, 1.0)
    )
    assert near is not None and far is not None
    assert far.cube.side > near.cube.side

    def spans(one):
        return one.cube.side / 2 * one.partial.evidence.voxel * np.array(one.partial.evidence.state.shape)

    assert (spans(far) > spans(near)).all()


def test_a_bare_scan_knows_no_space_beside_the_object() -> None:
    told, bare = (
        mask(CHEST, replace(PLAIN, cuts=replace(AS_SEEN, bare=share)), np.random.default_rng(6)) for share in (0.0, 1.0)
    )
    assert told is not None and bare is not None
    less, more = ((one.partial.evidence.state == Evidence.EMPTY).mean() for one in (bare, told))
    assert 0 < less < 0.8 * more


def test_cupboards_are_closed_bodies() -> None:
    for seed in range(5):
        solid = shape_from_parts(cupboard(np.random.default_rng(seed)), 40)
        assert solid is not None
        low, high = solid.mesh.vertices.min(0), solid.mesh.vertices.max(0)
        assert (solid.distance < 0).sum() * solid.voxel**3 > 0.5 * np.prod(high - low)


def test_shares_of_views_are_at_most_the_whole() -> None:
    with pytest.raises(ConfigError, match="front.*at most 1 together"):
        MaskConfig(arc=0.6, room=0.3, front=0.2)


def test_points_of_a_half_are_on_its_side_of_the_cut() -> None:
    whole, half = (
        mask(
            CHEST,
            replace(PLAIN, arc=0.0, points=400, cuts=replace(AS_SEEN, halves=share)),
            np.random.default_rng(7),
        )
        for share in (0.0, 1.0)
    )
    assert whole is not None and half is not None
    spans = [np.ptp(one.cube.world_from_model(one.partial.points), axis=0) for one in (whole, half)]
    assert spans[1].min() < spans[0].min() - 0.05 or spans[1].max() < spans[0].max() - 0.05
