"""Fusion in PyTorch against the native kernel: the same sums, to rounding."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import box_room, cube, table
from goc.device import CPU
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.fusion import device_volume
from goc.fusion.depth_views import depth_view
from goc.fusion.device_volume import DeviceVolume, fuse_views, on_device
from goc.fusion.volume import BlockGrid
from goc.scene import Frame

VOXEL = 0.03


@pytest.fixture(scope="module")
def views():
    rng = np.random.default_rng(0)
    made = []
    for frame in box_room({1: table(0.0, 0.6), 2: cube(0.1, 0.5, 0.72, 0.25)}, size=(80, 60)):
        image = torch.tensor(rng.integers(0, 256, (60, 80, 3)), dtype=torch.uint8)
        ids = frame.ids.clone()
        ids[:5] = -1
        made.append(depth_view(Frame(camera=frame.camera, image=image, depth=frame.depth, ids=ids)))
    return made[:5]


def lattice():
    blocks = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-1, 6), np.arange(0, 5), indexing="ij"), -1)
    blocks = np.concatenate([blocks.reshape(-1, 3), [[90, 90, 90]]])
    return BlockGrid(
        origin=np.array([0.013, -0.007, 0.004]), voxel=VOXEL, truncation=3 * VOXEL, blocks=blocks.astype(np.int32)
    )


def sums_on_device(views, wanted):
    volume = DeviceVolume(lattice(), CPU)
    for view in views:
        volume.add(on_device(view, CPU), wanted)
    return volume.finished()


@pytest.mark.parametrize("wanted", [2, 1, None])
def test_sums_are_those_of_the_kernel(views, wanted, monkeypatch):
    monkeypatch.setattr(device_volume, "_BLOCKS_AT_ONCE", 100)
    (expected,) = fuse_views([lattice()], [wanted], views, CPU)
    found = sums_on_device(views, wanted)
    assert all(plane.any() for name, plane in zip("dwvoergb", expected.sums, strict=True) if wanted or name != "o")
    # a voxel whose projection lies within rounding of a pixel's rim may be told of by the next pixel
    off = ~np.isclose(found.sums, expected.sums, rtol=2e-4, atol=2e-4)
    assert off.any(axis=0).mean() < 1e-3
    assert np.abs(found.sums - expected.sums).mean() < 1e-3 * np.abs(expected.sums).mean()


def test_views_without_ids_or_colours_are_fused_too(views):
    plain = [replace(view, ids=None) for view in views]
    found, all_ids = sums_on_device(plain, 1), sums_on_device(views, None)
    assert np.array_equal(found.sums, all_ids.sums)


def test_both_engines_make_the_same_meshes(views, monkeypatch):
    """The whole of the stage, with its device's volumes in place of the native ones."""
    room = box_room({1: table(0.0, 0.6), 2: cube(0.1, 0.5, 0.72, 0.25)}, size=(80, 60))
    config = ExtractConfig(scene_voxel=0.08, object_voxel=0.04, object_cells=8, evidence_cells=16)
    native = fuse_scene(room, config), extract_objects(room, config)

    def in_torch(lattices, wanted, views, device):
        with monkeypatch.context() as patch:
            patch.setattr(device_volume, "on_device", lambda view, _: on_device(view, CPU))
            patch.setattr(device_volume, "DeviceVolume", lambda at, _: DeviceVolume(at, CPU))
            return fuse_views(lattices, wanted, views, torch.device("meta"))  # any device but the processor

    monkeypatch.setattr("goc.extract.fuse.fuse_views", in_torch)
    monkeypatch.setattr("goc.extract.objects.fuse_views", in_torch)
    device = fuse_scene(room, config), extract_objects(room, config)
    assert abs(len(native[0].vertices) - len(device[0].vertices)) <= 0.002 * len(native[0].vertices)
    for one, other in zip(native[1], device[1], strict=True):
        assert (one.id, one.name) == (other.id, other.name)
        assert one.evidence.state.shape == other.evidence.state.shape
        assert (one.evidence.state != other.evidence.state).mean() < 2e-3
