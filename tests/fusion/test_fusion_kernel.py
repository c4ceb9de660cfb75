"""The fusion kernel against its slow twin, and against closed forms."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import box_room, cube, table
from cameras import pinhole
from goc import _native
from goc.fusion.depth_views import depth_view
from goc.fusion.volume import BlockGrid, Volume
from goc.geometry.native_camera import native_camera
from goc.scene import Frame
from oracles import fusion

VOXEL = 0.03


@pytest.fixture(scope="module")
def views():
    rng = np.random.default_rng(0)
    made = []
    for frame in box_room({1: table(0.0, 0.6), 2: cube(0.1, 0.5, 0.72, 0.25)}, size=(80, 60)):
        image = torch.tensor(rng.integers(0, 256, (60, 80, 3)), dtype=torch.uint8)
        made.append(depth_view(Frame(camera=frame.camera, image=image, depth=frame.depth, ids=frame.ids)))
    return made


def lattice(blocks):
    return BlockGrid(
        origin=np.array([0.013, -0.007, 0.004]), voxel=VOXEL, truncation=3 * VOXEL, blocks=np.array(blocks, np.int32)
    )


@pytest.mark.parametrize("wanted", [2, 1, None])
def test_kernel_and_twin_agree(views, wanted):
    at = lattice([(0, 2, 3), (0, 1, 2), (-2, 3, 2), (9, 9, 9)])
    volume, expected = Volume(at), np.zeros((4, 8, 8, 8, 8))
    for view in views[:3]:
        volume.add(view, wanted)
        expected += fusion.fuse_view(at.origin, at.voxel, at.truncation, at.blocks, view, wanted)
    assert expected[..., fusion.WEIGHT].any() and expected[..., fusion.EMPTY].any()
    assert wanted is None or expected[..., fusion.OTHER].any()
    # float32 positions may put a voxel on the other side of a pixel's rim: one in a thousand, no more
    off = ~np.isclose(sums_last(volume), expected, rtol=2e-3, atol=1e-4).all(axis=-1)
    assert off.mean() < 1e-3


def sums_last(volume):
    """(b 8 8 8 s), as the twin has them."""
    return np.moveaxis(volume.sums, 0, -1)


def test_blocks_before_and_behind_everything_agree_with_the_twin(views):
    view = views[2]
    position, axis = view.camera.world_from_cam[:3, [3, 2]].T.double().numpy()  # from the camera to behind the wall
    at = lattice(np.floor((position + np.arange(0.3, 5.6, 0.35)[:, None] * axis) / (8 * VOXEL)))
    volume = Volume(at)
    volume.add(view, 1)
    expected = fusion.fuse_view(at.origin, at.voxel, at.truncation, at.blocks, view, 1)
    off = ~np.isclose(sums_last(volume), expected, rtol=2e-3, atol=1e-4).all(axis=-1)
    assert off.mean() < 1e-3
    empty = expected[..., fusion.EMPTY].reshape(len(expected), -1)
    assert (empty > 0).all(axis=1).any() and not empty[-1].any()


def test_a_pixel_with_a_slope_but_no_depth_makes_its_ray_unknown(views):
    at = lattice([(0, 2, 3), (0, 1, 2)])
    holes = np.random.default_rng(3).random(views[0].depth.shape) < 0.05
    view = replace(views[0], depth=np.where(holes, np.float32(np.nan), views[0].depth))
    volume = Volume(at)
    volume.add(view, None)
    expected = fusion.fuse_view(at.origin, at.voxel, at.truncation, at.blocks, view, None)
    off = ~np.isclose(sums_last(volume), expected, rtol=2e-3, atol=1e-4, equal_nan=True).all(axis=-1)
    assert np.isnan(expected).any() and not np.isnan(expected).all()
    assert off.mean() < 1e-3


def test_colours_are_left_out_where_there_are_none(views):
    at = lattice(list(np.ndindex(2, 3, 3)))
    plain, coloured = Volume(at), Volume(at)
    plain.add(replace(views[0], colours=None), 1)
    coloured.add(views[0], 1)
    assert coloured.sums[5:].any() and not plain.sums[5:].any()
    np.testing.assert_array_equal(plain.sums[:5], coloured.sums[:5])


FUSE_ALONE = """
import importlib.util, sys
import numpy as np
spec = importlib.util.spec_from_file_location("_native", sys.argv[1])
native = importlib.util.module_from_spec(spec)
spec.loader.exec_module(native)
given = np.load(sys.argv[2])
sums = np.zeros((native.FUSE_SUMS, len(given["blocks"]), 8, 8, 8), np.float32)
camera = native.Camera(*given["lens"].tolist(), 80, 60, *given["poses"].tolist())
images = (given[name] for name in ("lattice", "blocks", "depth", "slope", "colours"))
native.fuse_view(*images, camera, given["ids"], 1, sums)
slope = np.zeros_like(given["depth"])
native.depth_slope(given["depth"], camera, 2, 0.03, 6, slope)
np.savez(sys.argv[3], sums=sums, slope=slope, level=native.simd_level())
"""


@pytest.mark.parametrize("level", ["portable", "avx2"])
def test_every_instruction_set_gives_the_same_sums_and_slopes(views, level, tmp_path):
    at, view = lattice([(0, 2, 3), (0, 1, 2), (-2, 3, 2), (0, 0, 4)]), views[0]
    row = np.array([*at.origin, at.voxel, at.truncation])
    images = {name: getattr(view, name) for name in ("depth", "slope", "colours", "ids")}
    images["lens"] = np.stack([view.camera.focal_px, view.camera.centre_px])
    images["poses"] = np.stack([view.camera.cam_from_world[:3], view.camera.world_from_cam[:3]])
    np.savez(tmp_path / "in.npz", lattice=row, blocks=at.blocks, **images)
    command = [sys.executable, "-c", FUSE_ALONE, _native.__file__, tmp_path / "in.npz", tmp_path / "out.npz"]
    subprocess.run(command, check=True, env={"GOC_SIMD": level})
    volume, found = Volume(at), np.load(tmp_path / "out.npz")
    volume.add(view, 1)
    assert found["level"] == level or level != "portable"  # a machine may lack AVX2
    off = ~np.isclose(found["sums"], volume.sums, rtol=1e-4, atol=1e-4)
    assert volume.weight.any() and off.mean() < 1e-3
    np.testing.assert_allclose(found["slope"], view.slope, atol=1e-5)  # NaN in the same places


def test_sums_are_equal_for_any_number_of_threads(views):
    at = lattice(list(np.ndindex(4, 4, 5)))
    before, results = _native.thread_count(), []
    try:
        for threads in (1, 2, 5):
            _native.set_thread_count(threads)
            volume = Volume(at)
            for view in views:
                volume.add(view, 1)
            results.append(volume.sums)
    finally:
        _native.set_thread_count(before)
    assert all(np.array_equal(results[0], other) for other in results[1:])


def test_order_of_views_does_not_matter(views):
    forth, back = Volume(lattice([(0, 2, 3)])), Volume(lattice([(0, 2, 3)]))
    for view in views:
        forth.add(view, 2)
    for view in reversed(views):
        back.add(view, 2)
    np.testing.assert_allclose(forth.sums, back.sums, rtol=1e-4, atol=1e-3)


def plane_view(normal, distance, size=32, focal=60.0):
    """Depth of the plane normal · p = distance, camera at the origin."""
    u, v = np.meshgrid(np.arange(size) + 0.5 - size / 2, np.arange(size) + 0.5 - size / 2)
    rays = np.stack([u / focal, v / focal, np.ones_like(u)], -1)
    depth = distance / (rays @ np.asarray(normal))
    cosine = np.abs(rays @ np.asarray(normal)) / np.linalg.norm(rays, axis=-1)
    return pinhole(focal, (size, size)), depth, cosine


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.36, -0.48, 0.8)])
def test_slope_of_a_plane_is_exact(normal):
    camera, depth, cosine = plane_view(normal, 1.5)
    image = torch.zeros(32, 32, 3, dtype=torch.uint8)
    view = depth_view(Frame(camera=camera, image=image, depth=torch.tensor(depth, dtype=torch.float32)))
    whole = ~np.isnan(view.slope)
    assert whole.mean() > 0.9
    np.testing.assert_allclose(view.slope[whole], cosine[whole], atol=2e-3)


def test_flying_pixels_and_missing_depth_have_no_slope():
    camera, depth, _ = plane_view((0.0, 0.0, 1.0), 2.0)
    depth[10, 10], depth[20, 5], depth[5, 20], depth[6, 25] = 1.5, np.nan, 0.0, np.inf
    image = torch.zeros(32, 32, 3, dtype=torch.uint8)
    view = depth_view(Frame(camera=camera, image=image, depth=torch.tensor(depth, dtype=torch.float32)))
    assert np.argwhere(np.isnan(view.slope)).tolist() == [[5, 20], [6, 25], [10, 10], [20, 5]]
    assert np.isnan(view.depth[[20, 5, 6], [5, 20, 25]]).all()


def test_a_frame_without_depth_is_no_view():
    camera, _, _ = plane_view((0.0, 0.0, 1.0), 2.0)
    assert depth_view(Frame(camera=camera, image=torch.zeros(32, 32, 3, dtype=torch.uint8))) is None


def test_arrays_of_different_sizes_are_refused(views):
    view, camera = views[0], native_camera(views[0].camera)
    short = np.ascontiguousarray(view.slope[1:])
    sums = np.zeros((_native.FUSE_SUMS, 2, 8, 8, 8), np.float32)
    row = np.array([0.0, 0, 0, 0.01, 0.03])
    blocks = np.zeros((1, 3), np.int32)
    with pytest.raises(ValueError, match="slope must have the camera's height and width"):
        _native.fuse_view(row, blocks, view.depth, short, view.colours, camera, None, 0, sums[:, 1:].copy())
    with pytest.raises(ValueError, match="one set of sums a block"):
        _native.fuse_view(row, blocks, view.depth, view.slope, view.colours, camera, None, 0, sums)
    dot, one = np.ones((1, 1), np.float32), native_camera(view.camera.resized(1, 1))
    with pytest.raises(ValueError, match="an image needs two pixels"):
        _native.fuse_view(row, blocks, dot, dot, None, one, None, 0, sums[:, 1:].copy())
    with pytest.raises(ValueError, match="radius must be 1 to 8 pixels"):
        _native.depth_slope(view.depth, camera, 0, 0.03, 6, np.zeros_like(view.depth))
    with pytest.raises(ValueError, match="cells need an edge"):
        _native.count_cells(view.depth, view.slope, None, camera, 0.0)
