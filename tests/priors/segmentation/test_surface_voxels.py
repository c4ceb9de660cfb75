from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import box_room, cube, orbit
from goc.events import ignore
from goc.geometry.voxels import pack_cells
from goc.priors.segmentation import SegmentConfig
from goc.priors.segmentation.cluster import SegmentedObjects
from goc.priors.segmentation.id_field import IdField
from goc.priors.segmentation.room_planes import find_room_planes
from goc.priors.segmentation.supports import footprint_of
from goc.priors.segmentation.surface_voxels import (
    SurfaceVoxels,
    back_project,
    by_name,
    fuse_depth,
    thinned,
    without_pinholes,
)

ROOM = box_room({1: cube(0.0, 0.5, 0.0, 0.5)})


def flat(height: float, views: float, voxel: float = 0.1, side: int = 12) -> tuple[np.ndarray, ...]:
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 2, indexing="ij"), -1).reshape(-1, 2)
    points = np.concatenate([(grid + 0.5) * voxel, np.full((len(grid), 1), height)], 1)
    return points, np.tile([0.0, 0.0, 1.0], (len(grid), 1)), np.full(len(grid), views)


def surface_of(*sheets: tuple[np.ndarray, ...], voxel: float = 0.1) -> SurfaceVoxels:
    points, normals, views = (np.concatenate(column) for column in zip(*sheets, strict=True))
    keys = pack_cells(np.floor(points / voxel).astype(np.int64))
    order = np.argsort(keys)
    return SurfaceVoxels(keys[order], points[order], normals[order], views[order], voxel)


def test_back_projection_undoes_projection():
    camera = ROOM.cameras[3]
    points = back_project(np.full((120, 160), 2.0), camera, 4)
    in_cam = (torch.tensor(points) - camera.position) @ camera.world_from_cam[:3, :3].double()
    pixel = in_cam[..., :2] / in_cam[..., 2:] * camera.focal_px + camera.centre_px
    assert in_cam[..., 2].numpy() == pytest.approx(2.0)
    assert pixel[5, 7].numpy() == pytest.approx([28.5, 20.5], abs=1e-4)


def test_fused_points_lie_on_the_boxes():
    surface = fuse_depth(ROOM, SegmentConfig(), ignore)
    x, y, z = np.abs(surface.points[:, 0]), surface.points[:, 1], surface.points[:, 2]
    cube_side = np.minimum(np.abs(x - 0.25), np.minimum(np.abs(y - 0.25), np.abs(z - 0.5)))
    off = np.minimum(np.minimum(np.abs(z), np.abs(y - 2.0)), cube_side)
    assert np.percentile(off, 99) < 1e-3
    assert np.linalg.norm(surface.normals, axis=1) == pytest.approx(1.0)
    assert surface.views.max() <= len(ROOM)
    assert (np.diff(surface.keys) > 0).all()


def test_thinning_draws_haze_to_the_sheet_and_keeps_it_there():
    haze = [flat(0.05 + 0.1 * step, views) for step, views in ((-1, 4.0), (0, 20.0), (1, 4.0))]
    thin = thinned(surface_of(*haze))
    assert len(thin) == 144
    assert thin.points[:, 2] == pytest.approx(0.05, abs=1e-9)


def test_thinning_keeps_two_sheets_that_are_well_seen():
    thin = thinned(surface_of(flat(0.05, 10.0), flat(0.55, 10.0)))
    assert sorted(set(np.round(thin.points[:, 2], 6))) == [0.05, 0.55]


def test_thinning_drops_a_sheet_that_few_views_saw_behind_one_that_many_did():
    thin = thinned(surface_of(flat(0.05, 1.0), flat(0.55, 30.0)))
    assert set(np.round(thin.points[:, 2], 6)) == {0.55}


def test_lone_holes_are_filled_only_within_one_surface():
    depth = np.full((20, 20), 2.0)
    depth[:, 10:] = 3.0
    holed = depth.copy()
    holed[1::3, 1::3] = np.nan
    filled = without_pinholes(holed)
    assert filled[4, 4] == 2.0
    assert np.isnan(filled[4, 10])  # at the step
    few = depth.copy()
    few[3, 3] = np.nan
    assert without_pinholes(few) is few


def test_views_are_taken_by_name():
    names = tuple(f"{index:03d}" for index in range(len(ROOM), 0, -1))
    assert by_name(replace(ROOM, view_names=names)) == list(range(len(ROOM)))[::-1]


def test_the_room_of_boxes_is_measured():
    surface = fuse_depth(ROOM, SegmentConfig(), ignore)
    room = find_room_planes(surface, ROOM.cameras, 1.0, np.random.default_rng(0))
    assert room.up.tolist() == [0.0, 0.0, 1.0]
    assert (room.floor.normal[2], room.floor.offset) == pytest.approx((1.0, 0.0), abs=1e-3)
    assert len(room.walls) == 1
    assert room.walls[0].normal == pytest.approx([0, -1, 0], abs=1e-3)
    assert room.walls[0].offset == pytest.approx(-2.0, abs=1e-3)
    assert room.ceiling is None
    assert not room.mask[surface.points[:, 2] > 0.1][surface.points[surface.points[:, 2] > 0.1, 1] < 1.9].any()


def test_points_take_the_id_of_the_nearest_voxel_or_none():
    surface = surface_of(flat(0.05, 1.0), flat(0.35, 1.0))
    things = SegmentedObjects(np.where(surface.points[:, 2] > 0.2, 4, 0), {})
    field = IdField(surface, things.ids, 2.0)
    asked = np.array([[0.5, 0.5, z] for z in (0.05, 0.12, 0.21, 0.33, 0.45, 0.9)] + [[1e9, 0, 0]])
    assert field(asked).tolist() == [0, 0, 4, 4, 4, -1, -1]


def test_small_parts_leave_a_hole():
    surface = surface_of(flat(0.05, 1.0))
    field = IdField(surface, np.where(surface.points[:, 0] > 0.6, -1, 3), 1.0)
    assert field(np.array([[0.3, 0.5, 0.05], [1.1, 0.5, 0.05]])).tolist() == [3, -1]


def test_footprints_close_what_things_hide():
    ring = np.array([(x, y) for x in range(9) for y in range(9) if max(abs(x - 4), abs(y - 4)) > 1])
    footprint = footprint_of(ring)
    assert footprint.holds(np.array([[4, 4], [0, 0], [9, 4], [-1, 3]])).tolist() == [True, True, False, False]
    assert len(footprint.rim()) == 32
    assert footprint.grown(2).holds(np.array([[10, 4], [11, 4]])).tolist() == [True, False]


def test_views_beyond_the_limit_are_spread_evenly():
    heard = []
    fuse_depth(box_room({}, poses=orbit(10)), SegmentConfig(max_views=4), heard.append)
    assert [event.done for event in heard] == [1, 2, 3, 4]
