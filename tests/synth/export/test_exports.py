"""Every format: the room read back from it is the room, camera by camera and pixel by pixel."""

import numpy as np
import pytest
import torch

from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError, ConfigError, ExportError
from goc.scene import Capture
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.export import EXPORTERS, export_room

_EXACT = [name for name, exporter in EXPORTERS.items() if not exporter.resampled]


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    return make_room_capture(folder / "room", RoomConfig(views=8, width=64, height=48, objects=6, samples=1))


def from_first(capture: Capture) -> np.ndarray:
    """Poses in the axes of the first camera: formats may choose another world."""
    poses = np.stack([camera.world_from_cam.double().numpy() for camera in capture.cameras])
    return np.linalg.inv(poses[0]) @ poses


def angles(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Between rotations, radians; from the chord, which rounding does not spoil."""
    return np.linalg.norm(one - other, axis=(-1, -2)) / np.sqrt(2)


@pytest.mark.parametrize("name", _EXACT)
def test_a_room_read_back_is_the_same(name, room, tmp_path):
    exporter = EXPORTERS[name]
    native = load_capture(room)
    found = load_capture(_capture_in(export_room(room, name, tmp_path / "out")))
    assert len(found) == len(native)
    one, other = from_first(native), from_first(found)
    assert angles(one[:, :3, :3], other[:, :3, :3]).max() < 1e-4
    assert np.abs(one[:, :3, 3] - other[:, :3, 3]).max() < 1e-4
    for mine, theirs in zip(native.cameras, found.cameras, strict=True):
        assert (mine.width, mine.height) == (theirs.width, theirs.height)
        torch.testing.assert_close(mine.focal_px, theirs.focal_px, rtol=1e-5, atol=1e-3)
        torch.testing.assert_close(mine.centre_px, theirs.centre_px, rtol=1e-5, atol=1e-3)
    assert found.metric == ("metres" not in exporter.lacks)
    assert found.has_depth == ("depth" not in exporter.lacks)
    assert found.has_ids == ("ids" not in exporter.lacks)
    if "names" not in exporter.lacks:
        assert {k: v for k, v in found.id_names.items() if k} == {k: v for k, v in native.id_names.items() if k}
    for index in (0, 3, 7):
        _same_pixels(native, found, index)


def _capture_in(folder):
    """The folder, or the one file that a format puts there."""
    files = list(folder.iterdir())
    return files[0] if len(files) == 1 and files[0].is_file() else folder


def _same_pixels(native: Capture, found: Capture, index: int) -> None:
    mine, theirs = native[index], found[index]
    assert (mine.image.float() - theirs.image.float()).abs().mean() < 4  # JPEG, at worst
    if found.has_depth:
        torch.testing.assert_close(mine.depth, theirs.depth, rtol=0, atol=1e-3, equal_nan=True)
    if found.has_ids:
        assert torch.equal(mine.ids, theirs.ids)


def test_a_fisheye_room_shows_what_the_pinhole_saw(room, tmp_path):
    """Depth and ids at the directions of the view that was made of the fisheye, looked up in the room's own."""
    native, found = load_capture(room), load_capture(export_room(room, "nerfstudio-fisheye", tmp_path / "out"))
    for index in (0, 5):
        seen, truth = found[index], native[index]
        torch.testing.assert_close(seen.camera.world_from_cam, truth.camera.world_from_cam, rtol=0, atol=1e-5)
        at = seen.camera.rays()[..., :2] * truth.camera.focal_px + truth.camera.centre_px
        column, row = at.floor().long().unbind(-1)
        assert seen.camera.width > 30 and seen.camera.height > 20
        close = (seen.depth - truth.depth[row, column]).abs() < 0.03 * truth.depth[row, column]
        assert close.float().mean() > 0.9
        assert (seen.ids == truth.ids[row, column]).float().mean() > 0.9
        assert (seen.ids >= 0).all()


def test_what_cannot_be_exported_is_told_in_a_line(room, tmp_path):
    with pytest.raises(ConfigError, match="--format what is not known. Choose from nerfstudio, "):
        export_room(room, "what", tmp_path / "out")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("")
    with pytest.raises(ExportError, match="not an empty folder"):
        export_room(room, "colmap", tmp_path / "full")
    with pytest.raises(CaptureError, match="no capture here"):
        export_room(tmp_path, "colmap", tmp_path / "out")


def test_every_exporter_is_described():
    for name, exporter in EXPORTERS.items():
        assert name == exporter.name == name.lower()
        assert 10 < len(exporter.writes) < 90
    assert CaptureConfig().use_depth
