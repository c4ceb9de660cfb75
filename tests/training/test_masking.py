from dataclasses import replace

import numpy as np
import pytest
import torch

from goc.complete import evidence_channels
from goc.geometry.raycast import TriangleScene
from goc.scene import Camera, Evidence
from goc.training.cuts import AS_SEEN, CutConfig
from goc.training.masking import MaskConfig, _evidence, add_depth_noise, mask, render_view, visible
from goc.training.placement import PlacedShape
from goc.training.primitives import Box, Ellipsoid, Lathe, Shrunk
from goc.training.procedural import random_shape
from goc.training.samples import LoaderConfig, make_batch, true_distance
from goc.training.surroundings import no_surroundings, random_surroundings
from goc.training.viewpoints import random_viewpoints
from goc.training.watertight_shape import CsgPart, shape_from_parts

BALL = shape_from_parts([CsgPart(body=Ellipsoid((1, 1, 1)), at=(0, 0, 0))], 48)
ALL_TOLD = {"front": 0.0, "cuts": AS_SEEN}
EXACT = MaskConfig(noise=0.0, size_px=64, **ALL_TOLD)


def masked(solid, config, seed):
    return mask(solid, config, np.random.default_rng(seed))


def grid_points(evidence):
    return evidence.origin + evidence.voxel * np.argwhere(np.ones(evidence.state.shape, bool))


@pytest.mark.parametrize("config", [EXACT, MaskConfig(noise=0.0, arc=0.0, room=1.0, size_px=64, **ALL_TOLD)])
def test_exact_evidence_agrees_with_the_truth(config):
    looks = [masked(random_shape(np.random.default_rng(seed), 48), config, seed) for seed in range(4)]
    for look in (look for look in looks if look is not None):
        evidence = look.partial.evidence
        distance = true_distance(look, grid_points(evidence).astype(np.float32)).reshape(evidence.state.shape)
        empty, surface = evidence.state == Evidence.EMPTY, evidence.state == Evidence.SURFACE
        assert (distance[empty] > -2 * evidence.voxel).mean() > 0.99
        assert np.median(np.abs(distance[surface] - evidence.sdf[surface])) < evidence.voxel


def test_a_ball_seen_from_one_side_is_known_on_that_side():
    look = masked(BALL, MaskConfig(noise=0.0, arc=1.0, room=0.0, points=500, size_px=64, **ALL_TOLD), 3)
    assert look.regime == "arc" and 1 <= look.views <= 6
    low, high = look.placed.box()
    world = look.cube.world_from_model(look.partial.points)
    assert ((world > low - 0.05) & (world < high + 0.05)).all()
    assert 0 < (look.partial.evidence.state == Evidence.UNKNOWN).mean() < 1


def test_all_round_views_see_all_of_a_ball():
    look = masked(BALL, MaskConfig(noise=0.0, arc=0.0, room=0.0, points=400, **ALL_TOLD), 0)
    outwards = look.partial.points - 0.5 * (look.partial.points.min(0) + look.partial.points.max(0))
    assert len(np.unique(np.sign(outwards), axis=0)) == 8


@pytest.mark.parametrize("strategy", ["random", "none"])
def test_the_other_strategies_of_table_6_keep_points_on_all_sides(strategy):
    look = masked(BALL, MaskConfig(strategy=strategy, noise=0.0, points=300), 1)
    assert look.partial.points.shape == (300, 3)
    assert np.ptp(look.partial.points, axis=0).min() > 1.0


def test_points_behind_the_object_or_out_of_the_image_are_not_visible():
    placed = PlacedShape(shape=BALL, matrix=np.eye(3), shift=np.zeros(3))
    at = random_viewpoints(placed.box(), no_surroundings(), "arc", 1, 64, np.random.default_rng(0))[0]
    surface, _ = placed.surface(500, 0)
    away = np.linalg.norm(surface - at.position.numpy(), axis=1)
    near, far = surface[away.argmin()], surface[away.argmax()]
    behind_camera = 2 * at.position.numpy() - near
    points = np.stack([near, far, behind_camera])
    assert visible(points, at, placed, no_surroundings()).tolist() == [True, False, False]


def test_the_outside_of_a_thin_bowl_is_not_seen_from_within():
    """Its wall is thinner than two pixels of the virtual cameras; the mask is of exact rays."""
    profile = np.array([[0, 0], [0.3, 0], [0.5, 0.4], [0, 0.4]])
    drawn_on = np.array([[0, 0], [0.3, 0], [0.5, 0.4], [0.75, 0.9], [0, 0.9]])
    inner = CsgPart(body=Shrunk(Lathe(drawn_on), 0.03), at=(0, 0, 0), operation="difference")
    bowl = shape_from_parts([CsgPart(body=Lathe(profile), at=(0, 0, 0)), inner], 64)
    placed = PlacedShape(shape=bowl, matrix=np.eye(3), shift=np.zeros(3))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 3.0  # straight above, looking down
    at = Camera(
        focal_px=torch.full((2,), 120.0, dtype=torch.float64),
        centre_px=torch.full((2,), 36.0, dtype=torch.float64),
        width=72,
        height=72,
        world_from_cam=torch.from_numpy(pose),
    )
    points, normals = placed.surface(4000, 0)
    seen = visible(points, at, placed, no_surroundings())
    up = normals[:, 2]
    assert seen[up > 0.2].mean() > 0.97
    assert seen[up < -0.05].mean() < 0.01  # two pixels' slack keeps a third of them


def test_a_wall_before_an_object_hides_it():
    placed = PlacedShape(shape=BALL, matrix=np.eye(3), shift=np.zeros(3))
    at = random_viewpoints(placed.box(), no_surroundings(), "arc", 1, 64, np.random.default_rng(0))[0]
    middle = at.position.numpy() * 0.5 + [0, 0, 0.25]
    across = np.cross(at.position.numpy(), [0, 0, 1.0])
    corners = middle + np.stack([-5 * across - [0, 0, 5], 5 * across - [0, 0, 5], [0, 0, 9]])
    wall = TriangleScene(corners.astype(np.float32), np.array([[0, 1, 2]], np.int32))
    points, _ = placed.surface(300, 0)
    assert visible(points, at, placed, no_surroundings()).any()
    assert not visible(points, at, placed, replace(no_surroundings(), scene=wall)).any()


def test_forgotten_space_leaves_no_empty_voxel():
    look = masked(BALL, MaskConfig(cuts=CutConfig(forget_empty=1.0)), 2)
    assert (look.partial.evidence.state != Evidence.EMPTY).all()


def test_no_camera_stands_behind_a_wall_or_below_the_floor():
    placed = PlacedShape(
        shape=shape_from_parts([CsgPart(body=Box((2, 1, 1)), at=(0, 0, 0))], 32), matrix=np.eye(3), shift=np.zeros(3)
    )
    for seed in range(8):
        random = np.random.default_rng(seed)
        around = random_surroundings(placed, 0.3, random)
        for at in random_viewpoints(placed.box(), around, "room", 8, 32, random):
            position = at.position.numpy()
            assert (around.walls[:, :3] @ position > around.walls[:, 3]).all()
            assert position[2] > around.lowest


def test_holes_and_rays_into_nothing_erase_no_evidence():
    """A pixel without depth says nothing: what other pixels and views measured stays."""
    random = np.random.default_rng(3)
    placed = PlacedShape(shape=BALL, matrix=np.eye(3), shift=np.zeros(3))
    views = [
        render_view(placed, no_surroundings(), at)
        for at in random_viewpoints(placed.box(), no_surroundings(), "sphere", 6, 48, random)
    ]
    seen = placed.surface(2000, 0)[0]

    def surface(views):
        return _evidence(views, seen, 0.05, 48).state == Evidence.SURFACE

    holed = []
    for view in views:
        holes = random.random(view.depth.shape) < 0.3
        holed.append(replace(view, depth=np.where(holes, np.float32(np.nan), view.depth)))
    noisy = [replace(view, slope=np.where(np.isnan(view.depth), np.float32(np.nan), view.slope)) for view in holed]
    whole, left = surface(views), surface(noisy)
    assert whole.sum() > 2000
    assert (left & whole).sum() > 0.7 * whole.sum()  # some voxels had one ray alone
    assert all(np.isnan(view.slope[np.isnan(view.depth)]).all() for view in add_depth_noise(holed, placed, 1.0, random))


def test_batches_depend_on_their_number_alone():
    loader = LoaderConfig(batch=2, masks=2, queries=256, resolution=32)
    draw = lambda random: random_shape(random, 32)  # noqa: E731
    one, other, next_ = (make_batch(draw, loader, MaskConfig(size_px=32), 16, (0, n)) for n in (7, 7, 8))
    assert one.seen.evidence.shape == (2, 4, 16, 16, 16)
    assert one.queries.shape == (2, 256, 3) and one.distance.shape == (2, 256)
    assert (one.queries == other.queries).all() and (one.seen.evidence == other.seen.evidence).all()
    assert (one.queries != next_.queries).any()
    assert one.queries.abs().max() <= 1
    assert 0.1 < (one.distance < 0).float().mean() < 0.9


def test_queries_are_where_something_is_to_be_decided():
    look = masked(BALL, MaskConfig(noise=0.0, arc=0.0, room=1.0, **ALL_TOLD), 5)
    channels = evidence_channels(look.partial.evidence, 16)
    batch = make_batch(lambda _: BALL, LoaderConfig(batch=1, masks=1, queries=2000), MaskConfig(), 16, (1,))
    near = batch.distance.abs() < 0.1
    assert near.float().mean() > 0.4
    assert channels.shape == (4, 16, 16, 16)
