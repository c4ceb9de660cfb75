"""Frames out of videos, by a library or by ffmpeg."""

import os
import stat
import sys

import numpy as np
import pytest

from goc.capture import CaptureConfig, load_capture
from goc.capture.video import video_frames
from goc.errors import CaptureError, FileError
from goc.events import Warned, ignore
from goc.files import read_image
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.export import export_room
from goc.synth.export.cameras import Y_UP_FROM_Z_UP
from roundtrips import assert_same_cameras, assert_same_frames


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/goc/captures"


@pytest.fixture
def film(tmp_path):
    """Ten frames, each brighter than the one before, coded without loss of order."""
    cv2 = pytest.importorskip("cv2", reason="videos need the extra goc[video]")
    path = tmp_path / "walk in the kitchen.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    for number in range(10):
        writer.write(np.full((48, 64, 3), 20 * number + 10, np.uint8))
    writer.release()
    return path


def test_every_third_frame_is_taken_out_once(film, cache):
    heard = []
    frames = video_frames(film, 3, heard.append)
    assert list(frames) == [0, 3, 6, 9]
    for number, file in frames.items():
        assert abs(read_image(file).mean() - 20 * number - 10) < 4
    said = [event.message for event in heard if isinstance(event, Warned)]
    assert len(said) == 1 and said[0].startswith(
        f"frames of walk in the kitchen.avi are in {cache}/walk_in_the_kitchen-"
    )
    heard.clear()
    assert video_frames(film, 3, heard.append) == frames
    assert heard == []
    assert list(video_frames(film, 4, ignore)) == [0, 4, 8]
    os.utime(film, ns=(1, 1))
    assert video_frames(film, 3, ignore)[0].parent != frames[0].parent  # it changed


def test_a_damaged_video_leaves_nothing_behind(tmp_path, cache):
    pytest.importorskip("cv2", reason="videos need the extra goc[video]")
    (tmp_path / "a.mp4").write_bytes(b"no video at all" * 100)
    with pytest.raises(FileError, match=r"a\.mp4: no frame can be decoded\. Copy or export it again"):
        video_frames(tmp_path / "a.mp4", 1, ignore)
    assert list(cache.iterdir()) == []


def fake_ffmpeg(folder, script):
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(f"#!{sys.executable}\n{script}")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)


def test_without_the_library_ffmpeg_is_asked(tmp_path, cache, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    (tmp_path / "a.mp4").write_bytes(b"film")
    with pytest.raises(
        FileError, match=r"nothing here can decode videos\. Install ffmpeg, or: pip install 'goc\[video\]'"
    ):
        video_frames(tmp_path / "a.mp4", 1, ignore)
    script = "import sys\nassert 'select=not(mod(n\\\\,5))' in sys.argv\n[open(f'{n:06}.jpg', 'w') for n in range(3)]"
    fake_ffmpeg(tmp_path / "bin", script)
    assert [(number, file.name) for number, file in video_frames(tmp_path / "a.mp4", 5, ignore).items()] == [
        (0, "000000.jpg"),
        (5, "000005.jpg"),
        (10, "000010.jpg"),
    ]
    (tmp_path / "bin/ffmpeg").write_text(f"#!{sys.executable}\nimport sys\nsys.exit('moov atom not found')")
    with pytest.raises(FileError, match=r"a\.mp4: ffmpeg cannot decode it \(moov atom not found\)"):
        video_frames(tmp_path / "a.mp4", 7, ignore)
    assert len(list(cache.iterdir())) == 1


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    config = RoomConfig(views=8, width=64, height=48, objects=6, samples=1)
    return make_room_capture(tmp_path_factory.mktemp("room") / "room", config)


def test_stray_scanner(room, tmp_path):
    truth = load_capture(room)
    export_room(room, "stray", tmp_path / "scan")
    capture = load_capture(tmp_path / "scan")
    assert_same_cameras(capture, truth, Y_UP_FROM_Z_UP)
    assert_same_frames(capture, truth, ids=False)
    assert (capture.metric, capture.up) == (True, (0.0, 1.0, 0.0))


def test_stray_scanner_with_its_video(room, tmp_path):
    cv2 = pytest.importorskip("cv2", reason="videos need the extra goc[video]")
    truth, scan = load_capture(room), export_room(room, "stray", tmp_path / "scan")
    writer = cv2.VideoWriter(str(scan / "rgb.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 60, (64, 48))
    for frame in list(truth)[:7]:  # the video may end before the poses
        writer.write(frame.image.numpy()[..., ::-1].copy())
    writer.release()
    for file in (scan / "rgb").iterdir():
        file.unlink()
    heard = []
    capture = load_capture(scan, CaptureConfig(every=2), heard.append)
    assert capture.view_names == ("rgb/000000", "rgb/000002", "rgb/000004", "rgb/000006")
    for index, frame in enumerate(capture):
        assert np.median(np.abs(frame.image.numpy().astype(int) - truth[2 * index].image.numpy())) < 12  # coded hard
    assert len(load_capture(scan)) == 7
    load_capture(scan, notify=heard.append)
    assert heard[-1].message == "1 of 8 poses have no frame in the video and are not used"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("odometry.csv", "time, frame\n1, 2\n", r"odometry\.csv: lacks the columns frame, x, y"),
        ("odometry.csv", "frame, x, y, z, qx, qy, qz, qw\n0, a, 0, 0, 0, 0, 0, 1\n", "line 2 is not of numbers"),
        ("odometry.csv", "frame, x, y, z, qx, qy, qz, qw\n99, 0, 0, 0, 0, 0, 0, 1\n", "are not those of the video"),
        ("camera_matrix.csv", "1, 2\n", "expected a 3 x 3 matrix with focal lengths"),
        ("camera_matrix.csv", None, r"a Stray Scanner capture without camera_matrix\.csv"),
    ],
)
def test_what_is_wrong_with_a_scan_is_said(room, tmp_path, name, text, message):
    scan = export_room(room, "stray", tmp_path / "scan")
    (scan / name).unlink()
    if text is not None:
        (scan / name).write_text(text)
    with pytest.raises((CaptureError, FileError), match=message):
        load_capture(scan)
