"""ScanNet++: a DSLR's photographs on a laser scan, and a phone's video."""

import struct
import zlib

import lz4.block
import numpy as np
import pytest

from captures import LENS
from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError
from goc.files import write_image, write_png
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.export import export_room
from roundtrips import assert_same_cameras


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    config = RoomConfig(views=8, width=64, height=48, objects=6, samples=1)
    return make_room_capture(tmp_path_factory.mktemp("room") / "room", config)


@pytest.fixture
def scene(made, tmp_path):
    return export_room(made, "scannetpp", tmp_path / "scene")


def test_depth_and_ids_are_seen_on_the_scan(made, scene):
    truth = load_capture(made)
    for path in (scene, scene / "dslr"):
        capture = load_capture(path)
        assert_same_cameras(capture, truth)
        assert (capture.has_depth, capture.has_ids, capture.metric, capture.up) == (True, True, True, (0.0, 0.0, 1.0))
    for mine, other in zip(capture, truth, strict=True):
        close = (mine.depth - other.depth).abs() < 0.001
        assert close.float().mean() > 0.99
        assert (mine.ids == other.ids).float().mean() > 0.99
    names = {key: name for key, name in truth.id_names.items() if key}
    assert capture.id_names == names
    without = load_capture(scene, CaptureConfig(use_ids=False, use_depth=False))
    assert (without.has_depth, without.has_ids, without[0].depth, without[0].ids) == (False, False, None, None)


def test_what_is_anonymised_counts_for_nothing(made, scene):
    mask = np.full((48, 64), 255, np.uint8)
    mask[:10] = 0
    write_png(scene / "dslr/resized_anon_masks/0000.png", mask)
    frame = load_capture(scene)[0]
    assert frame.depth[:9].isnan().all() and (frame.ids[:9] == -1).all()
    assert not frame.depth[12:].isnan().all()


def test_without_a_scan_there_is_no_depth(scene):
    (scene / "scans/mesh_aligned_0.05.ply").unlink()
    heard = []
    capture = load_capture(scene, notify=heard.append)
    assert (capture.has_depth, capture.has_ids, capture.metric) == (False, False, True)
    assert "no scans/mesh_aligned_0.05.ply" in heard[0].message


def test_labels_of_another_mesh_are_refused(scene):
    (scene / "scans/segments.json").write_text('{"segIndices": [1, 2, 3]}')
    with pytest.raises(CaptureError, match=r"mesh_aligned_0\.05\.ply: more vertices than the 3 of its labels"):
        load_capture(scene)[0]


@pytest.mark.parametrize("gone", ["colmap/cameras.txt", "colmap/images.txt"])
def test_a_scene_that_is_not_whole(scene, gone):
    (scene / "dslr" / gone).unlink()
    with pytest.raises(CaptureError, match=rf"dslr: a ScanNet\+\+ capture without {gone}"):
        load_capture(scene)


def write_phone(folder, pack):
    """Frames 0, 10 and 20 are registered; depth of frame n is n + 1 decimetres, of 30 frames."""
    (folder / "colmap").mkdir(parents=True)
    (fx, fy), (cx, cy) = LENS.focal_px, LENS.centre_px
    (folder / "colmap/cameras.txt").write_text(f"1 PINHOLE 64 48 {fx} {fy} {cx} {cy}\n")
    lines = [f"{number} 1 0 0 0 {number} 0 0 1 frame_{number:06}.jpg\n\n" for number in (0, 10, 20)]
    (folder / "colmap/images.txt").write_text("".join(lines))
    for number in (0, 10, 20):
        write_image(folder / f"rgb/frame_{number:06}.jpg", np.full((48, 64, 3), number, np.uint8))
    (folder / "pose_intrinsic_imu.json").write_text("{}")
    metres = [np.full((192, 256), (number + 1) / 10, "<f4") for number in range(30)]
    (folder / "depth.bin").write_bytes(pack(metres))


def raw(data):
    coder = zlib.compressobj(wbits=-zlib.MAX_WBITS)
    return coder.compress(data) + coder.flush()


def as_stream(metres):
    return raw(b"".join(image.tobytes() for image in metres))


def as_deflated(metres):
    return b"".join(struct.pack("<I", len(data)) + data for data in (raw(image.tobytes()) for image in metres))


def as_lz4(metres):
    steps = [np.rint(image * 1000).astype("<u2").tobytes() for image in metres]
    packed = [lz4.block.compress(data, store_size=False) for data in steps]
    return b"".join(struct.pack("<I", len(data)) + data for data in packed)


@pytest.mark.parametrize("pack", [as_stream, as_deflated, as_lz4])
def test_a_phones_video(tmp_path, monkeypatch, pack):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_phone(tmp_path / "scene/iphone", pack)
    capture = load_capture(tmp_path / "scene", CaptureConfig(checks="off"))
    assert capture.view_names == ("rgb/frame_000000.jpg", "rgb/frame_000010.jpg", "rgb/frame_000020.jpg")
    for frame, number in zip(capture, (0, 10, 20), strict=True):
        assert frame.depth.min().item() == pytest.approx((number + 1) / 10, abs=1e-3)
        assert frame.depth.max().item() == pytest.approx((number + 1) / 10, abs=1e-3)
    assert capture.cameras[1].position.tolist() == [-10, 0, 0]
