"""What every format has in common: sizes, orientation, offsets, transparency, and depth of other kinds and rasters."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from captures import LENS, poses, see, write_nerfstudio, write_rgbd
from goc.capture import CaptureConfig, load_capture
from goc.capture.assemble import assemble
from goc.capture.offset import offset_of
from goc.capture.source import FarPoints, Lens, Source, View
from goc.errors import CaptureError
from goc.events import ignore
from goc.files import write_depth, write_ids, write_png
from goc.scene import UNLABELLED


@dataclass(frozen=True)
class Held:
    """Pixels in memory, as a reader of an archive would hand them on."""

    path: Path
    pixels: tuple
    dtype: str

    def size(self):
        return len(self.pixels[0]), len(self.pixels)

    def read(self):
        return np.array(self.pixels, self.dtype)


def held(path, array):
    return Held(path, tuple(map(tuple, array.tolist())), str(array.dtype))


def source_of(folder, lens=LENS, count=2, **settings):
    """A source of written images, for what no reader of a folder has."""
    views = []
    for number, pose in enumerate(poses(count)):
        shot = see(pose)
        image = folder / f"{number}.png"
        write_png(image, shot.image)
        views.append(View(name=image.name, lens=lens, world_from_cam=pose, image=image))
    return Source(path=folder, views=tuple(views), **settings)


def with_depth(source, depths, **settings):
    views = zip(source.views, depths, strict=True)
    return replace(source, views=tuple(replace(view, depth=depth, **settings) for view, depth in views))


def test_distance_along_the_ray_becomes_z(tmp_path):
    source = source_of(tmp_path, depth_units_per_metre=1.0, depth_kind="distance")
    shots = [see(pose) for pose in poses(2)]
    capture = assemble(source, CaptureConfig(), ignore)
    length = capture.cameras[0].rays().norm(dim=-1).numpy()
    source = with_depth(source, [held(tmp_path / "0.png", shot.depth * length) for shot in shots])
    capture = assemble(source, CaptureConfig(), ignore)
    assert capture.depth_kind == "metric" and capture.metric
    np.testing.assert_allclose(capture[1].depth.numpy(), shots[1].depth, rtol=1e-6)


def test_a_fisheyes_z_depth_is_the_pinholes(tmp_path):
    """Depth along the lens's axis stays what it is where the view looks along that axis."""
    lens = replace(LENS, projection="fisheye")
    source = with_depth(source_of(tmp_path, lens), [held(tmp_path / "0.png", np.full((48, 64), 2000, np.uint16))] * 2)
    frame = assemble(source, CaptureConfig(), ignore)[0]
    assert (frame.depth == 2.0).all() and frame.camera.width < 80


def test_depth_of_other_intrinsics_is_brought_into_the_image(tmp_path):
    """A wider sensor of half the focal length, whose raster has another aspect: the wall of depth = column number."""
    own = Lens(80, 60, (LENS.focal_px[0] / 2, LENS.focal_px[1] / 2), (40.0, 30.0))
    columns = np.tile(np.arange(1, 81, dtype=np.uint16) * 10, (60, 1))
    source = with_depth(source_of(tmp_path), [held(tmp_path / "0.png", columns)] * 2, depth_lens=own)
    frame = assemble(source, CaptureConfig(), ignore)[0]
    u = (np.arange(64) + 0.5 - LENS.centre_px[0]) / 2 + 40.0
    np.testing.assert_allclose(frame.depth[5].numpy(), (np.floor(u) + 1) * 0.01, atol=1e-6)
    narrow = replace(own, focal_px=(LENS.focal_px[0] * 2, LENS.focal_px[1] * 2))
    source = with_depth(source_of(tmp_path), [held(tmp_path / "0.png", columns)] * 2, depth_lens=narrow)
    frame = assemble(source, CaptureConfig(), ignore)[0]
    assert frame.depth[0].isnan().all() and frame.depth[24, 31].isfinite()  # what it does not see has no depth


def test_unsure_depth_is_none_and_units_may_differ_by_view(tmp_path):
    source = with_depth(
        source_of(tmp_path, least_confidence=2.0),
        [held(tmp_path / "0.png", np.full((48, 64), 30, np.uint16))] * 2,
        confidence=held(tmp_path / "0.png", np.tile(np.uint8([0, 1, 2, 3]), (24, 8))),  # half the size
        depth_units_per_metre=10.0,
    )
    depth = assemble(source, CaptureConfig(), ignore)[0].depth
    assert depth[:, :4].isnan().all() and (depth[:, 4:8] == 3.0).all()


def test_a_saturated_sensor_has_no_depth_but_disparity_may_be_full(tmp_path):
    full = [held(tmp_path / "0.png", np.full((48, 64), 65535, np.uint16))] * 2
    source = with_depth(source_of(tmp_path), full)
    assert assemble(source, CaptureConfig(), ignore)[0].depth.isnan().all()
    assert assemble(replace(source, depth_kind="inverse"), CaptureConfig(), ignore)[0].depth.isfinite().all()


def test_positions_on_a_national_grid_lose_their_offset(tmp_path):
    far = np.array([400_000.37, 5_800_000.81, 12.0])
    source = source_of(tmp_path, points=FarPoints(positions=far + np.eye(3), colours=np.zeros((3, 3), np.uint8)))
    moved = []
    for view in source.views:
        pose = view.world_from_cam.copy()
        pose[:3, 3] += far
        moved.append(replace(view, world_from_cam=pose))
    heard = []
    capture = assemble(replace(source, views=tuple(moved)), CaptureConfig(), heard.append)
    assert "is taken off all positions" in heard[0].message
    for camera, pose in zip(capture.cameras, poses(2), strict=True):
        back = camera.world_from_cam[:3, 3].double().numpy() + capture.offset
        np.testing.assert_allclose(back, pose[:3, 3] + far, atol=1e-5)
    assert camera.world_from_cam[:3, 3].abs().max() < 10
    np.testing.assert_allclose(capture.points.positions + np.array(capture.offset), far + np.eye(3), atol=1e-5)
    assert offset_of(poses(3)) == (0.0, 0.0, 0.0)


def test_a_view_on_the_other_side_of_the_globe_is_refused(tmp_path):
    source = source_of(tmp_path, count=3)
    pose = source.views[2].world_from_cam.copy()
    pose[0, 3] = 2e7
    source = replace(source, views=(*source.views[:2], replace(source.views[2], world_from_cam=pose)))
    with pytest.raises(CaptureError, match=r"1 of 3 views are too far from the others \(first: 2\.png, 2e\+07 units"):
        assemble(source, CaptureConfig(), ignore)


def test_orientation_is_applied_where_only_the_upright_image_fits(tmp_path):
    """COLMAP 4 turns photographs when it reads them: its cameras then have the upright size."""
    write_nerfstudio(tmp_path, views=2)
    exif = Image.Exif()
    exif[0x0112] = 6
    upright = np.asarray(Image.open(tmp_path / "images/0000.png"))
    Image.fromarray(np.rot90(upright)).save(tmp_path / "images/0000.png", exif=exif)
    exif[0x0112] = 3  # a half turn: the stored image fits, and stays
    stored = np.asarray(Image.open(tmp_path / "images/0001.png"))
    Image.fromarray(stored).save(tmp_path / "images/0001.png", exif=exif)
    turned, kept = load_capture(tmp_path)
    np.testing.assert_array_equal(turned.image.numpy(), upright)
    np.testing.assert_array_equal(kept.image.numpy(), stored)


def test_photographs_on_their_side_get_turned_intrinsics(tmp_path):
    lens = replace(LENS, centre_px=(32.0, 24.0))
    write_rgbd(tmp_path, views=3, lens=lens, change=lambda meta: (meta.pop("width"), meta.pop("height")))
    roll = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])  # right was down, down was left
    pose = poses(3)[0]
    np.savetxt(tmp_path / "pose/0000.txt", pose @ roll)
    for folder in ("depth", "instance"):
        pixels = np.rot90(np.asarray(Image.open(tmp_path / folder / "0000.png")))
        (write_ids if folder == "instance" else write_png)(
            tmp_path / folder / "0000.png", pixels.astype(np.int16 if folder == "instance" else np.uint16)
        )
    Image.fromarray(np.rot90(np.asarray(Image.open(tmp_path / "color/0000.jpg")))).save(tmp_path / "color/0000.jpg")
    heard = []
    capture = load_capture(tmp_path, notify=heard.append)
    assert heard[0].message.startswith("1 of 3 images lie on their side")
    camera = capture.cameras[0]
    assert (camera.width, camera.height, camera.focal_px.tolist()) == (48, 64, [51.0, 50.0])
    points = camera.unproject_depth(capture[0].depth)  # in the room, and on the same surfaces
    plain = see(pose, lens)
    truth = torch.from_numpy(np.rot90(plain.depth).copy())
    np.testing.assert_allclose(capture[0].depth.numpy(), truth, atol=1e-3)
    assert (points > -0.01).all() and (points < 4.1).all()


def test_scaled_copies_scale_their_intrinsics(tmp_path):
    heard = []
    write_nerfstudio(tmp_path, views=2, change=lambda d: d.update(w=128, h=96, fl_x=100, fl_y=102, cx=62, cy=49))
    capture = load_capture(tmp_path, notify=heard.append)
    np.testing.assert_allclose(capture.cameras[0].focal_px.numpy(), LENS.focal_px)
    np.testing.assert_allclose(capture.cameras[0].centre_px.numpy(), LENS.centre_px)
    assert heard[0].message.startswith(
        "2 of 2 images are scaled copies: intrinsics are scaled along (first: images/0000"
    )


def test_cut_out_photographs_show_one_object(tmp_path):
    def change(document):
        for frame in document["frames"]:
            del frame["depth_file_path"], frame["instance_file_path"]

    write_nerfstudio(tmp_path, views=2, change=change)
    for number, pose in enumerate(poses(2)):
        shot = see(pose)
        alpha = np.where(shot.ids == 1, 255, 0).astype(np.uint8)
        Image.fromarray(np.dstack([shot.image, alpha])).save(tmp_path / f"images/{number:04d}.png")
        (tmp_path / f"instance/{number:04d}.png").unlink()
    heard = []
    capture = load_capture(tmp_path, notify=heard.append)
    assert "cut out" in heard[0].message
    np.testing.assert_array_equal(capture[0].ids.numpy(), np.where(see(poses(2)[0]).ids == 1, 1, UNLABELLED))
    np.testing.assert_array_equal(capture[0].valid.numpy(), see(poses(2)[0]).ids == 1)
    assert not load_capture(tmp_path, CaptureConfig(use_ids=False)).has_ids


def test_a_panorama_becomes_six_views(tmp_path):
    write_nerfstudio(tmp_path, views=2, change=lambda d: d.update(camera_model="EQUIRECTANGULAR", w=64, h=48))
    heard = []
    capture = load_capture(tmp_path, CaptureConfig(checks="off"), heard.append)  # of pinhole images
    assert len(capture) == 12 and capture.view_names[1] == "images/0000.png (right)"
    assert "2 of 2 views see more than a pinhole can: cut into 12 views" in heard[0].message
    front, right = capture.cameras[:2]
    torch.testing.assert_close(right.world_from_cam[:3, 2], front.world_from_cam[:3, 0])
    assert capture[1].depth.isfinite().any() and capture[1].ids.shape == capture[1].image.shape[:2]


def test_depth_can_be_none_of_the_kinds(tmp_path):
    write_depth(tmp_path / "d.png", np.ones((4, 4)))
    source = with_depth(source_of(tmp_path), [tmp_path / "d.png"] * 2)
    with pytest.raises(CaptureError, match="another aspect ratio"):
        assemble(source, CaptureConfig(), ignore)


def test_square_photographs_are_not_on_their_side(tmp_path):
    lens = Lens(48, 48, (50.0, 53.0), (24.0, 24.0))
    heard = []
    capture = load_capture(write_nerfstudio(tmp_path, views=3, lens=lens), CaptureConfig(checks="off"), heard.append)
    assert heard == [] and capture.cameras[0].focal_px.tolist() == [50.0, 53.0]
