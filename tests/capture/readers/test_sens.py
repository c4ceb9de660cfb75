"""ScanNet's .sens recordings, made from the description of their bytes."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from fuzz import assert_only_file_errors
from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError, FileError
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


def recording(truth, *, version=4, codecs=(2, 1), shift=1000.0, lose=()):
    camera = truth.cameras[0]
    matrix = np.eye(4, dtype="<f4")
    matrix[0, 0], matrix[1, 1] = camera.focal_px
    matrix[:2, 2] = camera.centre_px - 0.5
    data = struct.pack("<IQ", version, 9) + b"StructureS"[:9]
    data += matrix.tobytes() + np.eye(4, dtype="<f4").tobytes() + matrix.tobytes() + np.eye(4, dtype="<f4").tobytes()
    size = (camera.width, camera.height)
    data += struct.pack("<2i4IfQ", *codecs, *size, *size, shift, len(truth))
    for number, frame in enumerate(truth):
        pose = np.full((4, 4), -np.inf) if number in lose else frame.camera.world_from_cam.numpy()
        depth = np.rint(np.nan_to_num(frame.depth.numpy()) * shift).astype("<u2").tobytes()
        colour = frame.image.numpy().tobytes()
        if codecs[0]:
            encoded = io.BytesIO()
            image = Image.fromarray(frame.image.numpy())
            image.save(encoded, "JPEG" if codecs[0] == 2 else "PNG", quality=97)
            colour = encoded.getvalue()
        depth = zlib.compress(depth) if codecs[1] == 1 else depth
        data += pose.astype("<f4").tobytes() + struct.pack("<4Q", number, number, len(colour), len(depth))
        data += colour + depth
    return data + struct.pack("<Q", 0)


@pytest.mark.parametrize(("codecs", "shift"), [((2, 1), 1000.0), ((1, 0), 1000.0), ((0, 1), 5000.0)])
def test_a_recording_is_what_was_recorded(truth, tmp_path, codecs, shift):
    (tmp_path / "scene0000_00.sens").write_bytes(recording(truth, codecs=codecs, shift=shift))
    capture = load_capture(tmp_path / "scene0000_00.sens")
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth, ids=False)


def test_annotations_lie_beside_the_recording(room, truth, tmp_path):
    export_room(room, "scannet", tmp_path / "scene")
    for name in ("color", "depth", "pose", "intrinsic"):
        (tmp_path / "scene" / name).rename(tmp_path / name)
    (tmp_path / "scene/scene.sens").write_bytes(recording(truth, lose=[1]))
    heard = []
    capture = load_capture(tmp_path / "scene", notify=heard.append)
    assert (len(capture), capture.has_ids, capture.id_names) == (11, True, {1: "crate", 2: "cupboard"})
    np.testing.assert_array_equal(capture[1].ids, truth[2].ids)
    said = [event.message for event in heard if hasattr(event, "message")]
    assert said[0].startswith("1 of 12 poses were lost (not finite), and their views are left out (first: color/1)")


def test_every_other_frame(truth, tmp_path):
    (tmp_path / "a.sens").write_bytes(recording(truth))
    capture = load_capture(tmp_path, CaptureConfig(every=2))
    assert capture.view_names == tuple(f"color/{number}" for number in range(0, 12, 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:-5000], r"a\.sens: ends in the middle of frame 1\d of 12\. Copy it again"),
        (lambda data: b"\3" + data[1:], r"a\.sens: version 3 of \.sens, not 4"),
        (lambda data: data[:277] + struct.pack("<2i", 2, 2) + data[285:], r"depth by 2, which goc does not know"),
        (lambda data: data[:305] + struct.pack("<Q", 10**12) + data[313:], r"1,000,000,000,000 frames in"),
        (lambda data: b"", "ends in the middle"),
    ],
)
def test_what_is_wrong_is_said_that_at_once(truth, tmp_path, change, message):
    (tmp_path / "a.sens").write_bytes(change(recording(truth)))
    with pytest.raises((CaptureError, FileError), match=message):
        load_capture(tmp_path)


def test_damaged_recordings_raise_only_our_errors(truth, tmp_path):
    (tmp_path / "good.sens").write_bytes(recording(truth))

    def load(path):
        try:
            list(load_capture(path))
        except CaptureError as error:
            raise FileError(str(path) + str(error)) from error

    assert_only_file_errors(load, tmp_path / "good.sens", count=60)
