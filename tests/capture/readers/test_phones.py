"""What phone apps record: Polycam, Record3D, 3D Scanner App, and ARKitScenes."""

import json
import zipfile

import numpy as np
import pytest

from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError, FileError
from goc.files import read_depth, write_depth, write_png
from goc.synth.export import export_room
from goc.synth.export.cameras import Y_UP_FROM_Z_UP
from roundtrips import assert_same_cameras, assert_same_frames


@pytest.mark.parametrize("app", ["polycam", "3d-scanner-app"])
def test_apps_on_arkit(room, truth, tmp_path, app):
    export_room(room, app, tmp_path / "scan")
    capture = load_capture(tmp_path / "scan")
    assert_same_cameras(capture, truth, Y_UP_FROM_Z_UP)
    assert_same_frames(capture, truth, ids=False)
    assert (capture.metric, capture.units_per_metre, capture.up) == (True, 1.0, (0.0, 1.0, 0.0))


def test_arkitscenes(room, truth, tmp_path):
    export_room(room, "arkitscenes", tmp_path / "41069021")
    for path in (tmp_path / "41069021", tmp_path / "41069021/41069021_frames"):
        capture = load_capture(path)
        assert_same_cameras(capture, truth)
        assert_same_frames(capture, truth, ids=False)
        assert (capture.metric, capture.up) == (True, (0.0, 0.0, 1.0))


class TestRecord3D:
    @pytest.fixture
    def scan(self, room, tmp_path):
        export_room(room, "record3d", tmp_path)
        return tmp_path / "scan.r3d"

    def change(self, scan, edit):
        """The recording with other metadata, its pieces deflated."""
        with zipfile.ZipFile(scan) as packed:
            files = {name: packed.read(name) for name in packed.namelist()}
        document = json.loads(files["metadata"])
        edit(document, files)
        if "metadata" in files:
            files["metadata"] = json.dumps(document).encode()
        with zipfile.ZipFile(scan, "w", zipfile.ZIP_DEFLATED) as packed:
            for name, data in files.items():
                packed.writestr(name, data)

    def test_a_recording(self, truth, scan):
        turn = np.linalg.inv(truth.cameras[0].world_from_cam.double().numpy() @ np.diag([1.0, -1, -1, 1]))
        for path in (scan, scan.parent):
            capture = load_capture(path)
            assert_same_cameras(capture, truth, turn)
            assert_same_frames(capture, truth, ids=False)
            assert capture.metric
            np.testing.assert_allclose(capture.up, turn[:3, :3] @ [0, 0, 1], atol=1e-6)

    def test_an_archive_that_was_unpacked(self, truth, scan, tmp_path):
        with zipfile.ZipFile(scan) as packed:
            packed.extractall(tmp_path / "unpacked")
        assert_same_frames(load_capture(tmp_path / "unpacked"), truth, ids=False)

    def test_older_recordings_and_deflated_ones(self, truth, scan):
        def edit(document, files):
            del document["perFrameIntrinsicCoeffs"], document["initPose"]
            document["w"] *= 2
            document["h"] *= 2
            document["K"] = [2 * value for value in document["K"][:8]] + [1]

        self.change(scan, edit)
        capture = load_capture(scan)  # the photograph's size counts, not that of the metadata
        np.testing.assert_allclose(capture.cameras[0].focal_px, truth.cameras[0].focal_px)
        assert_same_frames(capture, truth, ids=False)
        assert capture.up is None

    def test_the_export_as_exr_and_jpg(self, truth, scan, tmp_path):
        exr = pytest.importorskip("OpenEXR", reason="OpenEXR needs the extra goc[formats]")
        folder = tmp_path / "EXR_RGBD"
        (folder / "depth").mkdir(parents=True)
        (folder / "rgb").mkdir()
        with zipfile.ZipFile(scan) as packed:
            (folder / "metadata.json").write_bytes(packed.read("metadata"))
            for number, frame in enumerate(truth):
                (folder / f"rgb/{number}.jpg").write_bytes(packed.read(f"rgbd/{number}.jpg"))
                header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
                exr.File(header, {"R": frame.depth.numpy()}).write(str(folder / f"depth/{number}.exr"))
        scan.unlink()
        for path in (tmp_path, folder):
            assert_same_frames(load_capture(path), truth, ids=False)
        (folder / "metadata.json").unlink()
        with pytest.raises(CaptureError, match=r"a Record3D capture without metadata\.json"):
            load_capture(folder)

    def test_depth_of_low_confidence_is_none(self, truth, scan):
        import lzfse

        def edit(document, files):
            sure = np.full((48, 64), 2, np.uint8)
            sure[:5] = 0
            files["rgbd/1.conf"] = lzfse.compress(sure.tobytes())

        self.change(scan, edit)
        depth = load_capture(scan)[1].depth
        assert depth[:5].isnan().all() and not depth[5:].isnan().all()

    @pytest.mark.parametrize(
        ("edit", "message"),
        [
            (lambda document, files: files.pop("metadata"), r"a Record3D capture without metadata\. Export"),
            (lambda document, files: document.pop("K"), "its metadata are no JSON of Record3D"),
            (lambda document, files: document["poses"].pop(), r"1 of 12 images have no pose \(first: 11\)"),
            (lambda document, files: document.update(K=[0] * 9, perFrameIntrinsicCoeffs=[]), "focal lengths 0 and 0"),
            (
                lambda document, files: document.update(dw=None),
                "3072 depth values, of no known sensor",
            ),
            (lambda document, files: document.update(dw=32, dh=24), r"0\.depth: damaged|not the expected"),
            (lambda document, files: files.update({"rgbd/0.depth": b"bvx-" + b"\xff" * 90}), r"0\.depth: damaged"),
            (lambda document, files: files.update({"../rgbd/9.jpg": b""}), "leads out of the archive"),
        ],
    )
    def test_what_is_wrong_is_said(self, scan, edit, message):
        self.change(scan, edit)
        with pytest.raises((CaptureError, FileError), match=message) as caught:
            list(load_capture(scan))
        assert str(caught.value).startswith(str(scan)) and "\n" not in str(caught.value)

    def test_without_the_library_the_command_is_named(self, scan, monkeypatch):
        monkeypatch.setitem(__import__("sys").modules, "lzfse", None)
        with pytest.raises(FileError, match=r"lzfse is not installed.*pip install 'goc\[phones\]'"):
            list(load_capture(scan))


def test_corrected_frames_are_preferred_and_lose_their_black_border(room, truth, tmp_path):
    export_room(room, "polycam", tmp_path)
    heard = []
    load_capture(tmp_path, notify=heard.append)
    assert "no corrected_cameras/" in heard[0].message
    for kind in ("images", "cameras"):
        (tmp_path / "keyframes" / kind).rename(tmp_path / f"keyframes/corrected_{kind}")
    heard.clear()
    camera = load_capture(tmp_path, notify=heard.append).cameras[0]
    assert heard == []
    assert (camera.width, camera.height) == (62, 46)
    np.testing.assert_allclose(camera.centre_px, truth.cameras[0].centre_px - 1)


def test_sensors_of_a_phone_have_fewer_pixels_and_say_how_sure_they_are(room, truth, tmp_path):
    export_room(room, "polycam", tmp_path)
    for file in sorted((tmp_path / "keyframes/depth").iterdir()):
        write_depth(file, read_depth(file)[1::2, 1::2])
        sure = np.full((24, 32), 127, np.uint8)
        sure[:, :8] = 0
        write_png(tmp_path / "keyframes/confidence" / file.name, sure)
    depth = load_capture(tmp_path)[0].depth
    assert depth[:, :16].isnan().all()
    assert (depth - truth[0].depth).abs().nanmedian() < 0.05


def test_frames_that_moved_too_fast_are_left_out(room, truth, tmp_path):
    export_room(room, "3d-scanner-app", tmp_path)
    file = tmp_path / "frame_00003.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"motionQuality": 0.3}))
    heard = []
    capture = load_capture(tmp_path, notify=heard.append)
    assert capture.view_names[:3] == ("frame_00000.jpg", "frame_00006.jpg", "frame_00009.jpg")
    assert heard[0].message.startswith("1 of 12 frames moved too fast")


def test_images_between_poses_are_left_out(room, truth, tmp_path):
    export_room(room, "arkitscenes", tmp_path / "7")
    file = tmp_path / "7/7_frames/lowres_wide.traj"
    file.write_text("\n".join(file.read_text().splitlines()[1:]))
    heard = []
    assert len(load_capture(tmp_path / "7", notify=heard.append)) == 11
    assert heard[0].message.startswith("1 of 12 images have no pose at their time and are left out (first: 7_6845.200")


@pytest.mark.parametrize(
    ("app", "gone", "message"),
    [
        ("polycam", "keyframes/cameras", r"a Polycam capture without keyframes/cameras/\. Export or copy it again"),
        ("polycam", "keyframes/images", "a Polycam capture without images in keyframes/images/"),
        ("arkitscenes", "scan_frames/lowres_wide.traj", r"an? ARKitScenes capture without lowres_wide\.traj"),
        ("arkitscenes", "scan_frames/lowres_wide_intrinsics", "without lowres_wide_intrinsics/"),
        ("3d-scanner-app", "frame_00003.jpg", None),
    ],
)
def test_what_is_missing_is_said(room, truth, tmp_path, app, gone, message):
    export_room(room, app, tmp_path / "scan")
    (tmp_path / "scan" / gone).rename(tmp_path / "gone")
    if message is None:
        assert len(load_capture(tmp_path / "scan", CaptureConfig())) == 11
        return
    with pytest.raises(CaptureError, match=message):
        load_capture(tmp_path / "scan")


def test_poses_without_photographs_are_told_so(room, tmp_path):
    export_room(room, "3d-scanner-app", tmp_path)
    for file in tmp_path.glob("*.jpg"):
        file.unlink()
    with pytest.raises(CaptureError, match=r"a 3D Scanner App capture without frame_\*\.jpg"):
        load_capture(tmp_path)
