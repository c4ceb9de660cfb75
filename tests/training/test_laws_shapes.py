"""Training shapes in the world: what rotation, stretching and mirroring do to distances, hits, samples and losses."""

import math

import numpy as np
import pytest
import torch

from goc.geometry.topology import is_watertight, signed_volume
from goc.scene import Mesh
from goc.training.losses import LossConfig, completion_loss, hard_iou, iou_loss, occupancy_loss, smooth_occupancy
from goc.training.placement import PlacedShape, random_placement
from goc.training.primitives import Box, Cylinder, Ellipsoid, Torus
from goc.training.watertight_shape import CsgPart, WatertightShape, shape_from_parts
from laws import MOTIONS, over


def built(*parts: CsgPart, cells=40) -> WatertightShape:
    shape = shape_from_parts(parts, cells)
    assert shape is not None
    return shape


def part(body, at=(0, 0, 0), **kinds) -> CsgPart:
    return CsgPart(body=body, at=at, **kinds)


SHAPES = {
    "ball": built(part(Ellipsoid((1, 1, 1)))),
    "slab": built(part(Box((1.0, 0.7, 0.3)))),
    "ring": built(part(Torus(1.0, 0.4))),
    "dumb-bell": built(
        part(Ellipsoid((0.4, 0.4, 0.4)), (-0.6, 0, 0)),
        part(Ellipsoid((0.4, 0.4, 0.4)), (0.6, 0, 0)),
        part(Cylinder(0.15, 1.2), turn=np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])),
    ),
    "pierced": built(part(Box((1.0, 1.0, 0.5))), part(Cylinder(0.3, 1.0), operation="difference")),
}


def placed(shape: WatertightShape, matrix: np.ndarray, shift=(0.5, -1.0, 2.0)) -> PlacedShape:
    return PlacedShape(shape=shape, matrix=matrix, shift=np.array(shift))


@over(shape=SHAPES)
def test_shapes_are_closed_stand_on_the_floor_and_are_one_long(shape):
    mesh = shape.mesh
    assert is_watertight(mesh)
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    assert (high - low).max() == pytest.approx(1.0, abs=2 * shape.voxel)
    assert low[2] == pytest.approx(0.0, abs=shape.voxel)
    np.testing.assert_allclose((low + high)[:2], 0.0, atol=2 * shape.voxel)
    assert np.abs(shape.distances(mesh.vertices.astype(np.float64))).max() < 0.5 * shape.voxel


@over(shape=SHAPES, motion=MOTIONS)
@pytest.mark.parametrize("size", [0.2, 1.0, 4.0])
def test_similar_placements_scale_distances_exactly(shape, motion, size):
    there = placed(shape, size * motion[:3, :3])
    points = np.random.default_rng(0).uniform(-0.6, 0.9, (300, 3))
    world = points @ there.matrix.T + there.shift
    np.testing.assert_allclose(there.distances(world), size * shape.distances(points), atol=1e-5 * size)


@over(shape=SHAPES)
@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (0.8, 1.2, 1.0), (1.0, -1.0, 1.0), (1.25, -0.8, 1.1)])
def test_samples_lie_on_the_stretched_surface_and_their_normals_point_outwards(shape, stretch):
    there = placed(shape, MOTIONS["any"][:3, :3] * np.array(stretch))
    points, normals = there.surface(400, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    assert np.abs(there.distances(points)).max() < shape.voxel
    step = 1.5 * shape.voxel
    outside, inside = there.distances(points + step * normals), there.distances(points - step * normals)
    assert (outside > inside).mean() > 0.97  # at sharp edges a step may end beyond the other side
    low, high = there.box()
    assert (points >= low - 1e-6).all() and (points <= high + 1e-6).all()


@over(shape=SHAPES)
@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.25, -0.8, 1.1)])
def test_rays_hit_the_placed_surface_from_outside(shape, stretch):
    there = placed(shape, MOTIONS["another"][:3, :3] * np.array(stretch))
    random = np.random.default_rng(4)
    targets, _ = there.surface(150, 5)
    origins = there.shift + 4 * random.normal(size=(150, 3)) / np.sqrt(3) + [0, 0, 6]
    hits, normals = there.closest_hit(origins, targets - origins)
    assert hits.found.mean() > 0.98 and hits.t[hits.found].max() <= 1 + 1e-3
    ends = (origins + hits.t[:, None] * (targets - origins))[hits.found]
    assert np.abs(there.distances(ends)).max() < shape.voxel
    towards = (normals * (targets - origins)).sum(1)[hits.found]
    assert (towards <= 1e-9).mean() > 0.98


@pytest.mark.parametrize("seed", range(12))
def test_random_placements_stand_on_the_ground_and_keep_their_size(seed):
    there, yaw = random_placement(SHAPES["slab"], np.random.default_rng(seed))
    low, high = there.box()
    assert low[2] == pytest.approx(0.0, abs=1e-6) and 0 <= yaw < 2 * math.pi
    assert 0.8**3 - 1e-9 <= abs(np.linalg.det(there.matrix)) <= 1.25**3 + 1e-9
    vertices = there.shape.mesh.vertices @ there.matrix.T + there.shift
    mesh = Mesh(vertices=vertices.astype(np.float32), faces=there.shape.mesh.faces)
    expected = np.linalg.det(there.matrix) * signed_volume(there.shape.mesh)
    assert signed_volume(mesh) == pytest.approx(expected, rel=1e-3)
    again, _ = random_placement(SHAPES["slab"], np.random.default_rng(seed))
    np.testing.assert_array_equal(again.matrix, there.matrix)


def test_differences_unions_and_intersections_are_those_of_sets():
    box, hole = part(Box((1.0, 1.0, 0.5))), part(Ellipsoid((0.4, 0.4, 0.4)), (0.3, 0, 0.25))
    volumes = {
        kind: signed_volume(built(box, CsgPart(body=hole.body, at=hole.at, operation=kind), cells=64).mesh)
        for kind in ("union", "difference", "intersection")
    }
    # every shape is scaled to a longest side of 1: undo that
    difference, shared, union = (
        volumes[kind] * side**3 for kind, side in (("difference", 1.0), ("intersection", 0.8), ("union", 1.2))
    )
    assert difference + shared == pytest.approx(0.5, rel=0.06)  # the longest side is right to a voxel of 64
    assert union + shared == pytest.approx(
        0.5 + 4 / 3 * math.pi * 0.4**3, rel=0.06
    )  # the longest side is right to a voxel of 64


LOGITS = torch.randn(3, 200, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
DISTANCE = torch.randn(3, 200, generator=torch.Generator().manual_seed(1), dtype=torch.float64) * 0.05


@pytest.mark.parametrize("band", [0.001, 0.02, 1.0])
def test_labels_fall_with_distance_and_are_symmetric(band):
    distance = torch.linspace(-2 * band, 2 * band, 81, dtype=torch.float64)
    labels = smooth_occupancy(distance, band)
    assert (labels.diff() <= 0).all() and labels[0] == 1 and labels[-1] == 0
    torch.testing.assert_close(labels + labels.flip(0), torch.ones_like(labels))


def test_losses_do_not_depend_on_the_order_of_points_or_objects():
    order = torch.randperm(200, generator=torch.Generator().manual_seed(2))
    for loss in (occupancy_loss, lambda a, b: iou_loss(a, b, LossConfig())):
        torch.testing.assert_close(loss(LOGITS[:, order], DISTANCE[:, order]), loss(LOGITS, DISTANCE))
        torch.testing.assert_close(loss(LOGITS.flip(0), DISTANCE.flip(0)), loss(LOGITS, DISTANCE))
    torch.testing.assert_close(hard_iou(LOGITS.flip(0), DISTANCE.flip(0), 0.3), hard_iou(LOGITS, DISTANCE, 0.3).flip(0))


@pytest.mark.parametrize("sure", [5.0, 20.0])
def test_surer_right_answers_cost_less_and_wrong_ones_more(sure):
    truth, config = -DISTANCE.sign(), LossConfig()
    clear = DISTANCE.sign()  # beyond the band in which labels are smooth
    for loss in (occupancy_loss, lambda a, b: iou_loss(a, b, config)):
        assert loss(sure * truth, clear) < loss(truth, clear) < loss(-sure * truth, clear)
    assert (hard_iou(sure * truth, clear, 0.3) == 1).all() and not hard_iou(-sure * truth, clear, 0.3).any()


@pytest.mark.parametrize("state", ["soft", "straight-through"])
def test_iou_is_a_share_and_its_gradient_pulls_the_right_way(state):
    logits = LOGITS.clone().requires_grad_()
    loss = iou_loss(logits, DISTANCE, LossConfig(iou_state=state))
    assert 0 <= loss <= 1
    loss.backward()
    assert (logits.grad[DISTANCE < 0] <= 0).all() and (logits.grad[DISTANCE >= 0] >= 0).all()


@pytest.mark.parametrize("weights", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.5, 2.0, 3.0)])
def test_the_total_is_the_weighted_sum(weights):
    config = LossConfig(bce=weights[0], iou=weights[1], kl=weights[2])
    terms = completion_loss(LOGITS, torch.tensor(0.7, dtype=torch.float64), DISTANCE, config)
    expected = sum(w * terms[name] for w, name in zip(weights, ("bce", "iou", "kl"), strict=True))
    torch.testing.assert_close(terms["loss"], expected)
